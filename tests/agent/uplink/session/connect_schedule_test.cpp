// The order of the servers after a loss, and how the agents of a dead broker spread.
#include "agent/uplink/session/connect_schedule.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <string>
#include <vector>

namespace fxagent {
namespace {

using namespace std::chrono_literals;

const SteadyTime kScheduleStart{1h};

struct ScheduleOfAgent {
  explicit ScheduleOfAgent(std::uint32_t seed = 1) : backoff(seed * 100'000'007U) {
    mqtt.servers = {"mqtt://one", "mqtt://two", "mqtt://three"};
  }

  /// Fails `count` attempts and returns the servers tried, the first one included.
  std::vector<std::size_t> tried(int count) {
    std::vector<std::size_t> out;
    for (int i = 0; i < count; ++i) {
      out.push_back(schedule.index());
      schedule.after_failure(kScheduleStart);
    }
    return out;
  }

  /// Connects to this server after failures of those before it.
  void connect_to(std::size_t server) {
    while (schedule.index() != server) schedule.after_failure(kScheduleStart);
    schedule.connection_began(kScheduleStart);
  }

  MqttConfig mqtt;
  JitteredBackoff backoff;
  ConnectSchedule schedule{mqtt, backoff};
};

using Servers = std::vector<std::size_t>;

TEST(ConnectSchedule, TriesTheServersFromTheFirstAndWaitsAfterTheLast) {
  ScheduleOfAgent agent;
  EXPECT_EQ(agent.schedule.after_failure(kScheduleStart), kScheduleStart);
  EXPECT_EQ(agent.schedule.after_failure(kScheduleStart), kScheduleStart);
  EXPECT_GE(agent.schedule.after_failure(kScheduleStart), kScheduleStart + 1s);
  EXPECT_EQ(agent.tried(7), (Servers{0, 1, 2, 0, 1, 2, 0}));
}

TEST(ConnectSchedule, ServerOfALostConnectionIsTriedLast) {
  const std::vector<Servers> wanted{{1, 2, 0, 0, 1, 2}, {0, 2, 1, 0, 1, 2}, {0, 1, 2, 0, 1, 2}};
  for (std::size_t lost = 0; lost < wanted.size(); ++lost) {
    ScheduleOfAgent agent;
    agent.connect_to(lost);
    agent.schedule.after_loss(kScheduleStart, kScheduleStart + 1min);
    EXPECT_EQ(agent.tried(6), wanted[lost]) << lost;
  }
}

TEST(ConnectSchedule, OnlyServerIsTriedAgain) {
  ScheduleOfAgent agent;
  agent.mqtt.servers = {"mqtt://one"};
  agent.connect_to(0);
  agent.schedule.after_loss(kScheduleStart, kScheduleStart + 1min);
  EXPECT_EQ(agent.tried(3), (Servers{0, 0, 0}));
}

TEST(ConnectSchedule, NextServerOfTheRoundFollowsAConnectionThatDidNotLast) {
  ScheduleOfAgent agent;
  agent.connect_to(0);
  agent.schedule.after_loss(kScheduleStart, kScheduleStart + 1min);
  agent.schedule.connection_began(kScheduleStart + 1min);
  ASSERT_EQ(agent.schedule.index(), 1U);
  const SteadyTime lost = kScheduleStart + 1min + 1s;
  EXPECT_LE(agent.schedule.after_loss(kScheduleStart + 1min, lost), lost + 1s);
  EXPECT_EQ(agent.tried(3), (Servers{2, 0, 0}));
}

TEST(ConnectSchedule, ChangedServersBeginWithTheFirst) {
  ScheduleOfAgent agent;
  agent.connect_to(2);
  agent.schedule.after_loss(kScheduleStart, kScheduleStart + 1min);
  agent.mqtt.servers = {"mqtt://four"};
  agent.schedule.settings_changed();
  agent.schedule.restart();
  EXPECT_EQ(agent.schedule.server(), "mqtt://four");
  EXPECT_EQ(agent.tried(2), (Servers{0, 0}));
}

TEST(ConnectSchedule, FiftyAgentsOfADeadBrokerDoNotReconnectAsAHerd) {
  for (const std::chrono::milliseconds lifetime : {60'000ms, 5'000ms}) {  // stable, and not
    std::vector<SteadyTime> attempts;
    for (std::uint32_t seed = 1; seed <= 50; ++seed) {
      ScheduleOfAgent agent(seed);
      agent.connect_to(0);
      attempts.push_back(agent.schedule.after_loss(kScheduleStart, kScheduleStart + lifetime));
    }
    std::sort(attempts.begin(), attempts.end());
    EXPECT_LE(attempts.back(), kScheduleStart + lifetime + 1250ms);
    for (std::size_t i = 0; i + 15 < attempts.size(); ++i)
      EXPECT_GT(attempts[i + 15] - attempts[i], 100ms) << "more than 15 within 100 ms";
  }
}

}  // namespace
}  // namespace fxagent
