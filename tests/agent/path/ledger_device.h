// A simulated device that keeps a ledger of what it really did, and the line to it, where faults
// strike. The device is fxsim's: it shares no code with the agent.
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

#include "agent/field/transport.h"
#include "tests/agent/path/fate.h"
#include "tests/sim/personality.h"
#include "tests/sim/plc.h"

namespace fxagent::test {

/// One word or bit with the value that it was given.
struct Deed {
  bool is_bit = false;
  unsigned number = 0;  ///< D100, hr:100, M100 and co:100 are 100
  std::uint32_t value = 0;
  friend auto operator<=>(const Deed&, const Deed&) = default;
};

/// From the first moment to the last, both included.
struct TimeSpan {
  SteadyTime from;
  SteadyTime to;
};

class LedgerDevice final {
 public:
  explicit LedgerDevice(fxsim::Protocol protocol);

  /// The answer of the device, which does what it is asked.
  fxsim::Bytes carry_out(const fxsim::Frame& frame);
  /// Something else sets what was written last.
  void overwrite_last();
  /// Before the first command: what a word holds; that the bits of `mask` are somebody else's, who
  /// changes them whenever the word was written. A command must leave them as it finds them.
  void preset_word(unsigned number, std::uint32_t value);
  void share(unsigned number, std::uint32_t mask) { shared_[number] = mask; }

  bool is_fx() const { return !fxsim::is_modbus(personality_->protocol()); }
  std::uint32_t word(unsigned number) const;
  bool bit(unsigned number) const;
  /// Whether the place of `deed` had its value, as far as `mask` goes, at some time of `when`.
  bool was(const Deed& deed, std::uint32_t mask, TimeSpan when) const;
  /// Whether the PLC was in RUN, or not, at some time of `when`.
  bool was_running(bool running, TimeSpan when) const;
  const fxsim::Personality& personality() const { return *personality_; }

  std::map<Deed, int> ledger;  ///< how often each was done; of a shared word its own bits
  std::map<Deed, SteadyTime> first_done;
  std::map<std::string, int> switched;  ///< "run", "stop": how often it was made to
  std::vector<std::string> story;       ///< the frames that came, and what struck them
  std::vector<std::string> faults;      ///< what no command may do

 private:
  void note(const fxsim::Frame& frame, const fxsim::Ruling& ruling);
  void note_list(std::string_view area, bool bits);
  void note_deed(fxsim::Device device, std::uint32_t value);
  void count(const Deed& deed);
  /// Sets a place from outside.
  void set(fxsim::Device device, std::uint32_t value, SteadyTime when);
  fxsim::Device word_device(unsigned number) const;
  fxsim::Device bit_device(unsigned number) const;

  std::unique_ptr<fxsim::Personality> personality_;
  fxsim::Plc plc_;
  std::vector<fxsim::Device> last_;
  std::map<unsigned, std::uint32_t> shared_;  ///< words, and the bits of them that are not theirs
  struct Since {
    SteadyTime when;
    std::uint32_t value;
  };
  static bool had(const std::vector<Since>& history, std::uint32_t value, std::uint32_t mask,
                  TimeSpan when);
  /// By kind (bits are true) and number, in their order. What is not in it is 0.
  std::map<std::pair<bool, unsigned>, std::vector<Since>> history_;
  std::vector<Since> running_;
};

/// The channel between the agent and a device. Time on it is that of clock_by_hand.h.
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
