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
  if (const auto first = next_after_silence(now)) return {Job::Kind::poll, *first};
  Group* group = most_urgent(now);
  if (share_.command_goes_first(group != nullptr)) return {Job::Kind::command, {}};
  if (group == nullptr) return {Job::Kind::wait, {}, next_wake()};
  return {Job::Kind::poll, next_step(*group, now)};
}

std::optional<PollScheduler::PollStep> PollScheduler::next_after_silence(SteadyTime now) {
  const bool has_time = after_silence_.value_or(std::chrono::nanoseconds(0)).count() > 0;
  if (Group* group = has_time ? most_urgent(now, Of::answering) : nullptr)
    return next_step(*group, now);
  after_silence_.reset();
  return std::nullopt;
}

PollScheduler::PollStep PollScheduler::next_step(Group& group, SteadyTime now) {
  PollStep step;
  step.group = static_cast<GroupId>(&group - groups_.data());
  GroupSchedule& schedule = group.schedule;
  if (!schedule.is_running()) {
    step.starts_cycle = true;
    step.late = now - schedule.begins_at();
    // load() visits every group.
    const double line_load = schedule.is_due_by_interval(now) ? load() : 0;
    device(group.device).missed(schedule.begin(now, line_load));
    device(group.device).cycle_begun();
  }
  step.exchange = schedule.exchange();
  return step;
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

void PollScheduler::was_silent(DeviceId device, std::chrono::nanoseconds lasted,
                               PolledDevice::AskedBy by) {
  // Otherwise polls with silences among them would go first without end.
  if (after_silence_ && by == PolledDevice::AskedBy::poll) return;
  after_silence_ = lasted;
  last_silent_ = device;
}

void PollScheduler::command_used(std::chrono::nanoseconds line_time, SteadyTime now) {
  if (share_.commands_waiting() > 0 && most_urgent(now) != nullptr) share_.polls_waited(line_time);
}

void PollScheduler::poll_used(std::chrono::nanoseconds line_time) {
  // The time after a silence is no part of the share.
  if (after_silence_) {
    const auto given = std::clamp(*after_silence_, std::chrono::nanoseconds(0), line_time);
    *after_silence_ -= given;
    line_time -= given;
  }
  share_.poll_used(line_time);
}

void PollScheduler::step_used(const PollStep& step, std::chrono::nanoseconds line_time) {
  poll_used(line_time);
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
