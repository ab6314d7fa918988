// The share of polls in the time of a line, and the bounds of commands that follow from it. Pure.
// Field thread.
#pragma once

#include <algorithm>
#include <chrono>
#include <cstdint>

namespace fxagent {

/// Divides the time of one line between commands and polls. Commands go first, but polls keep their
/// share during a flood of commands.
class LineShare final {
 public:
  /// `poll_share`: part of the line time that polls keep during a flood of commands, 0 … 0.9.
  explicit LineShare(double poll_share) : poll_share_(poll_share) {}
  void set_poll_share(double share) { poll_share_ = share; }

  void command_waits() { ++commands_; }
  /// Call when the command that goes first has been removed from the queue.
  void command_taken() { --commands_; }
  std::uint32_t commands_waiting() const { return commands_; }
  /// Sets the number of waiting commands after a fault.
  void commands_are(std::uint32_t waiting) { commands_ = waiting; }

  /// True if a waiting command goes before the polls. If no command waits, or no poll is due, the
  /// polls' claim ends.
  bool command_goes_first(bool is_poll_due) {
    if (commands_ == 0) owed_to_polls_ = {};
    if (!is_poll_due) owed_to_polls_ = std::min(owed_to_polls_, std::chrono::nanoseconds(0));
    return commands_ > 0 && !(is_poll_due && owed_to_polls_.count() > 0);
  }

  /// Records line time used by a command while a poll was due: the polls may claim their share.
  void polls_waited(std::chrono::nanoseconds line_time) { owed_to_polls_ += share_of(line_time); }
  void poll_used(std::chrono::nanoseconds line_time) { owed_to_polls_ -= line_time; }

  /// Returns the longest time from now until a command is finished, on a line where no exchange is
  /// longer than planned. That is the poll exchange on the wire, the commands `ahead` (the one on
  /// the wire counts whole), the polls that go between them, and the command's `own` exchanges.
  std::chrono::nanoseconds bound(std::chrono::nanoseconds own, std::chrono::nanoseconds ahead,
                                 std::chrono::nanoseconds longest_poll) const {
    return longest_poll + ahead + polls_between(ahead, longest_poll) + own;
  }
  /// Same for a command that lets others run between its parts. Adds the polls' share of its own
  /// line time, and other commands for as long as itself.
  std::chrono::nanoseconds bound_giving_way(std::chrono::nanoseconds own,
                                            std::chrono::nanoseconds ahead,
                                            std::chrono::nanoseconds longest_poll) const {
    const auto commands = ahead + 2 * own;
    return longest_poll + commands + polls_between(commands, longest_poll);
  }

 private:
  /// Returns the line time that polls may use for this line time of commands.
  std::chrono::nanoseconds share_of(std::chrono::nanoseconds commands) const {
    const double factor = poll_share_ / (1.0 - poll_share_);
    return std::chrono::nanoseconds(
        static_cast<std::int64_t>(static_cast<double>(commands.count()) * factor));
  }
  /// Returns the most poll time before or between commands of `line_time` in total, including what
  /// is owed to the polls. `longest_poll` is the longest poll exchange.
  std::chrono::nanoseconds polls_between(std::chrono::nanoseconds line_time,
                                         std::chrono::nanoseconds longest_poll) const {
    const auto owed_already = std::max(owed_to_polls_, std::chrono::nanoseconds(0));
    if (line_time.count() <= 0 && owed_already.count() == 0) return {};
    // A poll runs while anything is owed, so the last one may overdraw by its whole length.
    return owed_already + share_of(line_time) + longest_poll;
  }

  double poll_share_;
  std::uint32_t commands_ = 0;
  std::chrono::nanoseconds owed_to_polls_{0};  ///< below 0: they have used more
};

}  // namespace fxagent
