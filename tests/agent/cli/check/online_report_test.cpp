// The report of `check --online`: its lines, the advice, the exit status.
#include "agent/cli/check/online_report.h"
#include "agent/config/loader.h"
#include "tests/support/says.h"

#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>

namespace fxagent {
namespace {

using nlohmann::json;
using test::expect_says;

constexpr const char* kConfig = R"({
  "agent": {"id": "edge7", "root": "fx"},
  "mqtt": {"servers": ["mqtts://broker.example:8883"], "username": "edge7", "password_env": "PW",
           "tls": {"ca_file": "/etc/ca.pem"}},
  "links": [{"name": "line1", "serial": {"path": "/dev/ttyUSB0"}},
            {"name": "line2", "tcp": {"host": "192.0.2.7", "port": 502}},
            {"name": "line3", "serial": {"path": "/dev/ttyUSB1"}}],
  "devices": [
    {"name": "press1", "link": "line1", "protocol": "fx-programming-port", "model": "FX3U",
     "groups": [{"name": "fast"}, {"name": "slow"}],
     "tags": [{"name": "temp", "address": "D100", "group": "fast"},
              {"name": "speed", "address": "D101", "group": "fast"},
              {"name": "count", "address": "D102", "group": "slow"}]},
    {"name": "meter", "link": "line2", "protocol": "modbus-tcp",
     "groups": [{"name": "fast"}], "tags": [{"name": "power", "address": "ir:0", "group": "fast"}]}
  ]})";

struct OnlineReport : testing::Test {
  OnlineReport() : config(*parse_config(kConfig)) {
    findings.path = "agent.json";
    for (const LinkConfig& link : config.links) findings.links.push_back({link.name, "place"});
    findings.brokers = {{"mqtts://broker.example:8883", true}};
    findings.brokers[0].is_publishing_tried = true;
    devices.ask(0);
    devices.ask(1);
  }

  void says(std::uint32_t device, DeviceStatus::State state, const std::string& reason = {},
            const std::string& model = {}) {
    DeviceStatus status;
    status.device = device;
    status.state = state;
    status.reason = reason;
    status.model = model;
    status.run = device == 0 ? std::optional(true) : std::nullopt;
    devices.take(status);
  }
  void sends(std::uint32_t device, std::uint32_t group, std::vector<TagReading> readings) {
    Telemetry sample;
    sample.device = device;
    sample.group = group;
    sample.readings = std::move(readings);
    devices.take(sample);
  }
  static TagReading good(std::uint32_t tag) { return {tag, std::nullopt, Value(Scalar(true))}; }
  static TagReading bad(std::uint32_t tag, BadReason reason) { return {tag, reason, {}}; }
  void press_answers() {
    says(0, DeviceStatus::State::online, {}, "FX3U");
    sends(0, 0, {good(0), good(1)});
    sends(0, 1, {good(2)});
  }
  void meter_answers() {
    says(1, DeviceStatus::State::online);
    sends(1, 0, {good(0)});
  }
  std::string text() {
    findings.devices = devices.found();
    judge_links(config, findings);
    return online_text(config, findings);
  }
  int status() { return exit_status(findings); }

  const Config config;
  OnlineDevices devices{config};
  OnlineFindings findings;
};

TEST_F(OnlineReport, HasALineForEachLinkDeviceAndBrokerAndTheNextCall) {
  says(0, DeviceStatus::State::offline, "starting");
  EXPECT_FALSE(devices.settled()) << "starting is no answer";
  press_answers();
  EXPECT_FALSE(devices.settled()) << "the meter is still to answer";
  meter_answers();
  EXPECT_TRUE(devices.settled());
  EXPECT_TRUE(devices.worth_another_try().empty());
  EXPECT_EQ(text(),
            "link line1, place: open\n"
            "link line2, place: open\n"
            "link line3, place: not opened: it has no devices\n"
            "device press1 on line1: answers, FX3U, RUN, 3 tags read\n"
            "device meter on line2: answers, 1 tag read\n"
            "broker mqtts://broker.example:8883: answers\n"
            "  not tested: the right to publish anything but responses; "
            "the right to receive commands, which mosquitto does not report\n"
            "Everything answers. Next: fxagent run agent.json\n");
  EXPECT_EQ(status(), 0);
}

