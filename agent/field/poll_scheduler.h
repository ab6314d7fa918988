// What a link does next: a waiting command, the most urgent poll, or nothing until a time.
// Pure: time is an argument, no I/O. Field thread.
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <vector>

#include "agent/messages.h"

namespace fxagent {

/// How long a silent device is left alone. Doubles from `first` to `cap` with each vain attempt.
struct BackOff {
  std::chrono::milliseconds first{1000};
  std::chrono::milliseconds cap{30000};
};

class PollScheduler final {
 public:
  using DeviceId = std::uint32_t;
  using GroupId = std::uint32_t;

  /// One exchange of one group's cycle.
  struct PollStep {
    GroupId group = 0;
    std::uint32_t exchange = 0;
    bool starts_cycle = false;
    std::chrono::nanoseconds late{0};  ///< starts_cycle: how long after it was due
  };
  struct Job {
    enum class Kind : std::uint8_t { command, poll, wait } kind = Kind::wait;
    PollStep poll;       ///< kind poll
    SteadyTime until{};  ///< kind wait: nothing is due before
  };
  struct Counters {
    std::uint64_t polls = 0;   ///< cycles begun
    std::uint64_t missed = 0;  ///< polls left out because the line or the device was busy or silent
  };

  /// `poll_share`: the part of the line that polls keep while commands flood it, 0 … 0.9.
  explicit PollScheduler(double poll_share = 0.2) : poll_share_(poll_share) {}

  /// `unanswered_limit`: so many exchanges in a row without an answer make the device silent.
  DeviceId add_device(int unanswered_limit, BackOff back_off);
  /// A group polled each `interval` (0: as fast as the line allows), first at `first_due`. A cycle
  /// of 0 exchanges is one step all the same. `within` is the deadline of a cycle after it was due
  /// (0: when the next one is due).
  GroupId add_group(DeviceId device, std::chrono::milliseconds interval, std::uint32_t exchanges,
                    SteadyTime first_due, std::chrono::milliseconds within = {});
  /// The device and its groups are gone; others may have their ids from now on. None of its steps
  /// is under way.
  void remove_device(DeviceId device);
  void set_back_off(DeviceId device, BackOff back_off) { devices_[device].back_off = back_off; }
  void set_poll_share(double share) { poll_share_ = share; }
  /// After a new plan: the running cycle, if any, begins anew.
  void set_exchanges(GroupId group, std::uint32_t exchanges);
  /// The running cycle, whose last exchange took `line_time` in vain, goes on to so many exchanges
  /// in all. Its deadline moves by some times that, so that other groups keep their part of the
  /// line however long it looks for what is missing; and it tells nothing of what a cycle takes.
  void extend_cycle(GroupId group, std::uint32_t exchanges, std::chrono::nanoseconds line_time,
                    SteadyTime now);

  void command_waits() { ++commands_; }
  /// The command that next() offered has been taken off the queue.
  void command_taken() { --commands_; }
  std::uint32_t commands_waiting() const { return commands_; }
  /// After a fault: so many wait, whatever was counted.
  void commands_are(std::uint32_t waiting) { commands_ = waiting; }

  /// The job to run now, or until when to wait. Waiting commands come first, save for the polls'
  /// share; then the due group with the earliest deadline whose device is not in back-off. A late
  /// cycle does not move the later ones: missed intervals are skipped and counted, never sent in a
  /// burst. A cycle under way goes on with its next exchange by the same rule. Where the groups ask
  /// for more than the whole line, the intervals of all are stretched by the same factor.
  Job next(SteadyTime now);

  /// The step was carried out; the cycle goes on, or has ended: true.
  bool step_done(const PollStep& step);
  /// The same step is to be offered again, but not before then: the device is busy.
  void postpone(const PollStep& step, SteadyTime not_before);
  /// The rest of the cycle is given up until the next one is due. A group without an interval has
  /// none and rests until `not_before`: what failed without using the line must not be offered
  /// again in the same breath.
  void abandon_cycle(GroupId group, SteadyTime not_before);

  /// Each group of the device that is not being read is read once at `from` or soon after it,
  /// whatever its interval, which it keeps. They are spread so that half of the line is left to
  /// others. Returns where those of another device may follow.
  SteadyTime read_at_once(DeviceId device, SteadyTime from);
  /// When the next cycle of the group is due by its interval.
  SteadyTime next_due(GroupId group) const { return groups_[group].due; }

