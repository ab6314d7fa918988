// A simulated device with a ledger of its actual writes, and a faulty line to it. The device is
// fxsim's: it shares no code with the agent.
#pragma once

#include <asio/any_io_executor.hpp>
#include <asio/steady_timer.hpp>
#include <compare>
#include <deque>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "agent/field/transport/transport.h"
#include "tests/agent/path/fate.h"
#include "tests/sim/personality.h"
#include "tests/sim/plc.h"

namespace fxagent::test {

/// One word or bit and the value written to it.
struct Deed {
  bool is_bit = false;
  unsigned number = 0;  ///< D100, hr:100, M100 and co:100 are 100
  std::uint32_t value = 0;
  friend auto operator<=>(const Deed&, const Deed&) = default;
};

/// Both ends are included.
struct TimeSpan {
  SteadyTime from;
  SteadyTime to;
};

class LedgerDevice final {
 public:
  explicit LedgerDevice(fxsim::Protocol protocol);

  /// Carries out a request and returns the answer.
  fxsim::Bytes carry_out(const fxsim::Frame& frame);
  /// Overwrites the last write, as another client would.
  void overwrite_last();
  /// Call before the first command. Sets the value of a word. The bits of `mask` belong to another
  /// client, which changes them after each write to the word; a command must leave them unchanged.
  void preset_word(unsigned number, std::uint32_t value);
  void share(unsigned number, std::uint32_t mask) { shared_[number] = mask; }

  bool is_fx() const { return !fxsim::is_modbus(personality_->protocol()); }
  std::uint32_t word(unsigned number) const;
  bool bit(unsigned number) const;
  /// True if the place of `deed` had its value, masked by `mask`, at some time in `when`.
  bool was(const Deed& deed, std::uint32_t mask, TimeSpan when) const;
  /// True if the PLC was in RUN (or not in RUN) at some time in `when`.
  bool was_running(bool running, TimeSpan when) const;
  const fxsim::Personality& personality() const { return *personality_; }

  std::map<Deed, int> ledger;  ///< number of times; for a shared word, of its own bits
  std::map<Deed, SteadyTime> first_done;
  std::map<std::string, int> switched;  ///< "run" and "stop": number of times
  std::vector<std::string> story;       ///< received frames and the faults that struck them
  std::vector<std::string> faults;      ///< effects that no command may have

 private:
  void note(const fxsim::Frame& frame, const fxsim::Ruling& ruling);
  void note_list(std::string_view area, bool bits);
  void note_deed(fxsim::Device device, std::uint32_t value);
  void count(const Deed& deed);
  /// Sets a place from outside of the protocol.
  void set(fxsim::Device device, std::uint32_t value, SteadyTime when);
  fxsim::Device word_device(unsigned number) const;
  fxsim::Device bit_device(unsigned number) const;

  std::unique_ptr<fxsim::Personality> personality_;
  fxsim::Plc plc_;
  std::vector<fxsim::Device> last_;
  std::map<unsigned, std::uint32_t> shared_;  ///< words and their bits of another client
  struct Since {
    SteadyTime when;
    std::uint32_t value;
  };
  static bool had(const std::vector<Since>& history, std::uint32_t value, std::uint32_t mask,
                  TimeSpan when);
  /// By (is a bit, number), in order. Missing places are 0.
  std::map<std::pair<bool, unsigned>, std::vector<Since>> history_;
  std::vector<Since> running_;
};

/// The channel between the agent and a device. Uses the clock of clock_by_hand.h.
class FaultyLine final : public Transport {
 public:
  FaultyLine(asio::any_io_executor executor, LedgerDevice& device, Fate& fate);

  asio::awaitable<Result<void>> open(SteadyTime deadline) override;
  bool is_open() const override { return open_; }
  asio::awaitable<Written> write(ByteView bytes, SteadyTime deadline) override;
  asio::awaitable<Result<std::size_t>> read_some(MutableBytes into, SteadyTime deadline) override;
  Result<Bytes> discard_input() override;
  void close() noexcept override;

 private:
  struct Arrival {
    SteadyTime due;
    Bytes bytes;
  };
  void hear(ByteView bytes, Fault fault);
  void answer(const fxsim::Frame& frame, Fault fault);
  Bytes reply_to(const fxsim::Frame& frame, Fault fault);
  void spoil(Bytes& reply, Fault fault) const;
  void lose();

  asio::any_io_executor executor_;
  asio::steady_timer timer_;
  LedgerDevice& device_;
  Fate& fate_;
  std::unique_ptr<fxsim::Framer> framer_;
  std::deque<Arrival> arrivals_;
  SteadyTime busy_until_{};
  SteadyTime opens_from_{};
  bool open_ = false;
};

}  // namespace fxagent::test
