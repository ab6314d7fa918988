#include "agent/field/poll/group_schedule.h"

#include <utility>

namespace fxagent {
namespace {

using std::chrono::milliseconds;
using std::chrono::nanoseconds;

// A group without an interval uses what is left: its deadline is as far away as a slow group's.
constexpr std::chrono::seconds kPeriodOfFreeRunning{1};
// The line time of a cycle is smoothed over about this many cycles.
constexpr int kSmoothing = 8;
// After a refused exchange, other groups go first if they are due within this many times its line
// time.
constexpr int kGivesWay = 4;

nanoseconds period(nanoseconds interval) {
  return interval.count() > 0 ? interval : nanoseconds(kPeriodOfFreeRunning);
}

/// Returns `usual` moved towards `next`. 0: nothing was measured before.
nanoseconds smoothed(nanoseconds usual, nanoseconds next) {
  return usual.count() == 0 ? next : usual + (next - usual) / kSmoothing;
}

}  // namespace

milliseconds grid_of(milliseconds interval) {
  for (const milliseconds grid :
       {milliseconds(10), milliseconds(5), milliseconds(2), milliseconds(1)})
    if (grid * 100 <= interval && interval % grid == milliseconds(0)) return grid;
  return milliseconds(0);
}

SteadyTime on_grid(SteadyTime due, milliseconds interval) {
  const milliseconds grid = grid_of(interval);
  if (grid.count() == 0) return due;
  const auto beyond = due.time_since_epoch() % grid;
  return beyond.count() == 0 ? due : due - beyond + grid;
}

GroupSchedule::GroupSchedule(milliseconds interval, std::uint32_t exchanges, SteadyTime first_due,
                             milliseconds within)
    : interval_(interval),
      within_(within.count() > 0 ? within : period(interval)),
      exchanges_(std::max<std::uint32_t>(exchanges, 1)),
      due_(first_due) {}

std::uint64_t GroupSchedule::set_interval(milliseconds interval, SteadyTime now) {
  const bool has_missed = interval_.count() > 0 && due_ < now;
  const auto missed = has_missed ? static_cast<std::uint64_t>((now - due_) / interval_) : 0;
  due_ = on_grid(std::clamp(due_, now, now + interval), interval);
  interval_ = interval;
  within_ = period(interval);
  polls_owed_ = 0;
  return missed;
}

void GroupSchedule::set_exchanges(std::uint32_t exchanges) {
  exchanges_ = std::max<std::uint32_t>(exchanges, 1);
  exchange_ = 0;
}

nanoseconds GroupSchedule::read_at_once(SteadyTime from) {
  if (running_) return {};
  at_once_ = std::min(at_once_.value_or(from), from);
  return 2 * usual_;
}

void GroupSchedule::forget_until(SteadyTime now) {
  running_ = false;
  began_.reset();
  if (due_ >= now) return;
  due_ = interval_.count() == 0
             ? now
             : due_ + (now - due_ + interval_ - nanoseconds(1)) / interval_ * interval_;
}

std::uint64_t GroupSchedule::begin(SteadyTime now, double load) {
  std::uint64_t missed = 0;
  if (is_due_by_interval(now)) {
    missed = begin_by_interval(now, std::max(1.0, load));
  } else if (due_ > now) {
    deadline_ = deadline();
    // A regular cycle that would follow at once is skipped: this one has read ahead.
    if (due_ - now < interval_ / 2) due_ += interval_;
  } else {
    deadline_ = now + kPeriodOfFreeRunning;
    due_ = now;
  }
  if (began_) reached_ = smoothed(reached_, now - *began_);
  began_ = now;
  at_once_.reset();
  running_ = true;
  exchange_ = 0;
  not_before_ = {};
  used_ = {};
  extended_ = false;
  return missed;
}

std::uint64_t GroupSchedule::begin_by_interval(SteadyTime now, double stretch) {
  const nanoseconds interval(
      static_cast<std::int64_t>(static_cast<double>(interval_.count()) * stretch));
  // Whole poll intervals that have passed are skipped. A stretched interval has no place to keep:
  // the next one follows at once, or the line would be idle for the rest of it.
  const SteadyTime this_due =
      stretch > 1.0 ? std::max(due_, now - interval) : due_ + (now - due_) / interval * interval;
  const auto passed = static_cast<double>((this_due - due_).count()) +
                      static_cast<double>((interval - interval_).count());
  polls_owed_ += passed / static_cast<double>(interval_.count());
  const auto missed = static_cast<std::uint64_t>(polls_owed_);
  polls_owed_ -= static_cast<double>(missed);
  deadline_ = this_due + std::min(within_, interval);
  due_ = this_due + interval;
  if (stretch > 1.0)
    off_grid_ = true;
  else if (std::exchange(off_grid_, false))
    due_ = on_grid(due_, std::chrono::duration_cast<milliseconds>(interval));
  return missed;
}

void GroupSchedule::extend_cycle(std::uint32_t exchanges, nanoseconds line_time, SteadyTime now) {
  exchanges_ = std::max(exchanges_, exchanges);
  deadline_ = std::max(deadline_, now) + kGivesWay * line_time;
  extended_ = true;
}

bool GroupSchedule::step_done(std::uint32_t exchange) {
  if (!running_) return true;
  exchange_ = exchange + 1;
  if (exchange_ < exchanges_) return false;
  running_ = false;
  if (extended_) return true;
  usual_ = smoothed(usual_, used_);
  return true;
}

void GroupSchedule::abandon_cycle(SteadyTime not_before) {
  running_ = false;
  if (interval_.count() == 0) due_ = std::max(due_, not_before);
}

}  // namespace fxagent
