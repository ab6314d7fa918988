// Decides what a link does next: a waiting command, the most urgent poll, or nothing until a time.
// Pure: time is an argument, no I/O. Field thread.
#pragma once

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <optional>
#include <vector>

#include "agent/field/poll/group_schedule.h"
#include "agent/steady_time.h"

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

/// Limits of a Rest.
struct BackOff {
  std::chrono::milliseconds first{1000};
  std::chrono::milliseconds cap{30000};
};

/// Rest after a failed attempt. Doubles from BackOff::first to BackOff::cap with each one.
class Rest final {
 public:
  void begin(SteadyTime now, const BackOff& back_off) {
    delay_ = std::min(std::max(back_off.first, delay_ * 2), back_off.cap);
    until_ = now + delay_;
  }
  /// Ends it at `at`, if it lasts longer. The next one is longer all the same.
  void end(SteadyTime at) { until_ = std::min(until_, at); }
  /// Returns its end; a time that has passed if there is none.
  SteadyTime until() const { return until_; }

 private:
  std::chrono::milliseconds delay_{0};
  SteadyTime until_{};
};

/// One device of a line. While it is silent, its polls rest, longer after each failed attempt.
class PolledDevice final {
 public:
  struct Counters {
    std::uint64_t polls = 0;   ///< cycles begun
    std::uint64_t missed = 0;  ///< polls skipped because the line or the device was busy or silent
  };

  /// `unanswered_limit`: consecutive exchanges without an answer that make the device silent.
  PolledDevice(int unanswered_limit, BackOff back_off)
      : unanswered_limit_(unanswered_limit), back_off_(back_off) {}
  void set_back_off(BackOff back_off) { back_off_ = back_off; }

  void answered() {
    unanswered_ = 0;
    rest_ = {};
  }
  enum class AskedBy : std::uint8_t { poll, command };
  /// Counts one more exchange without an answer. True if the device is silent now: its polls rest
  /// until the back-off has passed. Commands begin a rest and never extend one: a stream of them
  /// would keep the polls from finding that the tags are bad.
  bool unanswered(SteadyTime now, AskedBy by = AskedBy::poll) {
    const bool was_silent = is_silent();
    ++unanswered_;
    if (is_silent() && !(was_silent && by == AskedBy::command)) rest_.begin(now, back_off_);
    return is_silent();
  }
  bool is_silent() const { return unanswered_ >= unanswered_limit_; }
  /// Returns the number of consecutive exchanges without an answer.
  int unanswered_in_a_row() const { return unanswered_; }
  SteadyTime rests_until() const { return rest_.until(); }
  const BackOff& back_off() const { return back_off_; }

  void cycle_begun() { ++counters_.polls; }
  void missed(std::uint64_t polls) { counters_.missed += polls; }
  const Counters& counters() const { return counters_; }

 private:
  int unanswered_limit_;
  BackOff back_off_;
  int unanswered_ = 0;
  Rest rest_;
  Counters counters_;
};

class PollScheduler final {
 public:
  using DeviceId = std::uint32_t;
  using GroupId = std::uint32_t;

  /// One exchange in the cycle of one group.
  struct PollStep {
    GroupId group = 0;
    std::uint32_t exchange = 0;
    bool starts_cycle = false;
    std::chrono::nanoseconds late{0};  ///< starts_cycle: time since it was due
  };
  struct Job {
    enum class Kind : std::uint8_t { command, poll, wait } kind = Kind::wait;
    PollStep poll;       ///< kind poll
    SteadyTime until{};  ///< kind wait: nothing is due earlier
  };

  /// `poll_share`: see LineShare.
  explicit PollScheduler(double poll_share = 0.2) : share_(poll_share) {}
  /// The waiting commands, and what the polls may use next to them.
  LineShare& share() { return share_; }
  /// The rest of a device while it is silent, and its counters. Valid until the next add_device().
  PolledDevice& device(DeviceId id) { return devices_[id].polled; }

  /// `unanswered_limit`: see PolledDevice.
  DeviceId add_device(int unanswered_limit, BackOff back_off);
  /// Adds a group polled every `interval` (0: as fast as the line allows), first at `first_due`. A
  /// cycle of 0 exchanges still takes one step. `within` is the deadline of a cycle after it was
  /// due (0: when the next one is due).
  GroupId add_group(DeviceId device, std::chrono::milliseconds interval, std::uint32_t exchanges,
                    SteadyTime first_due, std::chrono::milliseconds within = {});
  /// Polls the group every `interval` from now on (0 as above). A running cycle goes on; the next
  /// one is due when it was, or within `interval` if that is sooner.
  void set_interval(GroupId group, std::chrono::milliseconds interval, SteadyTime now);
  /// Removes the device and its groups, whose ids may be reused. No step of it may be in progress.
  void remove_device(DeviceId device);
  /// The schedule of a group. Valid until the next add_group().
  GroupSchedule& group(GroupId id) { return groups_[id].schedule; }