TEST_F(OnlineReport, ADeviceIsSettledWithASampleOfEachGroupOrASilence) {
  meter_answers();
  says(0, DeviceStatus::State::online, {}, "FX3U");
  sends(0, 0, {good(0), good(1)});
  sends(0, 0, {good(0), good(1)});
  EXPECT_FALSE(devices.settled()) << "one group twice is not both";
  says(0, DeviceStatus::State::offline, "timeout");
  EXPECT_TRUE(devices.settled());
  EXPECT_EQ(devices.worth_another_try(), std::vector<std::uint32_t>{0});
  devices.ask(0);
  EXPECT_FALSE(devices.settled());
  press_answers();
  EXPECT_TRUE(devices.settled());
  EXPECT_NE(text().find("FX3U, RUN, 3 tags read"), std::string::npos)
      << "the first try is forgotten";
  EXPECT_EQ(status(), 0);
}

TEST_F(OnlineReport, WhatDoesNotAnswerGoesBeforeEverythingElse) {
  press_answers();
  says(1, DeviceStatus::State::offline, "link_down");
  EXPECT_TRUE(devices.worth_another_try().empty()) << "it would not open the next time either";
  findings.links[2].state = OnlineLink::State::held;
  findings.links[2].holder = OnlineHolder{7, "picocom", OnlineHolder::Runs::no_agent};
  const std::string said = text();
  expect_says(said, "link line2, place: does not open\n");
  expect_says(said, "device meter on line2: does not answer (link_down)\n");
  EXPECT_NE(said.find("  line2: link_down\n"), std::string::npos) << "told once, by the link";
  EXPECT_EQ(said.find("  meter: "), std::string::npos) << said;
  EXPECT_EQ(status(), 1);
}

TEST_F(OnlineReport, ABrokerThatIsAwayIsOneAndOneThatRefusesIsFour) {
  press_answers();
  meter_answers();
  findings.brokers[0].text = "it refuses fx/edge7/+/command";
  expect_says(text(), "  mqtts://broker.example:8883: it refuses fx/edge7/+/command\n");
  EXPECT_EQ(status(), 4);
  findings.brokers[0].connected = false;
  EXPECT_EQ(status(), 1);
}

TEST_F(OnlineReport, EachRightThatTheBrokerRefusesIsNamedWithTheCure) {
  press_answers();
  meter_answers();
  findings.brokers[0].refused = {"subscribe to fx/edge7/+/command (not authorised)",
                                 "publish on fx/edge7/press1/result/x (not authorised)"};
  const std::string said = text();
  expect_says(said,
              "broker mqtts://broker.example:8883: answers, but refuses what the agent needs\n");
  for (const std::string& right : findings.brokers[0].refused)
    expect_says(said, "does not let the agent's user " + right + "; fxagent acl prints");
  expect_says(said, "  not tested: the right to publish anything but responses; ");
  EXPECT_EQ(status(), 4);
}

TEST_F(OnlineReport, SaysWhatItCannotKnowOfABroker) {
  press_answers();
  meter_answers();
  findings.brokers[0].is_publishing_tried = false;
  expect_says(text(), "  not tested: the right to publish; the right to receive commands");
  findings.brokers[0].sends_commands = false;
  expect_says(text(), "  not tested: the right to publish\n");
  EXPECT_EQ(status(), 0);
}

TEST_F(OnlineReport, TagsThatAreRefusedAreNamedTogetherWithTheCure) {
  meter_answers();
  says(0, DeviceStatus::State::degraded, "nak", "FX3U");
  sends(0, 0, {bad(0, BadReason::nak), bad(1, BadReason::nak)});
  sends(0, 1, {good(2)});
  const std::string said = text();
  expect_says(said, "device press1 on line1: answers, FX3U, RUN, 1 of 3 tags read\n");
  expect_says(said, "  press1: temp (D100), speed (D101): the device refuses to read it");
  EXPECT_EQ(status(), 4);
}

