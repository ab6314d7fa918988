// The bound on commands, as a property test: random lines in fake time are checked against the
// contract. The same check must detect schedulers that break the bound.
#include <gtest/gtest.h>

#include <algorithm>
#include <deque>
#include <random>

#include "agent/field/poll/poll_scheduler.h"

namespace fxagent::test {
namespace {

using std::chrono::milliseconds;
using std::chrono::nanoseconds;
using Kind = PollScheduler::Job::Kind;

const SteadyTime kStart{std::chrono::hours(1000)};
const SteadyTime kTooLate = kStart + std::chrono::hours(1);
constexpr BackOff kBackOff{milliseconds(1000), milliseconds(4000)};

/// Base of the deliberately wrong schedulers. Hides waiting commands from the real scheduler, so
/// that their only priority is the one given by next().
class WithoutPriority {
 public:
  explicit WithoutPriority(double share) : inner_(share) {}
  PollScheduler::DeviceId add_device(int limit, BackOff back_off) {
    return inner_.add_device(limit, back_off);
  }
  PollScheduler::GroupId add_group(PollScheduler::DeviceId device, milliseconds interval,
                                   std::uint32_t exchanges, SteadyTime due) {
    return inner_.add_group(device, interval, exchanges, due);
  }
  WithoutPriority& share() { return *this; }
  void command_waits() { ++commands_; }
  void command_taken() { --commands_; }
  void command_used(nanoseconds, SteadyTime) {}
  void poll_used(nanoseconds) {}
  void step_used(const PollScheduler::PollStep& step, nanoseconds time) {
    inner_.step_used(step, time);
  }
  bool step_done(const PollScheduler::PollStep& step) {
    const bool ended = inner_.step_done(step);
    inside_a_cycle_ = !ended;
    return ended;
  }
  /// Called only to abandon the group's cycle.
  GroupSchedule& group(PollScheduler::GroupId id) {
    inside_a_cycle_ = false;
    return inner_.group(id);
  }
  nanoseconds bound(nanoseconds own, nanoseconds ahead, nanoseconds longest) {
    return inner_.share().bound(own, ahead, longest);
  }
  nanoseconds bound_giving_way(nanoseconds own, nanoseconds ahead, nanoseconds longest) {
    return inner_.share().bound_giving_way(own, ahead, longest);
  }

 protected:
  static PollScheduler::Job command() {
    PollScheduler::Job job;
    job.kind = Kind::command;
    return job;
  }

  PollScheduler inner_;
  std::uint32_t commands_ = 0;
  bool inside_a_cycle_ = false;
};

/// Commands wait until no poll is due.
class PollsFirst final : public WithoutPriority {
 public:
  using WithoutPriority::WithoutPriority;
  PollScheduler::Job next(SteadyTime now) {
    const PollScheduler::Job job = inner_.next(now);
    return job.kind == Kind::wait && commands_ > 0 ? command() : job;
  }
};

/// Commands wait until the current cycle has ended.
class WholeCycles final : public WithoutPriority {
 public:
  using WithoutPriority::WithoutPriority;
  PollScheduler::Job next(SteadyTime now) {
    return commands_ > 0 && !inside_a_cycle_ ? command() : inner_.next(now);
  }
};

struct Findings {
  int commands = 0;
  int late_commands = 0;   ///< queue + wire took longer than the given bound
  int wrong_polls = 0;     ///< not the due group with the earliest deadline
  int lists = 0;           ///< commands that yield between their parts
  int went_between = 0;    ///< commands carried out between two parts of a list
  int bursts = 0;          ///< a group began two cycles within one interval
  int starved_groups = 0;  ///< fewer cycles than unobstructed intervals
  double tightest = 0;     ///< the largest fraction of a bound that was used
  std::string example;
};

/// The load on a line.
enum class LineKind : std::uint8_t {
  steady,  ///< exchanges take the planned time and the load is not measured: the order of the
           ///< polls is predictable
  rough,   ///< groups without an interval, overload, exchanges that are shorter than planned,
           ///< repeated or abandoned
};

/// A literal implementation of the rules for groups, independent of the scheduler's.
struct NaiveGroup {
  nanoseconds interval{0};
  std::uint32_t exchanges = 1;
  SteadyTime first{};
  std::vector<nanoseconds> durations;
  std::optional<std::int64_t> last_due;
  bool running = false;
  SteadyTime deadline{};
  std::int64_t cycles = 0;

  std::int64_t interval_at(SteadyTime now) const { return (now - first) / interval; }
  bool due(SteadyTime now) const {
    if (running) return true;
    if (now < first) return false;
    return !last_due || interval_at(now) > *last_due;
  }
  SteadyTime deadline_at() const {
    if (running) return deadline;
    return first + (last_due.value_or(-1) + 2) * interval;
  }
  void begin(SteadyTime now) {
    last_due = interval_at(now);
    deadline = first + (*last_due + 1) * interval;
    running = true;
    ++cycles;
  }
};

/// One line with its groups, clock and queue, driving `Subject` as a link worker does.
template <class Subject>
class RandomLine final {
 public:
  RandomLine(std::uint32_t seed, LineKind kind)
      : seed_(seed), kind_(kind), random_(seed), share_(between(0, 4) * 0.1), scheduler_(share_) {
    const int devices = between(1, 3);
    for (int d = 0; d < devices; ++d) {
      const auto device = scheduler_.add_device(3, kBackOff);
      for (int g = between(1, 3); g > 0; --g) add_group(device);
    }
  }