  /// Returns the job to run now, or the time to wait for. Changes state: the cycle of a poll with
  /// `starts_cycle` has begun. The same exchange is offered again until step_done() or the end of
  /// the cycle. Waiting commands come first, except for the polls' share and after a silence; then
  /// the due group with the earliest deadline, unless it or its device rests. A running cycle goes
  /// on with its next exchange by the same rule. A late cycle does not move the later ones: missed
  /// intervals are skipped and counted, never sent in a burst. If the groups ask for more than the
  /// whole line, all intervals are stretched by the same factor.
  Job next(SteadyTime now);
  /// Same, for the polls alone that go first after a silence. Nullopt: its time is used up, or no
  /// such poll is due; what is left of the time is then given up.
  std::optional<PollStep> next_after_silence(SteadyTime now);

  /// Records that the step was carried out. True: the cycle has ended.
  bool step_done(const PollStep& step) {
    return groups_[step.group].schedule.step_done(step.exchange);
  }

  /// Records a cycle of the group in which invalid answers closed the connection and none was
  /// valid. After three in a row, the group rests as a silent device does. Cycles without
  /// any answer between them do not reset the count.
  void only_invalid(GroupId group, SteadyTime now);
  /// Records a valid answer to a cycle of the group: it does not rest.
  void had_valid(GroupId group);
  /// Returns when the group is polled next: when it is due, or when its own rest ends.
  SteadyTime next_poll(GroupId id) const {
    return std::max(groups_[id].schedule.next_due(), groups_[id].rest.until());
  }

  /// Schedules one extra cycle at or soon after `from` for each group of the device that is not
  /// being read. The intervals stay as they are, and the rests of the groups end. The cycles are
  /// spread so that half of the line is left to others. Returns when those of another device may
  /// follow.
  SteadyTime read_at_once(DeviceId device, SteadyTime from);
  /// Ends the running cycles. Polls that were due before `now` are skipped, and do not count as
  /// missed. Groups are read again when they are next due.
  void forget_until(SteadyTime now);

  /// Records that the device left a request unanswered for this long. Due polls of devices that
  /// answer go before all else then, for as long again, so that they wait for one try at a time. A
  /// silence of one of these polls gives no further time.
  void was_silent(DeviceId device, std::chrono::nanoseconds lasted,
                  PolledDevice::AskedBy by = PolledDevice::AskedBy::poll);
  /// Records line time used by a command; the polls' share depends on it.
  void command_used(std::chrono::nanoseconds line_time, SteadyTime now);
  /// Records line time used by polls outside the exchanges of a group, such as a question about the
  /// model.
  void poll_used(std::chrono::nanoseconds line_time);
  /// Records line time used by an exchange of a group. Also measures the line time of its cycles.
  void step_used(const PollStep& step, std::chrono::nanoseconds line_time);
  /// Returns the part of the line that the groups' intervals ask for, by the measured line time of
  /// their cycles. Above 1 the line is overloaded. Groups without an interval, groups at rest and
  /// silent devices do not count.
  double load() const;

 private:
  struct Device {
    PolledDevice polled;
    bool gone = false;  ///< remove_device(): the place is vacant
  };
  struct Group {
    DeviceId device = 0;
    bool gone = false;  ///< remove_device(): the place is vacant
    GroupSchedule schedule;
    int only_invalid = 0;  ///< consecutive cycles; see only_invalid()
    Rest rest{};
  };

  enum class Of : std::uint8_t { all, answering };
  /// Returns the due group that goes first, or null.
  Group* most_urgent(SteadyTime now, Of devices = Of::all);
  /// Returns the next step of the group, whose cycle begins if none is running.
  PollStep next_step(Group& group, SteadyTime now);
  SteadyTime next_wake() const;
  /// Returns the end of the rest of the group or its device.
  SteadyTime rests_until(const Group& group) const {
    return std::max(group.rest.until(), devices_[group.device].polled.rests_until());
  }

  LineShare share_;
  std::vector<Device> devices_;
  std::vector<Group> groups_;
  /// Line time of was_silent() that is left; nullopt: no polls go first.
  std::optional<std::chrono::nanoseconds> after_silence_;
  DeviceId last_silent_ = 0;
};

}  // namespace fxagent