TEST_F(OnlineReport, APartThatIsSilentIsASilence) {
  meter_answers();
  says(0, DeviceStatus::State::degraded, "timeout", "FX3U");
  sends(0, 0, {good(0), bad(1, BadReason::timeout)});
  sends(0, 1, {good(2)});
  EXPECT_EQ(devices.worth_another_try(), std::vector<std::uint32_t>{0});
  text();
  EXPECT_EQ(status(), 1);
}

TEST_F(OnlineReport, AnotherModelIsNamedWithBothAndStopIsANote) {
  press_answers();
  meter_answers();
  text();
  findings.devices[0].run = false;
  std::string said = online_text(config, findings);
  expect_says(said, "answers, FX3U, STOP, 3 tags read\n");
  expect_says(said, "  press1: the PLC is in STOP");
  EXPECT_EQ(status(), 0) << "it answers";
  findings.devices[0].model_configured = "FX3G";
  said = online_text(config, findings);
  expect_says(said, "answers, FX3U instead of the config's FX3G, STOP");
  expect_says(said,
              "  press1: the PLC is an FX3U, but the config says FX3G: set \"model\": \"FX3U\"");
  EXPECT_EQ(status(), 4);
}

TEST_F(OnlineReport, TheTextsAndTheConfiguredModelAreThoseOfTheState) {
  DeviceStatus status;
  status.state = DeviceStatus::State::online;
  status.model = "FX3U";
  status.model_configured = "FX3G";
  devices.take(status);
  status.device = 1;
  status.state = DeviceStatus::State::offline;
  status.reason = "timeout";
  status.reason_text = "is `unit` 1 its own address?";
  devices.take(status);
  const std::string said = text();
  expect_says(said, "FX3U instead of the config's FX3G");
  expect_says(said, "  meter: is `unit` 1 its own address?\n");
}

TEST_F(OnlineReport, WhoHasALinkIsNamedAndItsAgentCanBeAsked) {
  meter_answers();
  OnlineLink& link = findings.links[0];
  link.state = OnlineLink::State::held;
  link.holder = OnlineHolder{4711, "fxagent", OnlineHolder::Runs::this_config,
                             request_to(config, 0, "check-1")};
  devices = OnlineDevices(config);
  devices.ask(1);
  meter_answers();
  EXPECT_TRUE(devices.settled()) << "nobody waits for who was not asked";
  const std::string said = text();
  expect_says(said,
              "link line1, place: not checked: fxagent, pid 4711, uses it (the agent of this "
              "config)\n");
  expect_says(said, "device press1 on line1: not asked\n");
  expect_says(said,
              "with -u and -P of a user who may send commands: mosquitto_rr -h "
              "broker.example -p 8883 --cafile /etc/ca.pem -W 10 -q 1 -t "
              "fx/edge7/press1/command -e fx/edge7/press1/result/check -m "
              "'{\"id\":\"check-1\",\"op\":\"read\",\"tag\":\"temp\"}'\n");
  EXPECT_EQ(status(), 3);
  link.holder = OnlineHolder{9, "picocom", OnlineHolder::Runs::no_agent};
  expect_says(online_text(config, findings), "  line1: end picocom (pid 9), or ");
  findings.links[1].state = OnlineLink::State::held;
  findings.links[1].holder = OnlineHolder{8, "fxagent", OnlineHolder::Runs::another_config};
  EXPECT_NE(online_text(config, findings).find("  line2: end fxagent (pid 8) for this check: "),
            std::string::npos)
      << "a device of TCP has no other port to give";
  EXPECT_EQ(request_to(config, 2, "check-1"), "") << "it has no devices";
  Config ipv6 = config;
  ipv6.mqtt.servers = {"mqtt://[::1]:1883"};
  expect_says(request_to(ipv6, 0, "check-1"), "mosquitto_rr -h ::1 -p 1883 ");
}