  Findings run(int arrivals) {
    left_ = arrivals;
    next_arrival_ = kStart + milliseconds(between(0, 100));
    while (left_ > 0 || !waiting_.empty()) {
      if (now_ > kTooLate) {  // the queue needs only minutes
        found_.late_commands += static_cast<int>(waiting_.size());
        return found_;
      }
      arrive(now_);
      const PollScheduler::Job job = scheduler_.next(now_);
      if (job.kind == Kind::command) {
        carry_out();
      } else if (job.kind == Kind::poll) {
        poll(job.poll);
      } else {
        now_ = std::max(left_ > 0 ? std::min(job.until, next_arrival_) : job.until, now_);
      }
    }
    look_for_starved_groups();
    return found_;
  }

 private:
  struct AdmittedCommand {
    SteadyTime arrived{};
    nanoseconds planned{0};
    nanoseconds bound{0};
    int parts = 1;  ///< more than 1: yields between them
  };

  int between(int low, int high) { return std::uniform_int_distribution<int>(low, high)(random_); }

  void add_group(PollScheduler::DeviceId device) {
    NaiveGroup group;
    const bool free_running = kind_ == LineKind::rough && between(0, 3) == 0;
    group.interval = milliseconds(free_running ? 0 : between(50, 3000));
    group.exchanges = static_cast<std::uint32_t>(between(1, 4));
    group.first = kStart + milliseconds(between(0, 500));
    for (std::uint32_t e = 0; e < group.exchanges; ++e)
      group.durations.push_back(milliseconds(between(5, 60)));
    for (const nanoseconds duration : group.durations) longest_ = std::max(longest_, duration);
    scheduler_.add_group(device, std::chrono::duration_cast<milliseconds>(group.interval),
                         group.exchanges, group.first);
    groups_.push_back(std::move(group));
  }

  /// Returns the actual duration of an exchange: never more than planned, as on a healthy line.
  nanoseconds real(nanoseconds planned) {
    if (kind_ == LineKind::steady || between(0, 2) == 0) return planned;
    return planned * between(30, 100) / 100;
  }

  /// Generates the arrivals up to `until`; bursts and quiet times alternate.
  void arrive(SteadyTime until) {
    while (left_ > 0 && next_arrival_ <= until) {
      AdmittedCommand admitted;
      admitted.arrived = next_arrival_;
      admitted.planned = milliseconds(between(0, 30) == 0 ? between(500, 3000) : between(5, 80));
      nanoseconds ahead = running_;
      for (const AdmittedCommand& other : waiting_) ahead += other.planned;
      if (between(0, 9) == 0) {
        admitted.parts = between(2, 20);
        admitted.planned *= admitted.parts;
      }
      admitted.bound = admitted.parts > 1
                           ? scheduler_.share().bound_giving_way(admitted.planned, ahead, longest_)
                           : scheduler_.share().bound(admitted.planned, ahead, longest_);
      waiting_.push_back(admitted);
      scheduler_.share().command_waits();
      --left_;
      if (--burst_ < 0) {
        if (between(0, 30) == 0) burst_ = between(5, 25);
        next_arrival_ += milliseconds(between(0, 3) > 0 ? between(0, 20) : between(50, 1500));
      }
    }
  }

  void carry_out() {
    const AdmittedCommand admitted = waiting_.front();
    waiting_.pop_front();
    scheduler_.share().command_taken();
    ++found_.commands;
    found_.lists += admitted.parts > 1;
    running_ += admitted.planned;
    const nanoseconds part = admitted.planned / admitted.parts;
    credits_.emplace_back(0);
    for (int done = 1; done <= admitted.parts; ++done) {
      const nanoseconds wire = real(part);
      now_ += wire;
      arrive(now_ - nanoseconds(1));
      if (done == admitted.parts) running_ -= admitted.planned;
      if (done < admitted.parts) scheduler_.share().command_waits();
      scheduler_.command_used(wire, now_);
      credits_.back() += part;
      if (done < admitted.parts) give_way();
    }
    credits_.pop_back();
    const nanoseconds took = now_ - admitted.arrived;  // queue + wire
    found_.tightest = std::max(found_.tightest, static_cast<double>(took.count()) /
                                                    static_cast<double>(admitted.bound.count()));
    if (took <= admitted.bound) return;
    ++found_.late_commands;
    found_.example = "seed " + std::to_string(seed_) + ": through after " +
                     std::to_string(took / milliseconds(1)) + " ms, bound " +
                     std::to_string(admitted.bound / milliseconds(1)) + " ms";
  }

