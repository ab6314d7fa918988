// The commands of one link that wait for the wire or are on it: their queue and their bound, and
// what one that takes long lets between its parts. Field thread.
#pragma once

#include <asio/any_io_executor.hpp>
#include <asio/awaitable.hpp>
#include <chrono>
#include <list>
#include <memory>
#include <optional>
#include <string_view>

#include "agent/commands/admitted_command.h"
#include "agent/config/config.h"
#include "agent/field/bus.h"
#include "agent/field/link_device.h"
#include "agent/field/link_state.h"
#include "agent/field/poll_scheduler.h"
#include "agent/field/poller.h"
#include "agent/messages.h"
#include "agent/outbox.h"

namespace fxagent {

/// An admitted command in its queue.
struct WaitingCommand {
  AdmittedCommand admitted;
  LinkDevice* device = nullptr;
  std::chrono::nanoseconds line_time{0};
};

class LinkCommands final {
 public:
  /// All arguments outlive it.
  LinkCommands(asio::any_io_executor executor, const LinkConfig& link, Bus& bus,
               PollScheduler& scheduler, const LinkDevices& devices, LinkState& state,
               Poller& poller, Outbox& outbox);
  LinkCommands(const LinkCommands&) = delete;
  LinkCommands& operator=(const LinkCommands&) = delete;

  /// Behind all that wait. It has its bound from here.
  void add(AdmittedCommand admitted, LinkDevice& device);
  /// Carries out the first that waits; there is one. Its result goes to the outbox.
  asio::awaitable<void> run_next();
  /// Whether run_next() is under way.
  bool is_running() const { return !running_.empty(); }
  /// Of the one under way nothing more goes out, not even what is to be read back.
  void end() { over_ = true; }

  /// After a bug: those under way are answered UNKNOWN_OUTCOME; those that wait go on waiting.
  void answer_running(std::string_view why);
  /// Takes all that wait off the queue.
  std::list<WaitingCommand> take_waiting();
  /// Takes those of the device off it.
  std::list<WaitingCommand> take_waiting(const LinkDevice& device);

 private:
  class Sharing;

  std::optional<std::chrono::nanoseconds> bound_of(const WaitingCommand& command) const;
  /// Line time of the enquiries that go before the first exchange with each device of a session.
  std::chrono::nanoseconds handshakes() const;
  /// Whether the next waiting command may go between two parts of the one under way: it takes no
  /// longer than `credit`, and touches nothing that a resting one of its device does.
  bool may_go_between(std::chrono::nanoseconds credit) const;
  /// A poll while a command rests. False: it put nothing on the line.
  asio::awaitable<bool> poll_between(PollScheduler::PollStep step);
  void after_write(LinkDevice& device, const AdmittedTarget& target, const TargetResult& outcome);

  asio::any_io_executor executor_;
  const LinkConfig& link_;
  Bus& bus_;
  PollScheduler& scheduler_;
  const LinkDevices& devices_;
  LinkState& state_;
  Poller& poller_;
  Outbox& outbox_;
  std::list<WaitingCommand> waiting_;
  /// The command under way; behind it the one that goes between two parts of it, and so on.
  std::list<WaitingCommand> running_;
  Sharing* sharing_ = nullptr;  ///< of the last of them
  bool over_ = false;
};

}  // namespace fxagent