TEST(OnlineHints, AGoodFloatThatIsPlainInAnotherWordOrderIsNamedAndStillGood) {
  const Config config = *parse_config(R"({
    "agent": {"id": "edge7"}, "mqtt": {"servers": ["mqtt://127.0.0.1:1883"]},
    "links": [{"name": "net", "tcp": {"host": "192.0.2.7", "port": 502}}],
    "devices": [{"name": "meter", "link": "net", "protocol": "modbus-tcp", "unit": 1,
      "groups": [{"name": "fast"}],
      "tags": [{"name": "power", "address": "ir:0", "type": "float32", "group": "fast"},
               {"name": "volts", "address": "ir:2", "type": "float32", "group": "fast"},
               {"name": "count", "address": "ir:4", "type": "uint32", "group": "fast"}]}]})");
  OnlineDevices devices(config);
  devices.ask(0);
  DeviceStatus status;
  status.state = DeviceStatus::State::online;
  devices.take(status);
  Telemetry sample;
  // 0000 4366 by IEEE 754; the bytes of 230.0 with the low word first
  sample.readings = {{0, std::nullopt, Value(std::ldexp(0x4366, -149))},
                     {1, std::nullopt, Value(231.5)},
                     {2, std::nullopt, Value(std::int64_t{0x4366})}};
  devices.take(sample);
  OnlineFindings findings;
  findings.links.push_back({"net", "place"});
  findings.devices = devices.found();
  judge_links(config, findings);
  const std::string said = online_text(config, findings);
  expect_says(said, "meter on net: answers, 3 tags read\n");
  expect_says(said,
              "  meter: power (ir:0): in word order CDAB it is 230: compare word_order with "
              "the device\n");
  EXPECT_EQ(exit_status(findings), 0) << "it answers, and the value may be what is there";
  const json out = json::parse(online_json(config, findings));
  EXPECT_EQ(out["devices"][0]["good"], 3);
  EXPECT_EQ(out["devices"][0]["hints"],
            json::parse(R"([{"tag": "power", "text": "in word order CDAB it is 230: compare )"
                        R"(word_order with the device"}])"));
  EXPECT_EQ(out["to_do"].size(), 1U);
  devices.ask(0);
  EXPECT_TRUE(devices.found()[0].hints.empty()) << "asked again, it starts afresh";
}

TEST_F(OnlineReport, WhatOthersSayCannotSteerTheTerminal) {
  press_answers();
  meter_answers();
  findings.brokers[0] = {"mqtts://broker.example:8883", false, "no \x1b[31m \xC2\x9B"};
  EXPECT_EQ(text().find('\x1b'), std::string::npos);
  EXPECT_EQ(text().find("\xC2\x9B"), std::string::npos);
}

TEST_F(OnlineReport, JsonHasTheSame) {
  press_answers();
  says(1, DeviceStatus::State::degraded, "bad_frame");
  sends(1, 0, {bad(0, BadReason::bad_frame)});
  EXPECT_EQ(devices.worth_another_try(), std::vector<std::uint32_t>{1});
  text();
  const json out = json::parse(online_json(config, findings));
  EXPECT_EQ(out["ok"], false);
  EXPECT_EQ(out["status"], 4);
  EXPECT_EQ(
      out["links"][0],
      json::parse(R"({"link":"line1","place":"place","state":"open","text":null,"holder":null})"));
  EXPECT_EQ(out["devices"][0]["state"], "answers");
  EXPECT_EQ(out["devices"][0]["run"], true);
  EXPECT_EQ(out["devices"][0]["good"], 3);
  EXPECT_EQ(out["devices"][1]["bad"],
            json::parse(R"([{"tag":"power","address":"ir:0","reason":"bad_frame"}])"));
  EXPECT_EQ(out["brokers"][0]["connected"], true);
  ASSERT_EQ(out["to_do"].size(), 1U);
}

}  // namespace
}  // namespace fxagent