  /// Yields between two parts of a command, as the link's worker does.
  void give_way() {
    while (now_ < kTooLate) {
      const PollScheduler::Job job = scheduler_.next(now_);
      if (job.kind == Kind::poll) {
        poll(job.poll);
        continue;
      }
      const nanoseconds credit = *std::min_element(credits_.begin(), credits_.end());
      if (waiting_.empty() || waiting_.front().planned > credit) break;
      for (nanoseconds& each : credits_) each -= waiting_.front().planned;
      ++found_.went_between;
      carry_out();
    }
    scheduler_.share().command_taken();
  }

  void poll(const PollScheduler::PollStep& step) {
    NaiveGroup& group = groups_[step.group];
    if (kind_ == LineKind::steady) judge(group, step);
    const nanoseconds took = real(group.durations[step.exchange]);
    now_ += took;
    arrive(now_ - nanoseconds(1));
    if (kind_ == LineKind::steady) {
      scheduler_.share().poll_used(took);
      if (scheduler_.step_done(step)) group.running = false;
      return;
    }
    scheduler_.step_used(step, took);
    const int luck = between(0, 19);
    if (luck == 0)
      scheduler_.group(step.group).abandon_cycle(now_);
    else if (luck > 1)  // at 1 the answer was garbled: repeats the step
      scheduler_.step_done(step);
  }

  void judge(NaiveGroup& group, const PollScheduler::PollStep& step) {
    const bool wrong = std::any_of(groups_.begin(), groups_.end(), [&](const NaiveGroup& other) {
      return !group.due(now_) || (other.due(now_) && other.deadline_at() < group.deadline_at());
    });
    found_.wrong_polls += wrong;
    if (!step.starts_cycle) return;
    found_.bursts += group.last_due && group.interval_at(now_) <= *group.last_due;
    group.begin(now_);
  }

  void look_for_starved_groups() {
    // If polls have a fifth of the line or more, every group must be polled eventually.
    if (kind_ != LineKind::steady || share_ < 0.2) return;
    for (const NaiveGroup& group : groups_)
      found_.starved_groups += (now_ - group.first) / group.interval >= 20 && group.cycles == 0;
  }

  const std::uint32_t seed_;
  const LineKind kind_;
  std::mt19937 random_;
  const double share_;
  Subject scheduler_;
  std::vector<NaiveGroup> groups_;
  nanoseconds longest_{0};  ///< poll exchange
  std::deque<AdmittedCommand> waiting_;
  /// Line time used by each running command, minus the commands that ran between its parts.
  std::vector<nanoseconds> credits_;
  nanoseconds running_{0};  ///< planned line time of the running commands
  SteadyTime now_ = kStart;
  SteadyTime next_arrival_{};
  int left_ = 0;
  int burst_ = 0;  ///< number of further arrivals at the same moment
  Findings found_;
};

TEST(PollSchedulerBound, EveryCommandIsInsideItAndEveryPollIsTheRightOne) {
  int commands = 0;
  int lists = 0;
  int went_between = 0;
  double tightest = 0;
  for (std::uint32_t seed = 1; seed <= 100; ++seed) {
    const Findings found = RandomLine<PollScheduler>(seed, LineKind::steady).run(200);
    commands += found.commands;
    lists += found.lists;
    went_between += found.went_between;
    tightest = std::max(tightest, found.tightest);
    EXPECT_EQ(found.late_commands, 0) << found.example;
    EXPECT_EQ(found.wrong_polls, 0) << "seed " << seed;
    EXPECT_EQ(found.bursts, 0) << "seed " << seed;
    EXPECT_EQ(found.starved_groups, 0) << "seed " << seed;
  }
  EXPECT_EQ(commands, 20000);
  EXPECT_GT(lists, 1000);
  EXPECT_GT(went_between, 1000);
  EXPECT_GT(tightest, 0.9) << "a bound that nothing comes near says little";
}

TEST(PollSchedulerBound, EveryCommandIsInsideItOnRoughAndOverloadedLines) {
  int commands = 0;
  for (std::uint32_t seed = 1; seed <= 100; ++seed) {
    const Findings found = RandomLine<PollScheduler>(seed, LineKind::rough).run(200);
    commands += found.commands;
    EXPECT_EQ(found.late_commands, 0) << found.example;
  }
  EXPECT_EQ(commands, 20000);
}

/// Returns on how many of 20 lines of each kind this scheduler breaks the bound.
template <class Subject>
int lines_with_late_commands() {
  int lines = 0;
  for (const LineKind kind : {LineKind::steady, LineKind::rough})
    for (std::uint32_t seed = 1; seed <= 20; ++seed)
      lines += RandomLine<Subject>(seed, kind).run(200).late_commands > 0;
  return lines;
}

TEST(PollSchedulerBound, TheCheckFindsAnAgendaThatPutsCommandsBehindPolls) {
  EXPECT_EQ(lines_with_late_commands<PollScheduler>(), 0);
  EXPECT_GT(lines_with_late_commands<PollsFirst>(), 10);
}

TEST(PollSchedulerBound, TheCheckFindsAnAgendaThatLetsCyclesEndFirst) {
  EXPECT_GT(lines_with_late_commands<WholeCycles>(), 10);
}

}  // namespace
}  // namespace fxagent::test
