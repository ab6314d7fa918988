// Decides what a link does next: a waiting command, the most urgent poll, or nothing until a time.
// Pure: time is an argument, no I/O. Field thread.
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <vector>

#include "agent/field/poll/line_share.h"
#include "agent/steady_time.h"

namespace fxagent {

/// Rest of a silent device. Doubles from `first` to `cap` with each failed attempt.
struct BackOff {
  std::chrono::milliseconds first{1000};
  std::chrono::milliseconds cap{30000};
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
  struct Counters {
    std::uint64_t polls = 0;   ///< cycles begun
    std::uint64_t missed = 0;  ///< polls skipped because the line or the device was busy or silent
  };

  /// `poll_share`: see LineShare.
  explicit PollScheduler(double poll_share = 0.2) : share_(poll_share) {}
  /// The waiting commands, and what the polls may use next to them.
  LineShare& share() { return share_; }

  /// `unanswered_limit`: number of consecutive exchanges without an answer that makes the device
  /// silent.
  DeviceId add_device(int unanswered_limit, BackOff back_off);
  /// Adds a group polled every `interval` (0: as fast as the line allows), first at `first_due`. A
  /// cycle of 0 exchanges still takes one step. `within` is the deadline of a cycle after it was
  /// due (0: when the next one is due).
  GroupId add_group(DeviceId device, std::chrono::milliseconds interval, std::uint32_t exchanges,
                    SteadyTime first_due, std::chrono::milliseconds within = {});
  /// Polls the group every `interval` from now on (0 as above). A running cycle goes on; the next
  /// one is due when it was, or within `interval` if that is sooner.
  void set_interval(GroupId group, std::chrono::milliseconds interval, SteadyTime now);
  /// Removes the device and its groups. Their ids may be reused. None of its steps may be in
  /// progress.
  void remove_device(DeviceId device);
  void set_back_off(DeviceId device, BackOff back_off) { devices_[device].back_off = back_off; }
  /// Sets the number of exchanges of a new plan. A running cycle begins anew.
  void set_exchanges(GroupId group, std::uint32_t exchanges);
  /// Extends the running cycle to `exchanges` in total after its last exchange, of `line_time`, was
  /// refused. Moves its deadline by a multiple of that time, so that other groups keep their part
  /// of the line during a long search for what is missing. The cycle does not count as a
  /// measurement of its group's line time.
  void extend_cycle(GroupId group, std::uint32_t exchanges, std::chrono::nanoseconds line_time,
                    SteadyTime now);

  /// Returns the job to run now, or until when to wait. Waiting commands come first, except for the
  /// polls' share; then the due group with the earliest deadline whose device is not in back-off. A
  /// running cycle goes on with its next exchange by the same rule. A late cycle does not move the
  /// later ones: missed intervals are skipped and counted, never sent in a burst. If the groups ask
  /// for more than the whole line, all intervals are stretched by the same factor.
  Job next(SteadyTime now);

  /// Records that the step was carried out. True: the cycle has ended.
  bool step_done(const PollStep& step);
  /// Offers the same step again, but not before `not_before`: the device is busy.
  void postpone(const PollStep& step, SteadyTime not_before);
  /// Gives up the rest of the cycle until the next one is due. A group without an interval rests
  /// until `not_before`, so that a failure that used no line time is not repeated at once.
  void abandon_cycle(GroupId group, SteadyTime not_before);

  /// Schedules one extra cycle at or soon after `from` for each group of the device that is not
  /// being read. The intervals stay as they are. The cycles are spread so that half of the line is
  /// left to others. Returns when those of another device may follow.
  SteadyTime read_at_once(DeviceId device, SteadyTime from);
  /// Returns when the next cycle of the group is due by its interval.
  SteadyTime next_due(GroupId group) const { return groups_[group].due; }

  /// Records line time used by a command; the polls' share depends on it.
  void command_used(std::chrono::nanoseconds line_time, SteadyTime now);
  /// Records line time used by an exchange of a group. Also measures the line time of its cycles.
  void step_used(const PollStep& step, std::chrono::nanoseconds line_time);
  /// Returns the part of the line that the groups' intervals ask for, by the measured line time of
  /// their cycles. Above 1 the line is overloaded. Groups without an interval and silent devices do
  /// not count.
  double load() const;

  void device_answered(DeviceId device);
  enum class AskedBy : std::uint8_t { poll, command };
  /// Counts one more exchange without an answer. True if the device is silent now: its polls rest
  /// until the back-off has passed. Commands begin a rest and never extend one: a stream of them
  /// would keep the polls from finding that the tags are bad.
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
    std::optional<SteadyTime> at_once;  ///< of an extra cycle before it
    SteadyTime deadline{};              ///< of the running cycle
    bool running = false;
    bool extended = false;  ///< extend_cycle() was called for the running cycle
    std::uint32_t exchange = 0;
    SteadyTime not_before{};            ///< of the running cycle's next step
    std::chrono::nanoseconds used{0};   ///< line time of the running cycle
    std::chrono::nanoseconds usual{0};  ///< line time of a whole cycle, smoothed; 0: none has ended
    double polls_owed = 0;              ///< below 1: misses of stretched intervals, not yet counted
    bool off_grid = false;              ///< stretched intervals have moved it off the common grid
  };

  static SteadyTime begins_at(const Group& group);
  static SteadyTime deadline_of(const Group& group);
  /// Returns the due group that goes first, or null.
  Group* most_urgent(SteadyTime now);
  PollStep begin_or_continue(Group& group, SteadyTime now);
  void begin_ahead(Group& group, SteadyTime now);
  void begin_by_interval(Group& group, SteadyTime now);
  SteadyTime next_wake() const;

  LineShare share_;
  std::vector<Device> devices_;
  std::vector<Group> groups_;
};

}  // namespace fxagent
