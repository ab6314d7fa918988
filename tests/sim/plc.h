// One simulated PLC behind its ports: device memory, RUN and STOP, and the plant that moves it.
#pragma once

#include <memory>

#include "tests/sim/bytes.h"
#include "tests/sim/memory.h"
#include "tests/sim/plant.h"

namespace fxsim {

class Plc final {
 public:
  /// The scan clock starts at `start`. `model` must outlive this.
  Plc(const Model& model, std::unique_ptr<Plant> plant, TimePoint start);

  const DeviceMemory& memory() const { return memory_; }
  bool running() const { return running_; }

  /// Runs the scans that are due by `now`; none in STOP. Called before every access from outside,
  /// so an idle PLC costs nothing.
  void advance(TimePoint now);

  void set_running(bool run);
  /// Remote PAUSE of the MC protocol: like STOP, except for the value of SD203.
  void pause();
  /// The hardware switch: while in STOP, it keeps the PLC stopped whatever a port commands.
  void set_run_switch(bool run);
  /// The remote commands of the computer link. RUN is accepted only while the switch keeps a
  /// stopped PLC in STOP, and holds until the remote STOP, which is accepted only then. False:
  /// refused.
  bool force_run();
  bool force_stop();

  /// Sets every device to 0; the latch relays L only if `latched`.
  void clear(bool latched);

  /// Sets a value as the manufacturer would: D8001 and D8101 change too. Precondition:
  /// memory().has().
  void preset(Device device, std::uint32_t value);

  /// Sets a single bit through a port. M8037 ON stops the PLC, OFF starts it; M8036 ON starts it
  /// while M8035 is on. The switch decides if a start takes effect.
  void force(Device device, bool on);
  /// Writes a bit (as force()) or a value through a port.
  void write(Device device, std::uint32_t value);
  /// Writes one byte through a port. The system's own relays and registers keep their values.
  void write_byte(Kind kind, std::size_t offset, std::uint8_t value);

 private:
  void enter(bool run);
  void refresh_system();
  void command_run_state(Device device, bool on);

  DeviceMemory memory_;
  std::unique_ptr<Plant> plant_;
  TimePoint start_;
  std::int64_t scans_done_ = 0;
  bool running_ = true;
  bool run_switch_ = true;
  bool run_forced_ = false;
  bool paused_ = false;
  bool has_system_;     // has the relays and registers from 8000 on
  bool has_mc_system_;  // has SM and SD
  std::uint16_t type_word_;
  std::uint16_t extended_type_word_;
};

}  // namespace fxsim
