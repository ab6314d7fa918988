// The schedule of one group: when its cycles are due, the deadline of the running one, and the line
// time that a cycle takes. Pure: time is an argument, no I/O. Field thread.
#pragma once

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <optional>

#include "agent/steady_time.h"

namespace fxagent {

// A grid aligns the polls of many links: one wake-up of the thread sends all requests that are due,
// and receives their answers together.

/// Returns the grid for groups with this interval: 10, 5, 2 or 1 ms. It is the largest that divides
/// the interval and is at most 1/100 of it, so that later cycles stay on the grid unless an
/// overload stretches the interval. Returns 0 for an interval below 100 ms: such groups begin at
/// any time.
std::chrono::milliseconds grid_of(std::chrono::milliseconds interval);

/// Returns the first grid time of `interval` at or after `due`. The grids of all links have the
/// same origin.
SteadyTime on_grid(SteadyTime due, std::chrono::milliseconds interval);

class GroupSchedule final {
 public:
  /// See PollScheduler::add_group().
  GroupSchedule(std::chrono::milliseconds interval, std::uint32_t exchanges, SteadyTime first_due,
                std::chrono::milliseconds within);
  /// See PollScheduler::set_interval(). Returns the number of polls missed by the old interval.
  std::uint64_t set_interval(std::chrono::milliseconds interval, SteadyTime now);
  /// Sets the number of exchanges of a new plan. A running cycle begins anew.
  void set_exchanges(std::uint32_t exchanges);

  /// Returns the earliest time of the next exchange.
  SteadyTime begins_at() const {
    if (running_) return not_before_;
    return at_once_ ? std::min(*at_once_, due_) : due_;
  }
  /// Returns the deadline of the running cycle, or of the next one.
  SteadyTime deadline() const {
    if (running_) return deadline_;
    const SteadyTime by_interval = due_ + within_;
    if (!at_once_) return by_interval;
    return std::min(by_interval, *at_once_ + std::min(within_, kAtOnceWithin));
  }
  /// Returns when the next cycle is due by the interval.
  SteadyTime next_due() const { return due_; }
  /// Schedules one cycle at or soon after `from`, unless one is running. Returns the time until
  /// another group may follow, so that half of the line is left to others.
  std::chrono::nanoseconds read_at_once(SteadyTime from);

  /// See PollScheduler::forget_until().
  void forget_until(SteadyTime now);

  /// Returns the smoothed time between the last polls; 0: there were not two yet.
  std::chrono::nanoseconds reached() const { return reached_; }

  bool is_running() const { return running_; }
  /// Returns the index of the running cycle's next exchange.
  std::uint32_t exchange() const { return exchange_; }
  /// True if a cycle that begins now is due by an interval. Then begin() depends on the load.
  bool is_due_by_interval(SteadyTime now) const { return interval_.count() > 0 && due_ <= now; }
  /// Begins a cycle. A `load` of the line above 1 stretches the interval by this factor. Returns
  /// the number of polls that were skipped.
  std::uint64_t begin(SteadyTime now, double load);
  /// Extends the running cycle to `exchanges` in total after its last exchange, of `line_time`, was
  /// refused. Moves its deadline by a multiple of that time, so that other groups keep their part
  /// of the line during a long search for what is missing. The cycle does not count as a
  /// measurement of the group's line time.
  void extend_cycle(std::uint32_t exchanges, std::chrono::nanoseconds line_time, SteadyTime now);
  void used(std::chrono::nanoseconds line_time) { used_ += line_time; }
  /// Records that this exchange was carried out. True: the cycle has ended.
  bool step_done(std::uint32_t exchange);
  /// Offers the same exchange again, but not before `not_before`: the device is busy.
  void postpone(SteadyTime not_before) { not_before_ = not_before; }
  /// Gives up the rest of the cycle until the next one is due. A group without an interval rests
  /// until `not_before`, so that a failure that used no line time is not repeated at once.
  void abandon_cycle(SteadyTime not_before);

  /// Returns the part of the line that the interval asks for; 0 without an interval.
  double load() const {
    if (interval_.count() == 0) return 0;
    return static_cast<double>(usual_.count()) / static_cast<double>(interval_.count());
  }

 private:
  /// Longest deadline of a cycle that runs ahead of its interval.
  static constexpr std::chrono::nanoseconds kAtOnceWithin = std::chrono::seconds(1);

  std::uint64_t begin_by_interval(SteadyTime now, double stretch);

  std::chrono::nanoseconds interval_;  ///< 0: as fast as the line allows
  std::chrono::nanoseconds within_;
  std::uint32_t exchanges_;
  SteadyTime due_;                     ///< of the next cycle
  std::optional<SteadyTime> at_once_;  ///< of an extra cycle before it
  SteadyTime deadline_{};              ///< of the running cycle
  bool running_ = false;
  bool extended_ = false;  ///< extend_cycle() was called for the running cycle
  std::uint32_t exchange_ = 0;
  SteadyTime not_before_{};            ///< of the running cycle's next exchange
  std::chrono::nanoseconds used_{0};   ///< line time of the running cycle
  std::chrono::nanoseconds usual_{0};  ///< line time of a whole cycle, smoothed; 0: none has ended
  double polls_owed_ = 0;              ///< below 1: misses of stretched intervals, not yet counted
  std::optional<SteadyTime> began_{};  ///< the last cycle
  std::chrono::nanoseconds reached_{0};  ///< time between two cycles, smoothed; 0: not known
  bool off_grid_ = false;                ///< stretched intervals have moved it off the common grid
};

}  // namespace fxagent
