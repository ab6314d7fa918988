#include "agent/http/probe.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "tests/agent/http/made_up_status.h"

namespace fxagent {
namespace {

using namespace test;
using namespace std::chrono_literals;
using nlohmann::json;

/// Returns the only reason given.
std::string why(const Probe& probe) {
  const json body = json::parse(probe.json);
  EXPECT_EQ(body.at("ok"), probe.good);
  EXPECT_EQ(body.at("why").size(), probe.good ? 0U : 1U) << probe.json;
  return probe.good ? "" : body.at("why").at(0).get<std::string>();
}

TEST(Health, FieldAndUplinkThatGoOnAreHealthy) {
  const AgentStatus status = made_up_status();
  EXPECT_EQ(why(health_of(&status, kMade)), "");
  EXPECT_EQ(why(health_of(&status, kMade + kUplinkWithin)), "");
}

TEST(Health, NoPlcNoLinkAndNoBrokerIsNoFaultOfTheAgent) {
  AgentStatus status = made_up_status();
  status.broker = {"mqtt://one:1883", false, false};
  status.devices = {nullptr, status.devices[1]};
  status.store_state = "memory";
  EXPECT_TRUE(health_of(&status, kMade).good);
}

TEST(Health, UplinkThatMakesNoStatusIsNamed) {
  const AgentStatus status = made_up_status();
  EXPECT_EQ(why(health_of(&status, kMade + 11s)), "uplink: no sign of life for 11 s");
  EXPECT_EQ(why(health_of(nullptr, kMade)), "uplink: no sign of life since the start");
}

/// A stalled uplink publishes no newer status.
TEST(Health, UptimeIsThatOfThisMoment) {
  AgentStatus status = made_up_status();
  status.uptime = 60s;
  EXPECT_EQ(json::parse(health_of(&status, kMade).json).at("uptime_s"), 60);
  EXPECT_EQ(json::parse(health_of(&status, kMade + 45s).json).at("uptime_s"), 105);
  EXPECT_EQ(json::parse(readiness_of(&status, kMade + 45s).json).at("uptime_s"), 105);
}

TEST(Health, FieldThatTellsNoCountersIsNamed) {
  AgentStatus status = made_up_status();
  status.field_heard = kMade - 21s;
  EXPECT_EQ(why(health_of(&status, kMade)), "field: no sign of life for 21 s");
  status.field_heard = kMade - kFieldWithin;
  EXPECT_TRUE(health_of(&status, kMade).good);
}

TEST(Health, FieldHasItsTimeAtTheStart) {
  AgentStatus status = made_up_status();
  status.field_heard.reset();
  status.uptime = 20s;
  EXPECT_TRUE(health_of(&status, kMade).good);
  status.uptime = 21s;
  EXPECT_EQ(why(health_of(&status, kMade)), "field: no sign of life for 21 s");
}

TEST(Readiness, ConnectedAndSubscribedIsReady) {
  const AgentStatus status = ready_status();
  EXPECT_EQ(why(readiness_of(&status, kMade)), "");
}

TEST(Readiness, EachKindOfMessageThatTheBrokerRefusesIsNamed) {
  AgentStatus status = ready_status();
  status.refused = {"", "0x87"};
  EXPECT_EQ(why(readiness_of(&status, kMade)),
            "the broker refuses samples of 1 device: see the log");
  status.refused.clear();
  status.broker.refused = {"states"};
  EXPECT_EQ(why(readiness_of(&status, kMade)), "the broker refuses states: see the log");
  EXPECT_TRUE(health_of(&status, kMade).good);
}

TEST(Readiness, BrokerThatIsAwayRefusesNothing) {
  AgentStatus status = ready_status();
  status.refused = {"0x87", ""};
  status.broker = {"mqtt://one:1883", false, false};
  EXPECT_EQ(why(readiness_of(&status, kMade)), "broker: no connection to mqtt://one:1883");
}

TEST(Readiness, EachThingThatIsMissingIsNamed) {
  AgentStatus status = ready_status();
  status.broker = {"mqtt://one:1883", false, false};
  EXPECT_EQ(why(readiness_of(&status, kMade)), "broker: no connection to mqtt://one:1883");
  status.broker.why = "connection refused";
  EXPECT_EQ(why(readiness_of(&status, kMade)),
            "broker: no connection to mqtt://one:1883: connection refused");
  status.broker = {"mqtt://one:1883", true, false, "not authorised"};
  EXPECT_EQ(why(readiness_of(&status, kMade)), "commands are not received: not authorised");
  status.broker.not_heard_why.clear();
  EXPECT_EQ(why(readiness_of(&status, kMade)),
            "commands are not received: the broker has not confirmed yet");
  status.broker.subscribed = true;
  status.conflict = "0badcafe";
  EXPECT_EQ(why(readiness_of(&status, kMade)),
            "commands are refused: another agent has the same id, boot 0badcafe");
}

TEST(Readiness, AgentThatStandsStillIsNotReady) {
  const AgentStatus status = made_up_status();
  EXPECT_EQ(why(readiness_of(&status, kMade + 11s)), "uplink: no sign of life for 11 s");
  EXPECT_FALSE(readiness_of(nullptr, kMade).good);
}

}  // namespace
}  // namespace fxagent
