// Carries out one admitted command on the wire: expect, write, verify, and the honest word for how
// it ended. Field thread.
#pragma once

#include <asio/awaitable.hpp>
#include <asio/steady_timer.hpp>
#include <optional>
#include <string>

#include "agent/config.h"
#include "agent/field/command_desk.h"
#include "agent/field/line.h"
#include "agent/messages.h"
#include "protocol/plan.h"

namespace fxagent {

class OrderRun final {
 public:
  /// All arguments outlive run().
  OrderRun(asio::any_io_executor executor, Line& line, Station& station, const DeviceConfig& device,
           const Order& order);

  /// The result, complete but for its bound. Opens the line once where it is closed.
  asio::awaitable<CommandResult> run();

  /// Whether the device has answered anything, or has left something unanswered, during the run.
  bool was_answered() const { return answered_; }
  bool was_unanswered() const { return unanswered_; }

  /// Line time of all exchanges of `order` when each ends well.
  static std::chrono::nanoseconds line_time(const Codec& codec, const DeviceConfig& device,
                                            std::chrono::nanoseconds char_time, const Order& order);

 private:
  struct ReadBack {
    std::optional<Bytes> image;  ///< of the whole point; nullopt: it could not be read
    Exchange last;
  };

  asio::awaitable<Exchange> ask(Request request, SteadyTime not_after);
  asio::awaitable<ReadBack> read_point(const OrderTarget& target, SteadyTime not_after);
  asio::awaitable<void> run_targets();
  asio::awaitable<void> read_target(const OrderTarget& target, TargetResult& out);
  asio::awaitable<void> write_target(const OrderTarget& target, TargetResult& out);
  asio::awaitable<bool> check_expected(const OrderTarget& target, TargetResult& out);
  /// Sends `request`, and before it the read that it needs; that read's failure is the order's.
  asio::awaitable<Exchange> send(Request request, SteadyTime not_after);
  /// Sends `request`, and a second time only where the first surely had no effect.
  asio::awaitable<Exchange> send_once_or_twice(Request request, bool may_repeat);
  /// Whether `target` shares a place with another of the order: then their sequence matters.
  bool meets_another(const OrderTarget& target) const;
  /// All targets in one frame, where the protocol has one for them. False: it has not.
  asio::awaitable<bool> write_together();
  /// What an order's last exchange means for one target; then its verification.
  asio::awaitable<void> conclude(const OrderTarget& target, Exchange exchange, TargetResult& out);
  bool surely_without_effect(const Request& request, const Exchange& exchange) const;
  asio::awaitable<void> verify(const OrderTarget& target, TargetResult& out);
  /// Reads what the order was to write: the same value counts as carried out.
  asio::awaitable<void> read_outcome(const OrderTarget& target, std::string succeeded,
                                     TargetResult& out);
  asio::awaitable<void> settle_left_behind();
  asio::awaitable<void> settle_unknown(const OrderTarget& target, const Exchange& lost,
                                       TargetResult& out);
  asio::awaitable<void> run_or_stop();
  asio::awaitable<std::optional<bool>> await_run_state(bool wanted);
  asio::awaitable<void> pause(std::chrono::milliseconds duration);
  void summarise();

  asio::steady_timer timer_;
  Line& line_;
  Station& station_;
  const DeviceConfig& device_;
  const Order& order_;
  CommandResult result_;
  std::optional<SteadyTime> first_byte_;
  SteadyTime last_byte_{};
  bool answered_ = false;
  bool unanswered_ = false;
};

}  // namespace fxagent
