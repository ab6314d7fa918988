// Decides what a link does next: a waiting command, the most urgent poll, or nothing until a time.
// Pure: time is an argument, no I/O. Field thread.
#pragma once

#include <chrono>
#include <cstdint>
#include <vector>

#include "agent/field/poll/group_schedule.h"
#include "agent/field/poll/line_share.h"
#include "agent/field/poll/polled_device.h"
#include "agent/steady_time.h"

namespace fxagent {

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
  /// Removes the device and its groups. Their ids may be reused. None of its steps may be in
  /// progress.
  void remove_device(DeviceId device);
  /// The schedule of a group. Valid until the next add_group().
  GroupSchedule& group(GroupId id) { return groups_[id].schedule; }

  /// Returns the job to run now, or until when to wait. Not a query: the cycle of a poll with
  /// `starts_cycle` has begun, and the same exchange is offered again until step_done(), or until
  /// the cycle ends otherwise. Waiting commands come first, except for the polls' share; then the
  /// due group with the earliest deadline whose device is not in back-off. A
  /// running cycle goes on with its next exchange by the same rule. A late cycle does not move the
  /// later ones: missed intervals are skipped and counted, never sent in a burst. If the groups ask
  /// for more than the whole line, all intervals are stretched by the same factor.
  Job next(SteadyTime now);

  /// Records that the step was carried out. True: the cycle has ended.
  bool step_done(const PollStep& step) {
    return groups_[step.group].schedule.step_done(step.exchange);
  }

  /// Schedules one extra cycle at or soon after `from` for each group of the device that is not
  /// being read. The intervals stay as they are. The cycles are spread so that half of the line is
  /// left to others. Returns when those of another device may follow.
  SteadyTime read_at_once(DeviceId device, SteadyTime from);
  /// Ends the running cycles, and forgets the polls that were due until now: nothing was to be
  /// read. Groups are read again when they are next due.
  void forget_until(SteadyTime now);

  /// Records line time used by a command; the polls' share depends on it.
  void command_used(std::chrono::nanoseconds line_time, SteadyTime now);
  /// Records line time used by an exchange of a group. Also measures the line time of its cycles.
  void step_used(const PollStep& step, std::chrono::nanoseconds line_time);
  /// Returns the part of the line that the groups' intervals ask for, by the measured line time of
  /// their cycles. Above 1 the line is overloaded. Groups without an interval and silent devices do
  /// not count.
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
  };

  /// Returns the due group that goes first, or null.
  Group* most_urgent(SteadyTime now);
  SteadyTime next_wake() const;

  LineShare share_;
  std::vector<Device> devices_;
  std::vector<Group> groups_;
};

}  // namespace fxagent
