// Runs the field thread and its links. Everything else in this directory runs on that thread.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "agent/commands/admitted_command.h"
#include "agent/config/config_difference.h"
#include "agent/config/model.h"
#include "agent/handover/line_permit.h"
#include "agent/handover/outbox.h"
#include "agent/recorder/flight_recorder.h"

namespace fxagent {

/// `off`: devices only answer commands, as the command line needs it.
enum class Polling : std::uint8_t { on, off };

/// Time for the exchange on the wire and the read-back of a command when its link or device ends:
/// at a stop, or because the config changes.
inline constexpr std::chrono::milliseconds kFinishWithin{2500};

class Field final {
 public:
  using Done = std::function<void()>;

  /// `outbox` must outlive the field; `config` is copied. Nothing runs yet. `last_seq` has the
  /// sequence number of each device's newest sample; a missing entry counts as 0.
  /// `recorder` must outlive the field; nullptr: frames are not recorded.
  /// `permit` must outlive the field; nullptr: it may send at any time.
  Field(const Config& config, Outbox& outbox, const std::vector<std::uint64_t>& last_seq,
        Polling polling = Polling::on, FlightRecorder* recorder = nullptr,
        const LinePermit* permit = nullptr);
  /// Calls stop() unless it was called.
  ~Field();

  /// Logs each frame of these links, given by index in Config::links. Call before start().
  void trace(const std::vector<std::uint32_t>& links);
  /// Makes `signal` switch the traces of all links: off if any is traced, otherwise on. asio
  /// installs its handler for the signal. Call before start().
  void switch_traces_at(int signal);
  /// Calls `act` on the field thread at each `signal`, as above. Call before start().
  void call_at(int signal, const std::function<void()>& act);
  /// Starts the thread. Throws std::system_error if that fails.
  void start();
  /// Continues sequence numbers above these, by device. Any thread.
  void number_above(std::vector<std::uint64_t> last_seq);
  /// Hands a command to the field. Exactly one result comes back through the outbox. Any thread.
  void submit(AdmittedCommand admitted);
  /// Puts the current counters into the outbox soon, in addition to those every 5 s. Any thread.
  void report();
  /// Closes the link's port for `time`, so that another program can use it; 0: takes it back.
  /// `text` says for whom and until when. Calls `done` on the field thread: Reason::none if it was
  /// done. Any thread.
  void yield(std::string link, std::chrono::minutes time, std::string text,
             std::function<void(Reason)> done);
  /// Calls `call` on the field thread. Any thread.
  void post(std::function<void()> call);
  // A changed config takes two calls, end() and begin(). Any thread. Unchanged links and devices
  // run on undisturbed.
  /// Ends the links and devices that the change ends. What is on the wire has kFinishWithin; on a
  /// link that stays, it has as long as the exchange takes. Waiting commands get FAILED reloading,
  /// as does every command for these devices until begin(). `done` is called on the field thread
  /// when all their results and counters are in the outbox, but never if stop() comes first.
  void end(std::shared_ptr<const ConfigChange> change, Done done);
  /// Call after end(). Applies the new config and begins what the change adds. `last_seq` as in the
  /// constructor; a device whose name was used earlier in this run continues its own numbers.
  /// `done` is called as above when everything has begun. Commands are accepted at once.
  void begin(std::shared_ptr<const ConfigChange> change, std::vector<std::uint64_t> last_seq,
             Done done);

  /// Stops polling, ends the command on each wire after kFinishWithin at the latest, answers
  /// waiting commands with FAILED shutting_down, and joins the thread. Afterwards the outbox holds
  /// every result.
  void stop();
  /// Returns the links that have not ended: the first names and the number of the others. Any
  /// thread, while stop() waits.
  std::string unfinished() const;

 private:
  struct Thread;
  std::unique_ptr<Thread> field_;
};

}  // namespace fxagent
