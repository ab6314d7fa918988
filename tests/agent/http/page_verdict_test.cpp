#include "agent/http/page_verdict.h"

#include <gtest/gtest.h>

#include "tests/agent/http/made_up_status.h"

namespace fxagent {
namespace {

using namespace test;

AgentStatus well() {
  AgentStatus status = made_up_status();
  DeviceStatus online;
  online.state = DeviceStatus::State::online;
  status.devices = {std::make_shared<const DeviceStatus>(online),
                    std::make_shared<const DeviceStatus>(online)};
  status.refused = {"", ""};
  FieldHealth field = made_up_field();
  field.links[0].load_percent = 80;
  status.field = std::make_shared<const FieldHealth>(field);
  return status;
}

std::shared_ptr<const DeviceStatus> in_state(DeviceStatus::State state, const std::string& reason,
                                             std::int64_t since_ms) {
  DeviceStatus device;
  device.state = state;
  device.reason = reason;
  device.reason_text = "check the cable";
  device.since_ms = since_ms;
  return std::make_shared<const DeviceStatus>(device);
}

AgentStatus both_offline(const std::string& reason) {
  AgentStatus status = well();
  status.devices[0] = in_state(DeviceStatus::State::offline, reason, 30);
  status.devices[1] = in_state(DeviceStatus::State::offline, reason, 20);
  return status;
}

TEST(PageVerdict, NothingIsWrongIfEverythingWorks) {
  const Verdict verdict = verdict_of(well());
  EXPECT_TRUE(verdict.problems.empty());
  EXPECT_EQ(verdict.works, "2 of 2 devices answer; the broker is connected");
}

TEST(PageVerdict, ASilentDeviceIsNamedWithItsTimeAndCure) {
  AgentStatus status = well();
  status.devices[1] = in_state(DeviceStatus::State::offline, "timeout", 1790000000000);
  const Verdict verdict = verdict_of(status);
  ASSERT_EQ(verdict.problems.size(), 1U);
  const Problem& problem = verdict.problems[0];
  EXPECT_EQ(problem.severity, Severity::bad);
  EXPECT_EQ(problem.place, "device press2");
  EXPECT_EQ(problem.text, "press2 does not answer (timeout)");
  EXPECT_EQ(problem.cure, "check the cable");
  EXPECT_EQ(problem.since_ms, 1790000000000);
  EXPECT_EQ(verdict.works, "1 of 2 devices answers; the broker is connected");
}

TEST(PageVerdict, AnOnlineDeviceWithSomethingToCheckIsNotWell) {
  AgentStatus status = well();
  status.devices[1] = in_state(DeviceStatus::State::online, "", 30);
  const Verdict verdict = verdict_of(status);
  ASSERT_EQ(verdict.problems.size(), 1U);
  EXPECT_EQ(verdict.problems[0].severity, Severity::warn);
  EXPECT_EQ(verdict.problems[0].text, "press2 is not as configured");
  EXPECT_EQ(verdict.problems[0].cure, "check the cable");
  EXPECT_EQ(verdict.works, "2 of 2 devices answer; the broker is connected");
}

TEST(PageVerdict, ABrokerThatIsAwayRefusesNothing) {
  AgentStatus status = well();
  status.broker.connected = false;
  status.refused = {"0x87", ""};
  EXPECT_EQ(verdict_of(status).problems.size(), 1U);
}

TEST(PageVerdict, AProfileWithoutItsBrokerIsNamedWithItsServer) {
  AgentStatus status = well();
  status.profiles[0].connected = false;
  status.profiles[0].why = "connection refused";
  const Verdict verdict = verdict_of(status);
  ASSERT_EQ(verdict.problems.size(), 1U);
  EXPECT_EQ(verdict.problems[0].severity, Severity::warn);
  EXPECT_EQ(verdict.problems[0].place, "profile plain@cloud");
  EXPECT_EQ(verdict.problems[0].text,
            "The profile plain@cloud has no connection to mqtt://two:1883: connection refused");
}

TEST(PageVerdict, AProfileThatWaitsForItsHostIsNamed) {
  AgentStatus status = well();
  status.profiles[0].ready = false;
  const Verdict verdict = verdict_of(status);
  ASSERT_EQ(verdict.problems.size(), 1U);
  EXPECT_EQ(verdict.problems[0].text,
            "The profile plain@cloud is connected but does not send samples yet");
}

TEST(PageVerdict, ADeviceThatStartsIsNoFault) {
  AgentStatus status = well();
  status.devices[0] = in_state(DeviceStatus::State::offline, "starting", 5);
  status.devices[1] = in_state(DeviceStatus::State::degraded, "nak", 6);
  for (const Problem& problem : verdict_of(status).problems)
    EXPECT_EQ(problem.severity, Severity::warn) << problem.text;
}

TEST(PageVerdict, TheWorstComesFirstThenTheOldest) {
  AgentStatus status = well();
  status.devices[0] = in_state(DeviceStatus::State::degraded, "nak", 1);
  status.devices[1] = in_state(DeviceStatus::State::offline, "timeout", 30);
  status.broker.connected = false;
  status.broker.why = "connection refused";
  status.broker.since_ms = 20;
  const Verdict verdict = verdict_of(status);
  ASSERT_EQ(verdict.problems.size(), 3U);
  EXPECT_EQ(verdict.problems[0].text, "No connection to mqtt://one:1883: connection refused");
  EXPECT_EQ(verdict.problems[1].place, "device press2");
  EXPECT_EQ(verdict.problems[2].place, "device press1");
  EXPECT_EQ(verdict.works,
            "1 of 2 devices answers; 6 samples kept for the broker, 3 of them on disk");
}

TEST(PageVerdict, OneLostPortIsOneProblem) {
  const Verdict verdict = verdict_of(both_offline("link_down"));
  ASSERT_EQ(verdict.problems.size(), 1U);
  EXPECT_EQ(verdict.problems[0].place, "link line1");
  EXPECT_EQ(verdict.problems[0].text, "Link line1 is down, and 2 devices cannot be reached");
  EXPECT_EQ(verdict.problems[0].cure, "check the cable");
  EXPECT_EQ(verdict.problems[0].since_ms, 20);
}

TEST(PageVerdict, DevicesThatFallSilentTogetherAreOneProblem) {
  const Verdict verdict = verdict_of(both_offline("timeout"));
  ASSERT_EQ(verdict.problems.size(), 1U);
  EXPECT_EQ(verdict.problems[0].text, "None of the 2 devices on line1 answers");
}

TEST(PageVerdict, DroppedSamplesCountForAnHour) {
  AgentStatus status = well();
  status.samples.dropped = 3;
  ASSERT_EQ(verdict_of(status, status.ts_ms - 3'600'000).problems.size(), 1U);
  EXPECT_TRUE(verdict_of(status, status.ts_ms - 3'600'001).problems.empty());
}

TEST(PageVerdict, EachOtherFaultHasItsSentenceAndCure) {
  struct Case {
    void (*make)(AgentStatus&);
    std::string text;
  };
  for (const Case& each : {
           Case{[](AgentStatus& s) { s.conflict = "0badc0de"; }, "same id"},
           Case{[](AgentStatus& s) { s.broker.not_heard_why = "not authorised"; },
                "not authorised"},
           Case{[](AgentStatus& s) { s.broker.refused = {"results"}; }, "refuses results"},
           Case{[](AgentStatus& s) { s.store_state = "memory"; },
                "samples and audit records are in memory only"},
           Case{[](AgentStatus& s) { s.store_state = "hangs"; }, "does not respond"},
           Case{[](AgentStatus& s) { s.store_set_aside = "fxagent.db.bad"; }, "fxagent.db.bad"},
           Case{[](AgentStatus& s) {
                  s.refused = {"0x87", ""};
                },
                "0x87"},
           Case{[](AgentStatus& s) { s.ts_ms = 5; }, "clock"},
           Case{[](AgentStatus& s) {
                  FieldHealth field = *s.field;
                  field.links[0].load_percent = 125;
                  s.field = std::make_shared<const FieldHealth>(field);
                },
                "need 125 % of the line"},
           Case{[](AgentStatus& s) {
                  FieldHealth field = *s.field;
                  field.links[0].doubted = true;
                  s.field = std::make_shared<const FieldHealth>(field);
                },
                "belong to no answer"},
           Case{[](AgentStatus& s) {
                  s.config_status.last_reload = {"rejected", 5, {"/links/0: no"}, 1};
                },
                "/links/0: no"},
       }) {
    AgentStatus status = well();
    each.make(status);
    const Verdict verdict = verdict_of(status);
    ASSERT_EQ(verdict.problems.size(), 1U) << each.text;
    EXPECT_NE(verdict.problems[0].text.find(each.text), std::string::npos)
        << verdict.problems[0].text;
    EXPECT_FALSE(verdict.problems[0].cure.empty());
  }
}

}  // namespace
}  // namespace fxagent
