#include "agent/uplink/session/connect_schedule.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <vector>

namespace fxagent {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

constexpr SteadyTime kLoss{std::chrono::hours(1)};
constexpr std::size_t kFleet = 10'000;

struct Agents {
  std::size_t most_in_a_second = 0;
  SteadyTime::duration first{};
  SteadyTime::duration last{};
};

/// Plays agents that lose a stable connection at the same time, at a broker that accepts
/// connections again after `outage`. Returns when they connect, from the loss.
Agents storm(seconds spread, seconds outage) {
  MqttConfig mqtt;
  mqtt.servers = {"mqtt://broker:1883"};
  mqtt.reconnect_spread = spread;
  std::vector<SteadyTime> connects;
  for (std::uint32_t seed = 1; seed <= kFleet; ++seed) {
    JitteredBackoff backoff(seed * 7919);
    ConnectSchedule schedule(mqtt, backoff);
    schedule.connection_began(kLoss - seconds(600));
    schedule.connection_ended(kLoss);
    SteadyTime at = schedule.after_loss(kLoss - seconds(600), kLoss);
    while (at < kLoss + outage) at = schedule.after_failure(at);
    connects.push_back(at);
  }
  std::sort(connects.begin(), connects.end());
  Agents out;
  out.first = connects.front() - kLoss;
  out.last = connects.back() - kLoss;
  for (auto from = connects.begin(), to = from; to != connects.end(); ++to) {
    while (*to - *from >= seconds(1)) ++from;
    out.most_in_a_second = std::max(out.most_in_a_second, static_cast<std::size_t>(to - from) + 1);
  }
  return out;
}

TEST(ConnectSchedule, OneAgentIsBackWithinFiveSecondsOfAShortOutage) {
  for (const int outage : {0, 1, 5, 30, 120}) {
    const Agents agents = storm(seconds(0), seconds(outage));
    EXPECT_LE(agents.last, seconds(outage) + seconds(5) + milliseconds(1)) << outage;
  }
}

TEST(ConnectSchedule, SpreadKeepsAFleetFromReconnectingAtOnce) {
  for (const int outage : {0, 5, 30, 120, 900}) {
    const Agents agents = storm(seconds(60), seconds(outage));
    // A sixtieth of the fleet a second, and half as much again by chance.
    EXPECT_LE(agents.most_in_a_second, kFleet / 60 * 3 / 2) << outage;
    EXPECT_LE(agents.last, seconds(outage) + seconds(60 + 2)) << outage;
  }
}

TEST(ConnectSchedule, WithSpreadAnotherAgentWithOurIdStaysDetected) {
  MqttConfig mqtt;
  mqtt.servers = {"mqtt://broker:1883"};
  mqtt.reconnect_spread = seconds(60);
  JitteredBackoff backoff(1);
  ConnectSchedule schedule(mqtt, backoff);
  // The other agent may wait the whole spread before it takes the session over again.
  EXPECT_GE(schedule.steady_after(), seconds(60));
  SteadyTime::duration shortest = SteadyTime::duration::max();
  SteadyTime now = kLoss;
  for (int takeover = 0; takeover < 6; ++takeover) {
    const SteadyTime connected = now;
    schedule.connection_began(connected);
    now += seconds(61);
    schedule.connection_ended(now);
    now = schedule.after_loss(connected, now);
    shortest = std::min(shortest, schedule.steady_after());
  }
  EXPECT_GE(shortest, seconds(63));
  // Each further pause is longer, up to a minute: the third takeover waits at least 4 s.
  EXPECT_GE(schedule.steady_after(), seconds(60 + 3 * 8));
}

}  // namespace
}  // namespace fxagent
