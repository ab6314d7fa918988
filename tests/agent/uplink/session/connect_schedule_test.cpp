// The order of the servers after a loss, and how the agents of a dead broker spread.
#include "agent/uplink/session/connect_schedule.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>

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

TEST(ConnectSchedule, SilentServerCostsLittleUntilAllHaveBeenTried) {
  ScheduleOfAgent agent;
  for (int attempt = 0; attempt < 3; ++attempt) {
    EXPECT_EQ(agent.schedule.patience(), 3s);
    agent.schedule.after_failure(kScheduleStart);
  }
  EXPECT_EQ(agent.schedule.patience(), 30s);
  agent.connect_to(2);
  EXPECT_EQ(agent.schedule.patience(), 3s) << "the next round after a loss";
  agent.mqtt.servers.resize(1);
  EXPECT_EQ(agent.schedule.patience(), 30s) << "there is no other";
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
    EXPECT_LE(attempts.back(), kScheduleStart + lifetime + 1s);
    for (std::size_t i = 0; i + 15 < attempts.size(); ++i)
      EXPECT_GT(attempts[i + 15] - attempts[i], 100ms) << "more than 15 within 100 ms";
  }
}

constexpr SteadyTime kLoss{std::chrono::hours(1)};
constexpr std::size_t kFleet = 10'000;

struct StormOfAgents {
  std::size_t most_in_a_second = 0;
  SteadyTime::duration first{};
  SteadyTime::duration last{};
};

/// Plays agents that lose a stable connection at the same time, at a broker that accepts
/// connections again after `outage`. Returns when they connect, from the loss.
StormOfAgents storm(std::chrono::seconds spread, std::chrono::seconds outage) {
  MqttConfig mqtt;
  mqtt.servers = {"mqtt://broker:1883"};
  mqtt.reconnect_spread = spread;
  std::vector<SteadyTime> connects;
  for (std::uint32_t seed = 1; seed <= kFleet; ++seed) {
    JitteredBackoff backoff(seed * 7919);
    ConnectSchedule schedule(mqtt, backoff);
    schedule.connection_began(kLoss - std::chrono::seconds(600));
    schedule.connection_ended(kLoss);
    SteadyTime at = schedule.after_loss(kLoss - std::chrono::seconds(600), kLoss);
    while (at < kLoss + outage) at = schedule.after_failure(at);
    connects.push_back(at);
  }
  std::sort(connects.begin(), connects.end());
  StormOfAgents out;
  out.first = connects.front() - kLoss;
  out.last = connects.back() - kLoss;
  for (auto from = connects.begin(), to = from; to != connects.end(); ++to) {
    while (*to - *from >= std::chrono::seconds(1)) ++from;
    out.most_in_a_second = std::max(out.most_in_a_second, static_cast<std::size_t>(to - from) + 1);
  }
  return out;
}

TEST(ConnectSchedule, OneAgentIsBackWithinFiveSecondsOfAShortOutage) {
  for (const int outage : {0, 1, 5, 30, 120}) {
    const StormOfAgents agents = storm(std::chrono::seconds(0), std::chrono::seconds(outage));
    EXPECT_LE(agents.last, std::chrono::seconds(outage) + std::chrono::seconds(5) + 1ms) << outage;
  }
}

TEST(ConnectSchedule, SpreadKeepsAFleetFromReconnectingAtOnce) {
  for (const int outage : {0, 5, 30, 120, 900}) {
    const StormOfAgents agents = storm(std::chrono::seconds(60), std::chrono::seconds(outage));
    // A sixtieth of the fleet a second, and half as much again by chance.
    EXPECT_LE(agents.most_in_a_second, kFleet / 60 * 3 / 2) << outage;
    EXPECT_LE(agents.last, std::chrono::seconds(outage) + std::chrono::seconds(60 + 2)) << outage;
  }
}

TEST(ConnectSchedule, WithSpreadAnotherAgentWithOurIdStaysDetected) {
  MqttConfig mqtt;
  mqtt.servers = {"mqtt://broker:1883"};
  mqtt.reconnect_spread = std::chrono::seconds(60);
  JitteredBackoff backoff(1);
  ConnectSchedule schedule(mqtt, backoff);
  // The other agent may wait the whole spread before it takes the session over again.
  EXPECT_GE(schedule.steady_after(), std::chrono::seconds(60));
  SteadyTime::duration shortest = SteadyTime::duration::max();
  SteadyTime now = kLoss;
  for (int takeover = 0; takeover < 6; ++takeover) {
    const SteadyTime connected = now;
    schedule.connection_began(connected);
    now += std::chrono::seconds(61);
    schedule.connection_ended(now);
    now = schedule.after_loss(connected, now);
    shortest = std::min(shortest, schedule.steady_after());
  }
  EXPECT_GE(shortest, 60s + 750ms);
  // Each further pause is longer, up to a minute: the third takeover waits at least 4 s.
  EXPECT_GE(schedule.steady_after(), std::chrono::seconds(60 + 3 * 8));
}

}  // namespace
}  // namespace fxagent