  /// Line time that commands and polls have used; feeds the polls' share.
  void command_used(std::chrono::nanoseconds line_time, SteadyTime now);
  void poll_used(std::chrono::nanoseconds line_time);
  /// The same for an exchange of a group, which also tells what its cycles take.
  void step_used(const PollStep& step, std::chrono::nanoseconds line_time);
  /// The part of the line that the groups' intervals ask for, by what their cycles took: above 1
  /// the line is overloaded. Groups without an interval ask for nothing, and silent devices do not
  /// count.
  double load() const;
  /// The longest that a command may take from now until it is through, on a line where no exchange
  /// is longer than planned: the poll exchange on the wire, the commands `ahead` of it (the one on
  /// the wire counts whole), the polls that next() puts between them, and its `own` exchanges.
  std::chrono::nanoseconds bound(std::chrono::nanoseconds own, std::chrono::nanoseconds ahead,
                                 std::chrono::nanoseconds longest_poll) const;
  /// The same of a command that gives way between its parts: there may also be the polls' share of
  /// its own line time, and other commands for as long as itself.
  std::chrono::nanoseconds bound_giving_way(std::chrono::nanoseconds own,
                                            std::chrono::nanoseconds ahead,
                                            std::chrono::nanoseconds longest_poll) const;

  void device_answered(DeviceId device);
  enum class AskedBy : std::uint8_t { poll, command };
  /// One more exchange without an answer. True when the device is silent from now on or still: its
  /// polls rest until the back-off has passed. Commands begin a rest and never make one longer: a
  /// stream of them would keep the polls from finding that the tags are bad.
  bool device_unanswered(DeviceId device, SteadyTime now, AskedBy by = AskedBy::poll);
  bool is_silent(DeviceId device) const { return devices_[device].silent; }

  const Counters& counters(DeviceId device) const { return devices_[device].counters; }

 private:
  struct Device {
    int unanswered_limit = 1;
    BackOff back_off;
    bool gone = false;  ///< remove_device(): the place is vacant
    int unanswered = 0;
    bool silent = false;
    std::chrono::milliseconds delay{0};
    SteadyTime rests_until{};
    Counters counters;
  };
  struct Group {
    DeviceId device = 0;
    bool gone = false;  ///< remove_device(): the place is vacant
    std::chrono::nanoseconds interval{0};
    std::chrono::nanoseconds within{0};
    std::uint32_t exchanges = 1;
    SteadyTime due{};                   ///< of the next cycle
    std::optional<SteadyTime> at_once;  ///< of one before it
    SteadyTime deadline{};              ///< of the running cycle
    bool running = false;
    bool extended = false;  ///< the running cycle, by extend_cycle()
    std::uint32_t exchange = 0;
    SteadyTime not_before{};            ///< of the running cycle's next step
    std::chrono::nanoseconds used{0};   ///< by the running cycle
    std::chrono::nanoseconds usual{0};  ///< by a whole cycle, smoothed; 0: none has ended
    double polls_owed = 0;              ///< below 1: what stretched intervals have not yet counted
    bool off_grid = false;              ///< stretched intervals have taken it off the common grid
  };

  static SteadyTime begins_at(const Group& group);
  static SteadyTime deadline_of(const Group& group);
  /// The due group that goes first, or none.
  Group* most_urgent(SteadyTime now);
  PollStep begin_or_continue(Group& group, SteadyTime now);
  void begin_ahead(Group& group, SteadyTime now);
  void begin_by_interval(Group& group, SteadyTime now);
  /// The most poll time that next() puts before or between commands of `line_time` in all, what is
  /// owed to the polls already included, if the longest poll exchange takes `longest_poll`.
  std::chrono::nanoseconds polls_between(std::chrono::nanoseconds line_time,
                                         std::chrono::nanoseconds longest_poll) const;
  SteadyTime next_wake() const;

  double poll_share_;
  std::uint32_t commands_ = 0;
  std::chrono::nanoseconds owed_to_polls_{0};
  std::vector<Device> devices_;
  std::vector<Group> groups_;
};

}  // namespace fxagent
