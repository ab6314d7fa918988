#include "agent/field/poll/poll_scheduler.h"

#include <algorithm>

namespace fxagent {
namespace {

// Consecutive cycles with only invalid answers after which a group rests.
constexpr int kOnlyInvalid = 3;

/// Stores `element` in the first vacant place, or appends it. Returns the index.
template <class T>
std::uint32_t put(std::vector<T>& list, const T& element) {
  const auto vacant = std::ranges::find_if(list, [](const T& each) { return each.gone; });
  const auto place = static_cast<std::uint32_t>(vacant - list.begin());
  if (vacant == list.end())
    list.push_back(element);
  else
    *vacant = element;
  return place;
}

}  // namespace

PollScheduler::DeviceId PollScheduler::add_device(int unanswered_limit, BackOff back_off) {
  return put(devices_, Device{PolledDevice(unanswered_limit, back_off)});
}

PollScheduler::GroupId PollScheduler::add_group(DeviceId device, std::chrono::milliseconds interval,
                                                std::uint32_t exchanges, SteadyTime first_due,
                                                std::chrono::milliseconds within) {
  return put(groups_, Group{device, false, GroupSchedule(interval, exchanges, first_due, within)});
}

void PollScheduler::set_interval(GroupId id, std::chrono::milliseconds interval, SteadyTime now) {
  Group& group = groups_[id];
  device(group.device).missed(group.schedule.set_interval(interval, now));
}

void PollScheduler::remove_device(DeviceId id) {
  devices_[id].gone = true;
  for (Group& group : groups_)
    if (group.device == id) group.gone = true;
}

PollScheduler::Group* PollScheduler::most_urgent(SteadyTime now, Of devices) {
  Group* best = nullptr;
  SteadyTime best_deadline{};
  for (Group& group : groups_) {
    if (group.gone || group.schedule.begins_at() > now) continue;
    if (rests_until(group) > now) continue;
    if (devices == Of::answering &&
        (group.device == last_silent_ || device(group.device).is_silent()))
      continue;
    const SteadyTime deadline = group.schedule.deadline();
    if (best != nullptr && deadline >= best_deadline) continue;
    best = &group;
    best_deadline = deadline;
  }
  return best;
}

SteadyTime PollScheduler::next_wake() const {
  auto wake = SteadyTime::max();
  for (const Group& group : groups_) {
    if (group.gone) continue;
    wake = std::min(wake, std::max(group.schedule.begins_at(), rests_until(group)));
  }
  return wake;
}

PollScheduler::Job PollScheduler::next(SteadyTime now) {
  Job job;
  Group* group = after_silence_.count() > 0 ? most_urgent(now, Of::answering) : nullptr;
  if (group == nullptr) {
    after_silence_ = {};
    group = most_urgent(now);
    if (share_.command_goes_first(group != nullptr)) {
      job.kind = Job::Kind::command;
      return job;
    }
  }
  if (group == nullptr) {
    job.until = next_wake();
    return job;
  }
  job.kind = Job::Kind::poll;
  job.poll.group = static_cast<GroupId>(group - groups_.data());
  GroupSchedule& schedule = group->schedule;
  if (!schedule.is_running()) {
    job.poll.starts_cycle = true;
    job.poll.late = now - schedule.begins_at();
    // load() visits every group.
    const double line_load = schedule.is_due_by_interval(now) ? load() : 0;
    device(group->device).missed(schedule.begin(now, line_load));
    device(group->device).cycle_begun();
  }
  job.poll.exchange = schedule.exchange();
  return job;
}

void PollScheduler::forget_until(SteadyTime now) {
  for (Group& group : groups_) group.schedule.forget_until(now);
}

void PollScheduler::only_invalid(GroupId id, SteadyTime now) {
  Group& group = groups_[id];
  if (++group.only_invalid >= kOnlyInvalid) group.rest.begin(now, device(group.device).back_off());
}

void PollScheduler::had_valid(GroupId id) {
  groups_[id].only_invalid = 0;
  groups_[id].rest = {};
}

SteadyTime PollScheduler::read_at_once(DeviceId device, SteadyTime from) {
  for (Group& group : groups_) {
    if (group.device != device || group.gone) continue;
    group.rest.end(from);
    from += group.schedule.read_at_once(from);
  }
  return from;
}

void PollScheduler::was_silent(DeviceId device, std::chrono::nanoseconds lasted) {
  after_silence_ = std::max(after_silence_, lasted);
  last_silent_ = device;
}

void PollScheduler::command_used(std::chrono::nanoseconds line_time, SteadyTime now) {
  if (share_.commands_waiting() > 0 && most_urgent(now) != nullptr) share_.polls_waited(line_time);
}

void PollScheduler::step_used(const PollStep& step, std::chrono::nanoseconds line_time) {
  share_.poll_used(line_time);
  after_silence_ -= line_time;
  groups_[step.group].schedule.used(line_time);
}

double PollScheduler::load() const {
  double load = 0;
  for (const Group& group : groups_) {
    const bool rests =
        group.only_invalid >= kOnlyInvalid || devices_[group.device].polled.is_silent();
    if (!group.gone && !rests) load += group.schedule.load();
  }
  return load;
}

}  // namespace fxagent
