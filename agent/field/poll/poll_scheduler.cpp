#include "agent/field/poll/poll_scheduler.h"

#include <algorithm>
#include <utility>

#include "agent/field/poll/poll_grid.h"

namespace fxagent {
namespace {

// A group without an interval uses what is left: its deadline is as far away as a slow group's.
constexpr std::chrono::seconds kPeriodOfFreeRunning{1};
// Longest deadline of a cycle that runs ahead of its interval.
constexpr std::chrono::nanoseconds kAtOnceWithin = std::chrono::seconds(1);
// The line time of a cycle is smoothed over about this many cycles.
constexpr int kSmoothing = 8;
// After a refused exchange, other groups go first if they are due within this many times its line
// time.
constexpr int kGivesWay = 4;

std::chrono::nanoseconds period(std::chrono::nanoseconds interval) {
  return interval.count() > 0 ? interval : std::chrono::nanoseconds(kPeriodOfFreeRunning);
}

/// Stores `element` in the first vacant place, or appends it. Returns the index.
template <class T>
std::size_t put(std::vector<T>& list, const T& element) {
  const auto vacant = std::ranges::find_if(list, [](const T& each) { return each.gone; });
  const auto place = static_cast<std::size_t>(vacant - list.begin());
  if (vacant == list.end())
    list.push_back(element);
  else
    *vacant = element;
  return place;
}

}  // namespace

PollScheduler::DeviceId PollScheduler::add_device(int unanswered_limit, BackOff back_off) {
  Device device;
  device.unanswered_limit = unanswered_limit;
  device.back_off = back_off;
  return static_cast<DeviceId>(put(devices_, device));
}

PollScheduler::GroupId PollScheduler::add_group(DeviceId device, std::chrono::milliseconds interval,
                                                std::uint32_t exchanges, SteadyTime first_due,
                                                std::chrono::milliseconds within) {
  Group group;
  group.device = device;
  group.interval = interval;
  group.within = within.count() > 0 ? within : period(interval);
  group.exchanges = std::max<std::uint32_t>(exchanges, 1);
  group.due = first_due;
  return static_cast<GroupId>(put(groups_, group));
}

void PollScheduler::set_interval(GroupId id, std::chrono::milliseconds interval, SteadyTime now) {
  Group& group = groups_[id];
  if (group.interval.count() > 0 && group.due < now)
    devices_[group.device].counters.missed +=
        static_cast<std::uint64_t>((now - group.due) / group.interval);
  group.due = on_grid(std::clamp(group.due, now, now + interval), interval);
  group.interval = interval;
  group.within = period(interval);
  group.polls_owed = 0;
}

void PollScheduler::remove_device(DeviceId id) {
  devices_[id].gone = true;
  for (Group& group : groups_)
    if (group.device == id) group.gone = true;
}

void PollScheduler::set_exchanges(GroupId id, std::uint32_t exchanges) {
  Group& group = groups_[id];
  group.exchanges = std::max<std::uint32_t>(exchanges, 1);
  group.exchange = 0;
}

void PollScheduler::extend_cycle(GroupId id, std::uint32_t exchanges,
                                 std::chrono::nanoseconds line_time, SteadyTime now) {
  Group& group = groups_[id];
  group.exchanges = std::max(group.exchanges, exchanges);
  group.deadline = std::max(group.deadline, now) + kGivesWay * line_time;
  group.extended = true;
}

SteadyTime PollScheduler::begins_at(const Group& group) {
  if (group.running) return group.not_before;
  return group.at_once ? std::min(*group.at_once, group.due) : group.due;
}

SteadyTime PollScheduler::deadline_of(const Group& group) {
  if (group.running) return group.deadline;
  const SteadyTime by_interval = group.due + group.within;
  if (!group.at_once) return by_interval;
  return std::min(by_interval, *group.at_once + std::min(group.within, kAtOnceWithin));
}

PollScheduler::Group* PollScheduler::most_urgent(SteadyTime now) {
  Group* best = nullptr;
  SteadyTime best_deadline{};
  for (Group& group : groups_) {
    if (group.gone || begins_at(group) > now || devices_[group.device].rests_until > now) continue;
    const SteadyTime deadline = deadline_of(group);
    if (best != nullptr && deadline >= best_deadline) continue;
    best = &group;
    best_deadline = deadline;
  }
  return best;
}

/// Begins a cycle before its interval is over. The interval goes on as it was.
void PollScheduler::begin_ahead(Group& group, SteadyTime now) {
  group.deadline = deadline_of(group);
  // A regular cycle that would follow at once is skipped: this one has read ahead.
  if (group.due - now < group.interval / 2) group.due += group.interval;
}

void PollScheduler::begin_by_interval(Group& group, SteadyTime now) {
  if (group.interval.count() == 0) {
    group.deadline = now + kPeriodOfFreeRunning;
    group.due = now;
    return;
  }
  const double stretch = std::max(1.0, load());
  const std::chrono::nanoseconds interval(
      static_cast<std::int64_t>(static_cast<double>(group.interval.count()) * stretch));
  // Whole poll intervals that have passed are skipped. A stretched interval has no place to keep:
  // the next one follows at once, or the line would be idle for the rest of it.
  const SteadyTime this_due = stretch > 1.0 ? std::max(group.due, now - interval)
                                            : group.due + (now - group.due) / interval * interval;
  const auto passed = static_cast<double>((this_due - group.due).count()) +
                      static_cast<double>((interval - group.interval).count());
  group.polls_owed += passed / static_cast<double>(group.interval.count());
  const auto missed = static_cast<std::uint64_t>(group.polls_owed);
  group.polls_owed -= static_cast<double>(missed);
  devices_[group.device].counters.missed += missed;
  group.deadline = this_due + std::min(group.within, interval);
  group.due = this_due + interval;
  if (stretch > 1.0)
    group.off_grid = true;
  else if (std::exchange(group.off_grid, false))
    group.due = on_grid(group.due, std::chrono::duration_cast<std::chrono::milliseconds>(interval));
}

PollScheduler::PollStep PollScheduler::begin_or_continue(Group& group, SteadyTime now) {
  PollStep step;
  step.group = static_cast<GroupId>(&group - groups_.data());
  if (!group.running) {
    step.starts_cycle = true;
    step.late = now - begins_at(group);
    if (group.due > now)
      begin_ahead(group, now);
    else
      begin_by_interval(group, now);
    group.at_once.reset();
    group.running = true;
    group.exchange = 0;
    group.not_before = {};
    group.used = {};
    group.extended = false;
    ++devices_[group.device].counters.polls;
  }
  step.exchange = group.exchange;
  return step;
}

SteadyTime PollScheduler::next_wake() const {
  auto wake = SteadyTime::max();
  for (const Group& group : groups_)
    if (!group.gone)
      wake = std::min(wake, std::max(begins_at(group), devices_[group.device].rests_until));
  return wake;
}

PollScheduler::Job PollScheduler::next(SteadyTime now) {
  Job job;
  Group* group = most_urgent(now);
  const auto polls = group == nullptr ? LineShare::Polls::none_due : LineShare::Polls::due;
  if (share_.command_goes_first(polls)) {
    job.kind = Job::Kind::command;
  } else if (group != nullptr) {
    job.kind = Job::Kind::poll;
    job.poll = begin_or_continue(*group, now);
  } else {
    job.until = next_wake();
  }
  return job;
}

bool PollScheduler::step_done(const PollStep& step) {
  Group& group = groups_[step.group];
  if (!group.running) return true;
  group.exchange = step.exchange + 1;
  if (group.exchange < group.exchanges) return false;
  group.running = false;
  if (group.extended) return true;
  if (group.usual.count() == 0)
    group.usual = group.used;
  else
    group.usual += (group.used - group.usual) / kSmoothing;
  return true;
}

void PollScheduler::postpone(const PollStep& step, SteadyTime not_before) {
  groups_[step.group].not_before = not_before;
}

void PollScheduler::abandon_cycle(GroupId id, SteadyTime not_before) {
  Group& group = groups_[id];
  group.running = false;
  if (group.interval.count() == 0) group.due = std::max(group.due, not_before);
}

SteadyTime PollScheduler::read_at_once(DeviceId device, SteadyTime from) {
  for (Group& group : groups_) {
    if (group.device != device || group.gone || group.running) continue;
    group.at_once = std::min(group.at_once.value_or(from), from);
    from += 2 * group.usual;
  }
  return from;
}

void PollScheduler::command_used(std::chrono::nanoseconds line_time, SteadyTime now) {
  if (share_.commands_waiting() > 0 && most_urgent(now) != nullptr) share_.polls_waited(line_time);
}

void PollScheduler::step_used(const PollStep& step, std::chrono::nanoseconds line_time) {
  share_.poll_used(line_time);
  groups_[step.group].used += line_time;
}

double PollScheduler::load() const {
  double load = 0;
  for (const Group& group : groups_)
    if (!group.gone && group.interval.count() > 0 && !devices_[group.device].silent)
      load +=
          static_cast<double>(group.usual.count()) / static_cast<double>(group.interval.count());
  return load;
}

void PollScheduler::device_answered(DeviceId id) {
  Device& device = devices_[id];
  device.unanswered = 0;
  device.silent = false;
  device.delay = {};
  device.rests_until = {};
}

bool PollScheduler::device_unanswered(DeviceId id, SteadyTime now, AskedBy by) {
  Device& device = devices_[id];
  ++device.unanswered;
  if (device.unanswered < device.unanswered_limit) return false;
  if (device.silent && by == AskedBy::command) return true;
  device.silent = true;
  const auto doubled = std::max(device.back_off.first, device.delay * 2);
  device.delay = std::min(doubled, device.back_off.cap);
  device.rests_until = now + device.delay;
  return true;
}

}  // namespace fxagent
