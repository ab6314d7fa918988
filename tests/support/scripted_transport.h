// A channel that plays a script: the writes it expects, the bytes it delivers, silences and
// failures. It does not wait: a read without data times out at once, except after `hang`. Every
// call yields to the io_context, as a real channel does.
#pragma once

#include <asio/any_io_executor.hpp>
#include <asio/steady_timer.hpp>
#include <cstddef>
#include <deque>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "agent/field/transport/transport.h"

namespace fxagent::test {

class ScriptedTransport final : public Transport {
 public:
  /// Returns the answer to a request; empty means silence.
  using Device = std::function<Bytes(ByteView request)>;

  explicit ScriptedTransport(asio::any_io_executor executor);

  /// After be_udp() each give() is one datagram.
  enum class Port : std::uint8_t { fixed, renewed };
  void be_udp(Port port) {
    is_udp_ = true;
    renews_ = port == Port::renewed;
  }
  /// The number of calls to renew().
  std::size_t renewed() const { return renewed_; }

  // The script, in the order it is played.

  /// The next write must be exactly these bytes; any other fails the test.
  ScriptedTransport& expect(Bytes bytes);
  /// One read delivers these bytes; if its buffer is small, several reads do. discard_input()
  /// discards them too.
  ScriptedTransport& give(Bytes bytes);
  /// Like give(), but these bytes arrive after any discard_input().
  ScriptedTransport& later(Bytes bytes);
  /// One read delivers nothing before its deadline. Any read does so while a write is expected.
  ScriptedTransport& silence();
  /// One read really waits: until its deadline or until the channel is closed.
  ScriptedTransport& hang();
  /// The peer closes the connection: the next read, write or discard_input() fails.
  ScriptedTransport& hang_up();
  /// The next write fails after this many bytes.
  ScriptedTransport& break_write(std::size_t after);
  /// The next open() fails with this text.
  ScriptedTransport& refuse_open(std::string why);
  /// Runs once the earlier steps are done and the channel is used again.
  ScriptedTransport& call(std::function<void()> action);
  /// Answers every write after the end of the script. Without it they fail the test.
  void then(Device device) { device_ = std::move(device); }

  /// Skips the next step.
  void skip() { steps_.pop_front(); }
  std::size_t steps_left() const { return steps_.size(); }
  std::size_t opened() const { return opened_; }
  /// Everything that was written, in order.
  const std::vector<Bytes>& written() const { return written_; }

  asio::awaitable<Result<void>> open(SteadyTime deadline) override;
  bool is_open() const override { return open_; }
  asio::awaitable<Written> write(ByteView bytes, SteadyTime deadline) override;
  asio::awaitable<Result<std::size_t>> read_some(MutableBytes into, SteadyTime deadline) override;
  Result<Bytes> discard_input() override;
  bool has_datagrams() const override { return is_udp_; }
  bool has_rest() const override { return is_udp_ && !arrived_.empty(); }
  bool can_renew() const override { return renews_; }
  Result<void> renew() override {
    if (renews_) ++renewed_;
    return {};
  }
  void close() noexcept override;

 private:
  struct Step {
    enum class Kind : std::uint8_t {
      expect,
      give,
      later,
      silence,
      hang,
      hang_up,
      break_write,
      refuse_open,
      call
    } kind;
    Bytes bytes;
    std::size_t count = 0;
    std::string text;
    std::function<void()> action;
  };

  ScriptedTransport& add(Step step);
  /// Runs the calls that are due, then returns true if the next step is of this kind.
  bool next_is(Step::Kind kind);
  Step take();

  asio::any_io_executor executor_;
  asio::steady_timer hanging_;
  std::deque<Step> steps_;
  Device device_;
  std::vector<Bytes> written_;
  Bytes arrived_;
  bool open_ = false;
  std::size_t opened_ = 0;
  bool is_udp_ = false;
  bool renews_ = false;
  std::size_t renewed_ = 0;
};

}  // namespace fxagent::test
