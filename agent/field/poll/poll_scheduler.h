// Decides what a link does next: a waiting command, the most urgent poll, or nothing until a time.
// Pure: time is an argument, no I/O. Field thread.
#pragma once

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <optional>
#include <vector>

#include "agent/field/poll/group_schedule.h"
#include "agent/field/poll/line_share.h"
#include "agent/field/poll/polled_device.h"
#include "agent/steady_time.h"

namespace fxagent {

/// The scheduler of one link, whose loop calls next(), carries out the job and records it: a poll
/// with step_used() and step_done(), a command with share() and command_used(). Three rules decide,
/// in this sequence:
/// 1. After a silence, due polls of devices that answer go first, for at most its length.
/// 2. Waiting commands go next, except for the polls' share of the line time (LineShare).
/// 3. The due group with the earliest deadline goes next, unless it or its device rests.
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
  /// the cycle. A running cycle goes on with its next exchange by the same three rules. A late
  /// cycle does not move the later ones: missed intervals are skipped and counted, never sent in a
  /// burst. If the groups ask for more than the whole line, all intervals are stretched by the same
  /// factor.
  Job next(SteadyTime now);
  /// Returns a poll that goes first after a silence (rule 1), and begins its cycle as next() does.
  /// Nullopt: the time for it is used up, or no such poll is due. That ends the precedence.
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
