// Queues and runs the commands of one link, computes their bounds, and lets others run between the
// parts of a long one. Field thread.
#pragma once

#include <asio/any_io_executor.hpp>
#include <asio/awaitable.hpp>
#include <chrono>
#include <list>
#include <optional>
#include <vector>

#include "agent/commands/admitted_command.h"
#include "agent/field/link/link_device.h"
#include "agent/field/link/link_recorder.h"
#include "agent/field/link/link_state.h"
#include "agent/field/link/poller.h"
#include "agent/handover/command_message.h"

namespace fxagent {

/// An admitted command in the queue, or running.
struct WaitingCommand {
  AdmittedCommand admitted;
  LinkDevice* device = nullptr;
  /// Longest reads that the device answered when the bound was set: the bound counts these reads.
  std::vector<Holes::Limit> read_limits{};
  std::chrono::nanoseconds line_time{0};
  /// Line time that other commands may use between its parts: what it has used itself (planned, of
  /// the targets with an outcome; measured, of the current one) and not yet given away.
  std::chrono::nanoseconds credit{0};
};

class LinkCommands final {
 public:
  /// All arguments must outlive it.
  LinkCommands(asio::any_io_executor executor, const LinkParts& link, LinkState& state,
               Poller& poller, LinkRecorder& recorder);
  LinkCommands(const LinkCommands&) = delete;
  LinkCommands& operator=(const LinkCommands&) = delete;

  /// Appends a command to the queue and sets its bound.
  void add(AdmittedCommand admitted, LinkDevice& device);
  /// Carries out the first waiting command, which must exist. Its result goes to the outbox. While
  /// another agent has our id, rejects all waiting commands instead, except interrupted ones.
  asio::awaitable<void> run_next();
  /// True while run_next() is in progress.
  bool is_running() const { return !running_.empty(); }
  /// True while a poll runs between two parts of a command. False during the polls after an
  /// unanswered exchange: the next exchange is often the read-back of a write.
  bool is_polling() const { return polling_; }
  /// Stops the running command from sending anything more, read-backs included.
  void end() { over_ = true; }

  /// After a bug: answers the running commands, not the waiting ones, with UNKNOWN_OUTCOME.
  void answer_running();
  /// Answers the waiting commands, all or those of `device`, with not_sent() and `why`.
  void refuse_waiting(Reason why, const LinkDevice* device = nullptr);
  const std::list<WaitingCommand>& waiting() const { return waiting_; }  ///< for tests

 private:
  class Sharing;

  std::optional<std::chrono::nanoseconds> bound_of(const WaitingCommand& command) const;
  /// Returns the line time of the enquiries that precede the first exchange with each device of a
  /// session.
  std::chrono::nanoseconds handshakes() const;
  /// True if the next waiting command may run between two parts of the running one: it takes at
  /// most the credit of each running command and touches nothing that one of its device touches.
  bool may_go_between() const;
  void after_write(LinkDevice& device, const AdmittedTarget& target, const TargetResult& outcome);

  asio::any_io_executor executor_;
  const LinkParts link_;
  LinkState& state_;
  Poller& poller_;
  LinkRecorder& recorder_;
  std::list<WaitingCommand> waiting_;
  /// The running command, then the command between two of its parts, and so on.
  std::list<WaitingCommand> running_;
  bool over_ = false;
  bool polling_ = false;
};

}  // namespace fxagent
