#include "agent/field/poll/poll_scheduler.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>

namespace fxagent::test {
namespace {

using std::chrono::milliseconds;
using std::chrono::nanoseconds;
using Kind = PollScheduler::Job::Kind;

const SteadyTime kStart{std::chrono::hours(1000)};
constexpr BackOff kBackOff{milliseconds(1000), milliseconds(4000)};

SteadyTime at(int ms) { return kStart + milliseconds(ms); }

/// Runs the next poll that the scheduler offers and returns its group; nullopt if it offers none.
std::optional<PollScheduler::GroupId> poll(PollScheduler& scheduler, SteadyTime now) {
  const auto job = scheduler.next(now);
  if (job.kind != Kind::poll) return std::nullopt;
  scheduler.step_done(job.poll);
  return job.poll.group;
}

/// A scheduler without devices.
struct PollSchedulerAlone : ::testing::Test {
  PollScheduler scheduler;
};

/// A scheduler with one device.
struct PollSchedulerTest : PollSchedulerAlone {
  const PollScheduler::DeviceId device = scheduler.add_device(3, kBackOff);
};

TEST_F(PollSchedulerTest, CommandGoesBeforeADuePoll) {
  scheduler.add_group(device, milliseconds(100), 1, at(0));
  scheduler.share().command_waits();
  EXPECT_EQ(scheduler.next(at(50)).kind, Kind::command);
  scheduler.share().command_taken();
  EXPECT_EQ(scheduler.next(at(50)).kind, Kind::poll);
}

TEST_F(PollSchedulerAlone, NothingToDoIsAWaitWithoutEnd) {
  const auto job = scheduler.next(at(0));
  EXPECT_EQ(job.kind, Kind::wait);
  EXPECT_EQ(job.until, SteadyTime::max());
}

TEST_F(PollSchedulerTest, WaitsForTheNextPollOfAnyGroup) {
  scheduler.add_group(device, milliseconds(100), 1, at(70));
  scheduler.add_group(device, milliseconds(100), 1, at(30));
  const auto job = scheduler.next(at(0));
  EXPECT_EQ(job.kind, Kind::wait);
  EXPECT_EQ(job.until, at(30));
}

TEST_F(PollSchedulerTest, EarliestDeadlineGoesFirst) {
  const auto slow = scheduler.add_group(device, milliseconds(1000), 1, at(0));
  const auto fast = scheduler.add_group(device, milliseconds(100), 1, at(10));
  EXPECT_EQ(poll(scheduler, at(20)), fast);  // due by 110, the other by 1000
  EXPECT_EQ(poll(scheduler, at(20)), slow);
  EXPECT_EQ(poll(scheduler, at(20)), std::nullopt);
}

TEST_F(PollSchedulerTest, EqualDeadlinesGoInTheOrderOfTheConfig) {
  const auto first = scheduler.add_group(device, milliseconds(100), 1, at(0));
  const auto second = scheduler.add_group(device, milliseconds(100), 1, at(0));
  EXPECT_EQ(poll(scheduler, at(0)), first);
  EXPECT_EQ(poll(scheduler, at(0)), second);
}

TEST_F(PollSchedulerTest, ShorterIntervalBeginsWithinItself) {
  const auto group = scheduler.add_group(device, milliseconds(60000), 1, at(0));
  EXPECT_EQ(poll(scheduler, at(0)), group);
  scheduler.set_interval(group, milliseconds(100), at(1000));
  EXPECT_EQ(scheduler.next(at(1000)).until, at(1100));
  EXPECT_EQ(poll(scheduler, at(1100)), group);
  EXPECT_EQ(scheduler.next(at(1101)).until, at(1200));
  EXPECT_EQ(scheduler.device(device).counters().missed, 0U);
}

TEST_F(PollSchedulerTest, LongerIntervalBeginsWhenTheShorterOneIsOver) {
  const auto group = scheduler.add_group(device, milliseconds(100), 1, at(0));
  EXPECT_EQ(poll(scheduler, at(0)), group);
  scheduler.set_interval(group, milliseconds(60000), at(30));
  EXPECT_EQ(poll(scheduler, at(100)), group);
  EXPECT_EQ(scheduler.next(at(101)).until, at(60100));
}

TEST_F(PollSchedulerTest, RunningCycleGoesOnUnderAnotherInterval) {
  const auto group = scheduler.add_group(device, milliseconds(100), 2, at(0));
  const auto first = scheduler.next(at(0));
  scheduler.set_interval(group, milliseconds(200), at(5));
  EXPECT_FALSE(scheduler.step_done(first.poll));
  const auto second = scheduler.next(at(6));
  EXPECT_EQ(second.poll.exchange, 1U);
  EXPECT_FALSE(second.poll.starts_cycle);
  EXPECT_TRUE(scheduler.step_done(second.poll));
  EXPECT_EQ(scheduler.next(at(7)).until, at(100));
}

TEST_F(PollSchedulerTest, PollsMissedBeforeAnotherIntervalCountByTheOldOne) {
  const auto group = scheduler.add_group(device, milliseconds(1000), 1, at(0));
  scheduler.set_interval(group, milliseconds(10), at(5500));
  EXPECT_EQ(poll(scheduler, at(5500)), group);
  EXPECT_EQ(scheduler.device(device).counters().missed, 5U);
}

TEST_F(PollSchedulerTest, GroupMayLoseItsIntervalAndGetItBack) {
  const auto group = scheduler.add_group(device, milliseconds(1000), 1, at(0));
  EXPECT_EQ(poll(scheduler, at(0)), group);
  scheduler.set_interval(group, milliseconds(0), at(1));
  EXPECT_EQ(poll(scheduler, at(1)), group);
  EXPECT_EQ(poll(scheduler, at(2)), group);
  scheduler.set_interval(group, milliseconds(1000), at(3));
  EXPECT_EQ(scheduler.next(at(3)).until, at(10)) << "on the grid of its interval";
  EXPECT_EQ(poll(scheduler, at(10)), group);
  EXPECT_EQ(scheduler.next(at(11)).until, at(1010));
}

TEST_F(PollSchedulerTest, LatePollDoesNotMoveTheNextOnes) {
  scheduler.add_group(device, milliseconds(100), 1, at(0));
  for (int cycle = 0; cycle < 50; ++cycle) {
    const int late = cycle % 2 == 0 ? 0 : 37;
    const auto job = scheduler.next(at(cycle * 100 + late));
    ASSERT_EQ(job.kind, Kind::poll) << cycle;
    EXPECT_EQ(job.poll.late, milliseconds(late)) << cycle;
    scheduler.step_done(job.poll);
    EXPECT_EQ(scheduler.next(at(cycle * 100 + late)).until, at(cycle * 100 + 100)) << cycle;
  }
  EXPECT_EQ(scheduler.device(device).counters().missed, 0U);
  EXPECT_EQ(scheduler.device(device).counters().polls, 50U);
}

TEST_F(PollSchedulerTest, MissedPollsAreSkippedAndCountedNeverSentInABurst) {
  const auto group = scheduler.add_group(device, milliseconds(100), 1, at(0));
  EXPECT_EQ(poll(scheduler, at(0)), group);
  EXPECT_EQ(poll(scheduler, at(730)), group);  // the poll of 100; those of 200 to 700 are skipped
  EXPECT_EQ(poll(scheduler, at(730)), std::nullopt);
  EXPECT_EQ(scheduler.next(at(730)).until, at(800));
  EXPECT_EQ(scheduler.device(device).counters().missed, 6U);
  EXPECT_EQ(scheduler.device(device).counters().polls, 2U);
}

TEST_F(PollSchedulerTest, IntervalZeroIsAlwaysDueAndLeavesOthersTheirInterval) {
  const auto free = scheduler.add_group(device, milliseconds(0), 1, at(0));
  const auto fast = scheduler.add_group(device, milliseconds(100), 1, at(0));
  int of_free = 0;
  int of_fast = 0;
  for (int now = 0; now < 1000; now += 10) {
    const auto group = poll(scheduler, at(now));
    of_free += group == free;
    of_fast += group == fast;
  }
  EXPECT_EQ(of_fast, 10);
  EXPECT_EQ(of_free, 90);
  EXPECT_EQ(scheduler.device(device).counters().missed, 0U);
}

TEST(PollScheduler, GivenUpCycleOfIntervalZeroRestsAsLongAsItIsTold) {
  // When the link is down, a cycle ends without waiting. Offered again at once, it would keep the
  // field thread busy for ever.
  PollScheduler scheduler;
  const auto device = scheduler.add_device(3, kBackOff);
  const auto free = scheduler.add_group(device, milliseconds(0), 1, at(0));
  ASSERT_EQ(scheduler.next(at(0)).kind, Kind::poll);
  scheduler.group(free).abandon_cycle(at(500));
  const auto job = scheduler.next(at(0));
  EXPECT_EQ(job.kind, Kind::wait);
  EXPECT_EQ(job.until, at(500));
  EXPECT_EQ(poll(scheduler, at(500)), free);
}

TEST_F(PollSchedulerTest, CycleOfSeveralExchangesGivesThemInOrder) {
  scheduler.add_group(device, milliseconds(100), 3, at(0));
  for (std::uint32_t exchange = 0; exchange < 3; ++exchange) {
    const auto job = scheduler.next(at(0));
    ASSERT_EQ(job.kind, Kind::poll);
    EXPECT_EQ(job.poll.exchange, exchange);
    EXPECT_EQ(job.poll.starts_cycle, exchange == 0);
    EXPECT_EQ(scheduler.step_done(job.poll), exchange == 2);
  }
  EXPECT_EQ(scheduler.next(at(0)).until, at(100));
}

TEST_F(PollSchedulerTest, StepThatIsNotDoneIsOfferedAgain) {
  scheduler.add_group(device, milliseconds(100), 2, at(0));
  scheduler.step_done(scheduler.next(at(0)).poll);
  EXPECT_EQ(scheduler.next(at(0)).poll.exchange, 1U);
  EXPECT_EQ(scheduler.next(at(0)).poll.exchange, 1U);
}

TEST_F(PollSchedulerAlone, PostponedStepWaitsAndLetsOthersGo) {
  const auto busy = scheduler.add_device(3, kBackOff);
  const auto group = scheduler.add_group(busy, milliseconds(100), 2, at(0));
  const auto other =
      scheduler.add_group(scheduler.add_device(3, kBackOff), milliseconds(1000), 1, at(10));
  const auto first = scheduler.next(at(0));
  ASSERT_EQ(first.poll.group, group);
  scheduler.group(first.poll.group).postpone(at(50));
  EXPECT_EQ(scheduler.next(at(5)).until, at(10));
  EXPECT_EQ(poll(scheduler, at(20)), other);
  EXPECT_EQ(scheduler.next(at(20)).until, at(50));
  const auto again = scheduler.next(at(50));
  EXPECT_EQ(again.poll.group, group);
  EXPECT_EQ(again.poll.exchange, 0U);
  EXPECT_FALSE(again.poll.starts_cycle);
}

TEST_F(PollSchedulerTest, CommandGoesBetweenTheExchangesOfACycle) {
  scheduler.add_group(device, milliseconds(100), 2, at(0));
  scheduler.step_done(scheduler.next(at(0)).poll);
  scheduler.share().command_waits();
  EXPECT_EQ(scheduler.next(at(5)).kind, Kind::command);
  scheduler.share().command_taken();
  EXPECT_EQ(scheduler.next(at(6)).poll.exchange, 1U);
}

TEST_F(PollSchedulerTest, AbandonedCycleWaitsForTheNextInterval) {
  const auto group = scheduler.add_group(device, milliseconds(100), 3, at(0));
  scheduler.step_done(scheduler.next(at(0)).poll);
  scheduler.group(group).abandon_cycle(at(10));
  EXPECT_EQ(scheduler.next(at(10)).until, at(100));
  const auto job = scheduler.next(at(100));
  EXPECT_TRUE(job.poll.starts_cycle);
  EXPECT_EQ(job.poll.exchange, 0U);
}

TEST_F(PollSchedulerTest, NewPlanRestartsTheRunningCycle) {
  const auto group = scheduler.add_group(device, milliseconds(100), 4, at(0));
  scheduler.step_done(scheduler.next(at(0)).poll);
  scheduler.step_done(scheduler.next(at(0)).poll);
  scheduler.group(group).set_exchanges(1);
  const auto job = scheduler.next(at(0));
  ASSERT_EQ(job.kind, Kind::poll);
  EXPECT_EQ(job.poll.exchange, 0U);
  EXPECT_TRUE(scheduler.step_done(job.poll));
}

TEST_F(PollSchedulerTest, CycleThatIsExtendedGivesWayToOthersAndIsNoMeasure) {
  const auto searching = scheduler.add_group(device, milliseconds(200), 1, at(0));
  const auto other = scheduler.add_group(device, milliseconds(300), 1, at(100));
  int searched = 0;
  int others = 0;
  for (int ms = 0; ms < 2000; ms += 50) {
    const auto job = scheduler.next(at(ms));
    ASSERT_EQ(job.kind, Kind::poll);
    scheduler.step_used(job.poll, milliseconds(50));
    if (job.poll.group == other) {
      ++others;
      scheduler.step_done(job.poll);
      continue;
    }
    ASSERT_EQ(job.poll.group, searching);
    EXPECT_EQ(job.poll.exchange, static_cast<std::uint32_t>(searched++));
    scheduler.group(searching).extend_cycle(static_cast<std::uint32_t>(searched) + 1,
                                            milliseconds(50), at(ms));
    ASSERT_FALSE(scheduler.step_done(job.poll));
  }
  EXPECT_GE(others, 6);
  const auto last = scheduler.next(at(2050));
  scheduler.step_done(last.poll);
  EXPECT_LT(scheduler.load(), 0.5);
}

TEST_F(PollSchedulerTest, GroupWithoutExchangesIsOneStep) {
  scheduler.add_group(device, milliseconds(100), 0, at(0));
  const auto job = scheduler.next(at(0));
  ASSERT_EQ(job.kind, Kind::poll);
  EXPECT_TRUE(scheduler.step_done(job.poll));
}

TEST_F(PollSchedulerAlone, BackOffDoublesToItsCapAndAnAnswerEndsIt) {
  const auto device = scheduler.add_device(2, kBackOff);
  scheduler.add_group(device, milliseconds(100), 1, at(0));
  EXPECT_FALSE(scheduler.device(device).unanswered(at(0)));
  EXPECT_FALSE(scheduler.device(device).is_silent());
  int now = 0;
  for (const int rest : {1000, 2000, 4000, 4000}) {
    EXPECT_TRUE(scheduler.device(device).unanswered(at(now)));
    EXPECT_TRUE(scheduler.device(device).is_silent());
    EXPECT_EQ(scheduler.next(at(now + rest - 1)).kind, Kind::wait) << rest;
    EXPECT_EQ(scheduler.next(at(now)).until, at(now + rest));
    now += rest;
  }
  scheduler.device(device).answered();
  EXPECT_FALSE(scheduler.device(device).is_silent());
  EXPECT_EQ(scheduler.next(at(0)).kind, Kind::poll);
  EXPECT_FALSE(scheduler.device(device).unanswered(at(0)));
  EXPECT_TRUE(scheduler.device(device).unanswered(at(0)));
  EXPECT_EQ(scheduler.next(at(999)).kind, Kind::wait) << "the back-off begins anew";
}

TEST_F(PollSchedulerTest, GroupWithOnlyInvalidAnswersRestsAndTheOthersGoOn) {
  const auto group = scheduler.add_group(device, milliseconds(100), 1, at(0));
  for (const int now : {0, 100}) {
    EXPECT_EQ(poll(scheduler, at(now)), group);
    scheduler.only_invalid(group, at(now));
  }
  int now = 200;
  for (const int rest : {1000, 2000, 4000, 4000}) {
    EXPECT_EQ(poll(scheduler, at(now)), group);
    scheduler.only_invalid(group, at(now));
    EXPECT_EQ(scheduler.next(at(now)).until, at(now + rest));
    EXPECT_EQ(scheduler.next(at(now + rest - 1)).kind, Kind::wait) << rest;
    now += rest;
  }
  const auto other = scheduler.add_group(device, milliseconds(100), 1, at(now - 1));
  EXPECT_EQ(poll(scheduler, at(now - 1)), other);
  EXPECT_EQ(poll(scheduler, at(now)), group);
  scheduler.had_valid(group);
  scheduler.only_invalid(group, at(now));
  EXPECT_EQ(poll(scheduler, at(now + 99)), other);
  EXPECT_EQ(poll(scheduler, at(now + 100)), group) << "three in a row make it rest";
}

TEST_F(PollSchedulerTest, GroupAtRestTakesNoLoadAndIsReadAtOnceWithItsDevice) {
  const auto group = scheduler.add_group(device, milliseconds(100), 1, at(0));
  for (const int now : {0, 100, 200}) {
    const auto job = scheduler.next(at(now));
    ASSERT_EQ(job.kind, Kind::poll);
    scheduler.step_used(job.poll, milliseconds(80));
    EXPECT_GT(scheduler.step_done(job.poll) ? scheduler.load() : 0, 0.5);
    scheduler.only_invalid(group, at(now));
  }
  EXPECT_EQ(scheduler.load(), 0);
  EXPECT_EQ(scheduler.next_poll(group), at(1200));
  scheduler.read_at_once(device, at(500));
  EXPECT_EQ(poll(scheduler, at(500)), group);
  scheduler.only_invalid(group, at(500));
  EXPECT_EQ(scheduler.next_poll(group), at(2500)) << "the next rest is longer all the same";
  scheduler.had_valid(group);
  EXPECT_GT(scheduler.load(), 0.5);
}

TEST_F(PollSchedulerAlone, CommandsWithoutAnAnswerDoNotPutOffTheNextPoll) {
  const auto device = scheduler.add_device(1, kBackOff);
  scheduler.add_group(device, milliseconds(100), 1, at(0));
  constexpr auto kCommand = PolledDevice::AskedBy::command;
  EXPECT_TRUE(scheduler.device(device).unanswered(at(0), kCommand));
  EXPECT_EQ(scheduler.next(at(999)).until, at(1000));
  // Each one uses the line for longer than the rest lasts.
  for (int now = 1100; now < 20000; now += 1100) {
    EXPECT_TRUE(scheduler.device(device).unanswered(at(now), kCommand));
    ASSERT_EQ(scheduler.next(at(now)).kind, Kind::poll) << "or its tags would never turn bad";
    scheduler.group(0).postpone(at(now));
  }
}

TEST_F(PollSchedulerAlone, AnswerBetweenTwoSilencesStartsTheCountAnew) {
  const auto device = scheduler.add_device(2, kBackOff);
  for (int i = 0; i < 5; ++i) {
    EXPECT_FALSE(scheduler.device(device).unanswered(at(i)));
    scheduler.device(device).answered();
  }
}

TEST_F(PollSchedulerAlone, SilentDeviceDoesNotStarveItsNeighbour) {
  const auto silent = scheduler.add_device(1, kBackOff);
  const auto healthy = scheduler.add_device(1, kBackOff);
  const auto dead_group = scheduler.add_group(silent, milliseconds(100), 1, at(0));
  const auto group = scheduler.add_group(healthy, milliseconds(100), 1, at(0));
  int polls_of_the_dead = 0;
  int now = 0;
  while (now < 20000) {
    const auto job = scheduler.next(at(now));
    if (job.kind == Kind::wait) {
      now = static_cast<int>((job.until - kStart) / milliseconds(1));
      continue;
    }
    if (job.poll.group == dead_group) {
      now += 500;  // its timeout
      ++polls_of_the_dead;
      scheduler.device(silent).unanswered(at(now));
      scheduler.group(dead_group).abandon_cycle(at(now));
    } else {
      ASSERT_EQ(job.poll.group, group);
      now += 10;
      scheduler.device(healthy).answered();
      scheduler.step_done(job.poll);
    }
  }
  EXPECT_LE(polls_of_the_dead, 7);  // after 0, 1, 2, then every 4 s
  EXPECT_GE(scheduler.device(healthy).counters().polls, 200U - 6U * 7U);
}

TEST_F(PollSchedulerAlone, CommandsToASilentDeviceAreOffered) {
  const auto device = scheduler.add_device(1, kBackOff);
  scheduler.device(device).unanswered(at(0));
  scheduler.share().command_waits();
  EXPECT_EQ(scheduler.next(at(0)).kind, Kind::command);
}

TEST_F(PollSchedulerTest, DeadlineMayBeNearerThanTheNextInterval) {
  scheduler.add_group(device, milliseconds(100), 1, at(0));
  const auto seldom = scheduler.add_group(device, milliseconds(10000), 1, at(0), milliseconds(50));
  EXPECT_EQ(poll(scheduler, at(0)), seldom);
}

TEST_F(PollSchedulerTest, GroupsOfADeviceThatIsBackAreReadAtOnceAndKeepTheirPollTimes) {
  const auto other = scheduler.add_device(3, kBackOff);
  const auto slow = scheduler.add_group(device, milliseconds(600000), 1, at(0));
  const auto slower = scheduler.add_group(device, milliseconds(900000), 1, at(0));
  const auto others = scheduler.add_group(other, milliseconds(600000), 1, at(0));
  EXPECT_EQ(poll(scheduler, at(0)), slow);
  EXPECT_EQ(poll(scheduler, at(0)), others);
  EXPECT_EQ(poll(scheduler, at(0)), slower);
  scheduler.read_at_once(device, at(60000));
  EXPECT_EQ(scheduler.next(at(59999)).until, at(60000));
  EXPECT_EQ(poll(scheduler, at(60000)), slow);
  EXPECT_EQ(poll(scheduler, at(60000)), slower);
  EXPECT_EQ(scheduler.next(at(60000)).until, at(600000)) << "nobody else, and its poll time stands";
  EXPECT_EQ(scheduler.device(device).counters().polls, 4U);
  EXPECT_EQ(scheduler.device(device).counters().missed, 0U);
}

TEST_F(PollSchedulerTest, GroupThatIsReadAtOnceIsNotReadAgainByAPollRightAfterIt) {
  const auto group = scheduler.add_group(device, milliseconds(1000), 1, at(0));
  EXPECT_EQ(poll(scheduler, at(0)), group);
  scheduler.read_at_once(device, at(700));
  EXPECT_EQ(poll(scheduler, at(700)), group);
  EXPECT_EQ(scheduler.next(at(700)).until, at(2000));
}

TEST_F(PollSchedulerTest, WhatIsReadAtOnceLeavesTheFastGroupsHalfOfTheLine) {
  const auto fast = scheduler.add_group(device, milliseconds(100), 1, kStart);
  for (int i = 0; i < 50; ++i) scheduler.add_group(device, std::chrono::hours(1), 1, kStart);
  const auto cycles_until = [&](SteadyTime now, SteadyTime end) {
    std::vector<int> cycles(51);
    while (now < end) {
      const auto job = scheduler.next(now);
      if (job.kind == Kind::wait) {
        now = job.until;
        continue;
      }
      ++cycles[job.poll.group];
      now += milliseconds(40);
      scheduler.step_used(job.poll, milliseconds(40));
      scheduler.step_done(job.poll);
    }
    return cycles;
  };
  cycles_until(at(0), at(10000));
  scheduler.read_at_once(device, at(10000));
  const auto cycles = cycles_until(at(10000), at(15000));
  for (std::size_t i = 1; i < cycles.size(); ++i) EXPECT_EQ(cycles[i], 1) << i;
  EXPECT_GE(cycles[fast], 40);
}

/// Runs groups on one line with exchanges of the given length. Returns the number of cycles of each
/// group.
struct Share {
  milliseconds interval;
  milliseconds exchange;
  std::uint32_t exchanges = 1;
};
std::vector<int> cycles_within(const std::vector<Share>& groups, milliseconds time,
                               std::uint64_t* missed = nullptr) {
  PollScheduler scheduler;
  const auto device = scheduler.add_device(3, kBackOff);
  for (const Share& group : groups)
    scheduler.add_group(device, group.interval, group.exchanges, kStart);
  std::vector<int> cycles(groups.size());
  for (SteadyTime now = kStart; now < kStart + time;) {
    const auto job = scheduler.next(now);
    if (job.kind == Kind::wait) {
      now = job.until;
      continue;
    }
    if (job.poll.starts_cycle) ++cycles[job.poll.group];
    now += groups[job.poll.group].exchange;
    scheduler.step_used(job.poll, groups[job.poll.group].exchange);
    scheduler.step_done(job.poll);
  }
  if (missed != nullptr) *missed = scheduler.device(device).counters().missed;
  return cycles;
}

TEST(PollScheduler, OverloadedLineGivesEveryGroupItsShareInProportion) {
  // Loads of 0.8 and 0.5, together 1.3: each group should get 1 / 1.3 of its polls.
  std::uint64_t missed = 0;
  const auto cycles = cycles_within(
      {{milliseconds(100), milliseconds(80), 1}, {milliseconds(1000), milliseconds(50), 10}},
      milliseconds(130000), &missed);
  EXPECT_NEAR(cycles[0], 1000, 30);
  EXPECT_NEAR(cycles[1], 100, 3);
  EXPECT_NEAR(static_cast<double>(missed), 330, 35) << "1,430 intervals, 1,100 cycles";
}

TEST(PollScheduler, NoGroupStarvesOnAnyOverloadedLine) {
  std::mt19937 random(11);
  const auto between = [&](int low, int high) {
    return std::uniform_int_distribution<int>(low, high)(random);
  };
  for (int round = 0; round < 50; ++round) {
    std::vector<Share> groups;
    double load = 0;
    for (int n = between(2, 6); n > 0; --n) {
      Share group{milliseconds(between(1, 20) * 50), milliseconds(between(5, 60)),
                  static_cast<std::uint32_t>(between(1, 8))};
      load += static_cast<double>(group.exchange.count()) * group.exchanges /
              static_cast<double>(group.interval.count());
      groups.push_back(group);
    }
    const milliseconds time(200000);
    const auto cycles = cycles_within(groups, time);
    for (std::size_t i = 0; i < groups.size(); ++i) {
      const double intervals = static_cast<double>(time / groups[i].interval);
      const double share = intervals / std::max(1.0, load);
      EXPECT_GE(cycles[i], 0.8 * share) << "round " << round << " load " << load;
      EXPECT_LE(cycles[i], intervals + 1);
    }
  }
}

TEST(PollScheduler, LineWithTimeToSpareKeepsEveryInterval) {
  std::uint64_t missed = 0;
  const auto cycles = cycles_within(
      {{milliseconds(100), milliseconds(40), 1}, {milliseconds(200), milliseconds(20), 5}},
      milliseconds(10000), &missed);
  EXPECT_EQ(cycles[0], 100);
  EXPECT_EQ(cycles[1], 50);
  EXPECT_EQ(missed, 0U);
}

TEST_F(PollSchedulerTest, GroupIsBackOnTheGridWhenAnOverloadIsOver) {
  const auto group = scheduler.add_group(device, milliseconds(200), 1, at(0));
  std::vector<SteadyTime> begun;
  for (SteadyTime now = at(0); now < at(20000);) {
    const auto job = scheduler.next(now);
    if (job.kind == Kind::wait) {
      now = job.until;
      continue;
    }
    begun.push_back(now);
    // At first longer than its interval, and not a divisor of it.
    const milliseconds exchange(now < at(6000) ? 303 : 41);
    now += exchange;
    scheduler.step_used(job.poll, exchange);
    scheduler.step_done(job.poll);
  }
  const milliseconds grid = grid_of(milliseconds(200));
  EXPECT_NE(begun[3].time_since_epoch() % grid, nanoseconds(0)) << "an overload has no grid";
  for (std::size_t i = begun.size() - 10; i < begun.size(); ++i) {
    EXPECT_EQ(begun[i] - begun[i - 1], milliseconds(200));
    EXPECT_EQ(begun[i].time_since_epoch() % grid, nanoseconds(0));
  }
  EXPECT_EQ(scheduler.group(group).next_due().time_since_epoch() % grid, nanoseconds(0));
}

TEST_F(PollSchedulerAlone, SilentDeviceIsNoLoad) {
  const auto device = scheduler.add_device(1, kBackOff);
  scheduler.add_group(device, milliseconds(100), 1, at(0));
  const auto job = scheduler.next(at(0));
  scheduler.step_used(job.poll, milliseconds(50));
  scheduler.step_done(job.poll);
  EXPECT_DOUBLE_EQ(scheduler.load(), 0.5);
  scheduler.device(device).unanswered(at(60));
  EXPECT_DOUBLE_EQ(scheduler.load(), 0.0);
}

TEST(PollScheduler, PollsKeepTheirShareUnderAFloodOfCommands) {
  PollScheduler scheduler(0.2);
  const auto device = scheduler.add_device(1, kBackOff);
  scheduler.add_group(device, milliseconds(0), 1, at(0));
  while (scheduler.share().commands_waiting() < 3) scheduler.share().command_waits();
  nanoseconds of_commands{0};
  nanoseconds of_polls{0};
  SteadyTime now = at(0);
  for (int i = 0; i < 5000; ++i) {
    const auto job = scheduler.next(now);
    now += milliseconds(10);
    if (job.kind == Kind::command) {
      scheduler.share().command_taken();
      scheduler.command_used(milliseconds(10), now);
      scheduler.share().command_waits();  // the flood never ends
      of_commands += milliseconds(10);
    } else {
      ASSERT_EQ(job.kind, Kind::poll);
      scheduler.share().poll_used(milliseconds(10));
      scheduler.step_done(job.poll);
      of_polls += milliseconds(10);
    }
  }
  const double share =
      static_cast<double>(of_polls.count()) / static_cast<double>((of_polls + of_commands).count());
  EXPECT_NEAR(share, 0.2, 0.01);
}

TEST(PollScheduler, NoPollIsOwedForAQuietTime) {
  // Polls that were not delayed must not build up a claim against a later burst of commands.
  PollScheduler scheduler(0.2);
  const auto device = scheduler.add_device(1, kBackOff);
  scheduler.add_group(device, milliseconds(1000), 1, at(500));
  scheduler.share().command_waits();
  scheduler.next(at(0));
  scheduler.share().command_taken();
  scheduler.command_used(milliseconds(400), at(400));
  scheduler.share().command_waits();
  EXPECT_EQ(scheduler.next(at(600)).kind, Kind::command);
}

TEST(PollScheduler, ShareThatThePollsDidNotNeedIsNotOwedLater) {
  PollScheduler scheduler(0.2);
  scheduler.add_group(scheduler.add_device(1, kBackOff), milliseconds(100), 1, at(0));
  scheduler.share().command_waits();
  scheduler.share().command_waits();  // the flood never ends
  SteadyTime now = at(0);
  for (int i = 0; i < 5000; ++i) {
    const auto job = scheduler.next(now);
    now += milliseconds(job.kind == Kind::command ? 50 : 1);
    if (job.kind == Kind::command) {
      scheduler.command_used(milliseconds(50), now);
    } else {
      scheduler.step_used(job.poll, milliseconds(1));
      scheduler.step_done(job.poll);
    }
  }
  EXPECT_LE(scheduler.share().bound({}, {}, milliseconds(1)), milliseconds(20))
      << "12.5 ms are the share beside one command";
}

/// Three devices that share a line. Each has a group that is always due.
struct SharedLine : PollSchedulerTest {
  SharedLine() {
    for (const auto id : {device, other, scheduler.add_device(3, kBackOff)})
      scheduler.add_group(id, milliseconds(0), 1, at(0));
  }
  /// Returns the devices of the polls, of 40 ms each, before the next command; at most 10.
  std::vector<PollScheduler::DeviceId> polls_before_the_command() {
    std::vector<PollScheduler::DeviceId> out;
    for (auto job = scheduler.next(now); job.kind == Kind::poll && out.size() < 10;
         job = scheduler.next(now)) {
      out.push_back(job.poll.group);  // the n-th group is of the n-th device
      now += milliseconds(40);
      scheduler.step_used(job.poll, milliseconds(40));
      scheduler.step_done(job.poll);
    }
    return out;
  }
  using Polls = std::vector<PollScheduler::DeviceId>;
  const PollScheduler::DeviceId other = scheduler.add_device(3, kBackOff);
  SteadyTime now = at(0);
};

TEST_F(SharedLine, AfterASilencePollsOfOthersGoBeforeTheNextCommandForAsLongAgain) {
  scheduler.share().command_waits();
  EXPECT_EQ(polls_before_the_command(), Polls{});
  scheduler.was_silent(device, milliseconds(100));
  scheduler.was_silent(device, milliseconds(100));
  const Polls polls = polls_before_the_command();
  EXPECT_EQ(polls.size(), 3U) << "two silences in a row count once";
  EXPECT_TRUE(std::ranges::none_of(polls, [&](auto id) { return id == device; }));
  EXPECT_EQ(polls_before_the_command(), Polls{});
}

TEST_F(SharedLine, SilencesAmongThePollsThatGoFirstGiveThemNoFurtherTime) {
  scheduler.share().command_waits();
  scheduler.was_silent(device, milliseconds(100));
  int silences = 0;
  for (auto job = scheduler.next(now); job.kind == Kind::poll && silences < 100;
       job = scheduler.next(now)) {
    ++silences;
    now += milliseconds(60);
    scheduler.step_used(job.poll, milliseconds(60));
    scheduler.was_silent(job.poll.group, milliseconds(60));
    scheduler.group(job.poll.group).abandon_cycle(now);
  }
  EXPECT_EQ(silences, 2);
  scheduler.was_silent(device, milliseconds(100));
  EXPECT_EQ(polls_before_the_command().size(), 3U) << "a command has gone";
}

TEST_F(SharedLine, SilenceOfACommandGivesItsTimeAlsoDuringThatOfAPoll) {
  scheduler.was_silent(other, milliseconds(40));
  scheduler.share().command_waits();
  scheduler.was_silent(device, milliseconds(100), PolledDevice::AskedBy::command);
  const Polls polls = polls_before_the_command();
  EXPECT_EQ(polls.size(), 3U);
  EXPECT_TRUE(std::ranges::none_of(polls, [&](auto id) { return id == device; }));
}

TEST_F(SharedLine, PollsKeepTheirShareBesideTheTimeAfterASilence) {
  scheduler.share().command_waits();
  scheduler.was_silent(device, milliseconds(400));
  EXPECT_EQ(polls_before_the_command().size(), 10U);
  EXPECT_EQ(polls_before_the_command(), Polls{});
  scheduler.command_used(milliseconds(400), now);
  EXPECT_EQ(polls_before_the_command().size(), 3U) << "100 ms are theirs";
}

TEST_F(SharedLine, BetweenTheTriesOfACommandOnlyThePollsAfterASilenceGo) {
  scheduler.share().command_waits();
  scheduler.command_used(milliseconds(400), now);  // polls are owed 100 ms
  EXPECT_FALSE(scheduler.next_after_silence(now));
  scheduler.was_silent(device, milliseconds(40), PolledDevice::AskedBy::command);
  const auto poll = scheduler.next_after_silence(now);
  ASSERT_TRUE(poll);
  EXPECT_NE(poll->group, device);
  scheduler.step_used(*poll, milliseconds(40));
  EXPECT_FALSE(scheduler.next_after_silence(now));
}

TEST_F(SharedLine, SilenceCountsForACommandThatComesDuringThePollsAfterIt) {
  scheduler.was_silent(device, milliseconds(100));
  const auto first = scheduler.next(now);
  scheduler.share().command_waits();
  scheduler.step_used(first.poll, milliseconds(40));
  scheduler.step_done(first.poll);
  EXPECT_EQ(polls_before_the_command().size(), 2U);
}

TEST_F(SharedLine, PollsOfSilentDevicesWaitForThoseAfterASilence) {
  for (int i = 0; i < 3; ++i) scheduler.device(other).unanswered(now - std::chrono::seconds(9));
  scheduler.was_silent(device, milliseconds(100));
  scheduler.share().command_waits();
  const Polls polls = polls_before_the_command();
  EXPECT_EQ(polls.size(), 3U);
  EXPECT_TRUE(std::ranges::all_of(polls, [&](auto id) { return id != device && id != other; }));
}

TEST_F(PollSchedulerTest, SilenceOfALoneDeviceDelaysNoCommand) {
  scheduler.add_group(device, milliseconds(0), 1, at(0));
  scheduler.share().command_waits();
  scheduler.was_silent(device, milliseconds(100));
  EXPECT_EQ(scheduler.next(at(0)).kind, Kind::command);
}

TEST(PollScheduler, WhatIsOwedToPollsIsPartOfTheBound) {
  PollScheduler scheduler(0.2);
  const auto device = scheduler.add_device(1, kBackOff);
  scheduler.add_group(device, milliseconds(0), 1, at(0));
  scheduler.share().command_waits();
  scheduler.share().command_waits();
  scheduler.share().command_taken();
  scheduler.command_used(milliseconds(10000), at(0));  // polls are now owed 2.5 s
  EXPECT_GE(scheduler.share().bound(milliseconds(0), milliseconds(10), milliseconds(50)),
            milliseconds(2500));
}

TEST_F(PollSchedulerAlone, DeviceThatIsRemovedIsPolledNoMoreAndItsPlacesServeAnother) {
  const auto stays = scheduler.add_device(3, kBackOff);
  const auto goes = scheduler.add_device(3, kBackOff);
  const auto kept = scheduler.add_group(stays, milliseconds(100), 1, at(0));
  const auto old = scheduler.add_group(goes, milliseconds(100), 3, at(0));
  EXPECT_EQ(poll(scheduler, at(0)), kept);
  EXPECT_EQ(poll(scheduler, at(0)), old) << "its cycle is under way";
  scheduler.remove_device(goes);
  EXPECT_FALSE(poll(scheduler, at(50)));
  EXPECT_EQ(scheduler.next(at(50)).until, at(100));
  EXPECT_EQ(poll(scheduler, at(100)), kept);
  scheduler.read_at_once(goes, at(110));
  EXPECT_FALSE(poll(scheduler, at(110)));

  const auto next = scheduler.add_device(3, kBackOff);
  EXPECT_EQ(next, goes);
  const auto fresh = scheduler.add_group(next, milliseconds(100), 1, at(150));
  EXPECT_EQ(fresh, old);
  EXPECT_EQ(scheduler.device(next).counters().polls, 0U);
  EXPECT_EQ(poll(scheduler, at(150)), fresh);
  EXPECT_EQ(poll(scheduler, at(200)), kept) << "it has kept its interval";
  EXPECT_EQ(scheduler.device(stays).counters().missed, 0U);
}

TEST_F(PollSchedulerAlone, TimeThatIsForgottenIsNotMissed) {
  const auto device = scheduler.add_device(3, {});
  const auto group = scheduler.add_group(device, milliseconds(100), 2, at(0));
  PollScheduler::Job job = scheduler.next(at(0));
  ASSERT_EQ(job.kind, PollScheduler::Job::Kind::poll);
  EXPECT_FALSE(scheduler.step_done(job.poll)) << "one exchange is left";
  scheduler.forget_until(at(60'050));
  EXPECT_EQ(scheduler.group(group).next_due(), at(60'100)) << "on the same grid as before";
  EXPECT_EQ(scheduler.next(at(60'050)).kind, PollScheduler::Job::Kind::wait);
  job = scheduler.next(at(60'100));
  ASSERT_EQ(job.kind, PollScheduler::Job::Kind::poll);
  EXPECT_TRUE(job.poll.starts_cycle);
  EXPECT_EQ(job.poll.exchange, 0U);
  EXPECT_EQ(scheduler.device(device).counters().missed, 0U);
}

TEST_F(PollSchedulerAlone, ReachedIntervalIsMeasured) {
  const auto device = scheduler.add_device(3, {});
  const auto group = scheduler.add_group(device, milliseconds(100), 1, at(0));
  for (const int ms : {0, 100, 200}) {
    const PollScheduler::Job job = scheduler.next(at(ms));
    ASSERT_EQ(job.kind, PollScheduler::Job::Kind::poll);
    scheduler.step_done(job.poll);
  }
  EXPECT_EQ(scheduler.group(group).reached(), milliseconds(100));
  scheduler.step_done(scheduler.next(at(500)).poll);
  EXPECT_EQ(scheduler.group(group).reached(), milliseconds(125)) << "smoothed over eight";
  scheduler.forget_until(at(60'000));
  scheduler.step_done(scheduler.next(at(60'000)).poll);
  EXPECT_EQ(scheduler.group(group).reached(), milliseconds(125))
      << "not of the time that does not count";
}

}  // namespace
}  // namespace fxagent::test
