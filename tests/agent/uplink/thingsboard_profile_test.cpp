#include "agent/uplink/profile/thingsboard_profile.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "tests/agent/uplink/plant.h"

namespace fxagent {
namespace {

using nlohmann::json;
using test::good;
using test::online;
using namespace std::chrono_literals;

constexpr std::size_t kHistoryBytes = 16384;

TagReading bad(std::uint32_t tag, BadReason reason) {
  TagReading reading;
  reading.tag = tag;
  reading.bad = reason;
  return reading;
}

/// A sample as it arrives at the profile: a row, read again.
struct Row {
  explicit Row(const Telemetry& sample, const DeviceConfig& device = test::press("press1"))
      : bytes(encode_sample(sample, device, "9f3c21aa", "a41c")) {
    EXPECT_TRUE(decode_sample(bytes, record));
  }
  const std::string bytes;
  SampleRecord record;
};

struct ThingsBoardProfileTest : testing::Test {
  explicit ThingsBoardProfileTest(bool commands = true) : plant(test::plant()) {
    ProfileConfig what;
    what.kind = ProfileConfig::Kind::thingsboard;
    what.broker = "cloud";
    RelayCommand take;
    if (commands) take = [this](RelayedCommand command) { relayed.push_back(std::move(command)); };
    profile = std::make_unique<ThingsBoardProfile>(
        plant, what, take, [this] { return "id-" + std::to_string(++ids); });
  }

  /// Returns "topic payload" of all that is due.
  std::vector<std::string> due() {
    std::vector<std::string> all;
    for (auto some = profile->due({}, 0); !some.empty(); some = profile->due({}, 0))
      for (const Publication& each : some) {
        EXPECT_EQ(each.qos, 1);
        EXPECT_EQ(each.retain, Retain::no);
        all.push_back(each.topic.substr(each.topic.rfind('/') + 1) + " " + each.payload);
      }
    return all;
  }

  std::string live(std::vector<TagReading> readings) {
    Telemetry message = test::sample(1);
    message.readings = std::move(readings);
    const Row row(message);
    const auto messages = profile->sample({"press1", "fast"}, row.record);
    if (messages.empty()) return "";
    EXPECT_EQ(messages.front().topic, "v1/gateway/telemetry");
    return json::parse(messages.front().payload).at("press1").at(0).at("values").dump();
  }

  /// Returns the command that becomes of `data`, without its id.
  json command_of(const std::string& data) {
    ask(R"({"device":"press1","data":)" + data + "}");
    json command = json::parse(relayed.back().payload);
    EXPECT_EQ(command["id"], "id-" + std::to_string(ids));
    command.erase("id");
    return command;
  }

  void ask(const std::string& payload, bool retained = false) {
    Message message = test::message_on("v1/gateway/rpc", payload, retained);
    message.received_ms = 1790000000000;
    profile->hear(message);
  }

  Config plant;
  std::vector<RelayedCommand> relayed;
  int ids = 0;
  std::unique_ptr<ThingsBoardProfile> profile;
};

struct WithoutCommands : ThingsBoardProfileTest {
  WithoutCommands() : ThingsBoardProfileTest(false) {}
};

TEST_F(ThingsBoardProfileTest, HasNoLastWill) { EXPECT_EQ(profile->last_will().topic, ""); }

TEST_F(ThingsBoardProfileTest, DeviceIsConnectedThenDescribed) {
  profile->connection_began({});
  profile->device_state(online(0));
  EXPECT_EQ(
      due(),
      (std::vector<std::string>{
          R"(connect {"device":"press1","type":"default"})",
          R"(attributes {"press1":{"temp_unit":"°C","setpoint_min":0,"setpoint_max":1000}})",
          R"(attributes {"press1":{"state":"online","since":7,"reason":"","reason_text":"","model":"FX3U","run":true}})"}));
  // Only the state is news.
  profile->device_state(online(0));
  EXPECT_EQ(due().size(), 1U);
}

TEST_F(ThingsBoardProfileTest, LostDeviceIsDisconnectedAfterItsState) {
  profile->connection_began({});
  profile->device_state(online(0));
  due();
  profile->device_state(test::offline(0, "timeout"));
  EXPECT_FALSE(profile->may_send("press1"));
  EXPECT_EQ(
      due(),
      (std::vector<std::string>{
          R"(attributes {"press1":{"state":"offline","since":7,"reason":"timeout","reason_text":"","model":"","run":""}})",
          R"(disconnect {"device":"press1"})"}));
  profile->connection_ended();
  profile->connection_began({});
  const auto again = due();
  EXPECT_EQ(again.front(), R"(connect {"device":"press1","type":"default"})");
  EXPECT_EQ(again.back(), R"(disconnect {"device":"press1"})");
}

TEST_F(ThingsBoardProfileTest, ManyTagsAreDescribedInSeveralMessages) {
  SharedVector<TagConfig> tags;
  for (int i = 0; i < 5000; ++i) {
    tags.push_back(test::tag("t" + std::to_string(i), "D" + std::to_string(i), DataType::int16));
    tags.back().units =
        std::make_shared<const TagUnits>(TagUnits{.unit = "°C", .limits = {.max = 1}});
  }
  plant.devices[0].tags = tags;
  profile->connection_began({});
  profile->device_state(online(0));
  const auto messages = due();
  EXPECT_GT(messages.size(), 5U);
  std::size_t keys = 0;
  for (const std::string& each : messages) {
    EXPECT_LT(each.size(), 32768U);
    const json payload = json::parse(each.substr(each.find(' ') + 1));
    if (payload.contains("press1")) keys += payload["press1"].size();
  }
  EXPECT_EQ(keys, 2 * 5000U + 6U);
}

TEST_F(ThingsBoardProfileTest, ReasonIsPublishedWhenItChanges) {
  EXPECT_EQ(live({good(test::temp, Value(23.4))}), R"({"temp":23.4,"temp_bad":""})");
  EXPECT_EQ(live({good(test::temp, Value(23.5))}), R"({"temp":23.5})");
  EXPECT_EQ(live({bad(test::temp, BadReason::nak)}), R"({"temp_bad":"nak"})");
  EXPECT_EQ(live({bad(test::temp, BadReason::nak)}), "");
  EXPECT_EQ(live({bad(test::temp, BadReason::timeout)}), R"({"temp_bad":"timeout"})");
  EXPECT_EQ(live({good(test::temp, Value(1.5))}), R"({"temp":1.5,"temp_bad":""})");
  const Value nan(std::numeric_limits<double>::quiet_NaN());
  EXPECT_EQ(live({good(test::temp, nan)}), R"({"temp_bad":"bad_value"})");
  // The server may have missed the last reason.
  profile->undelivered("press1");
  EXPECT_EQ(live({good(test::temp, Value(2.5))}), R"({"temp":2.5,"temp_bad":""})");
  profile->connection_ended();
  EXPECT_EQ(live({good(test::temp, Value(3.5))}), R"({"temp":3.5,"temp_bad":""})");
}

TEST_F(ThingsBoardProfileTest, ElementsOfAnArrayHaveKeysOfTheirOwn) {
  Value list = Value::array({std::int64_t{1}, std::int64_t{-2}});
  EXPECT_EQ(json::parse(live({good(test::pressure, list)})),
            json::parse(R"({"pressure_0":1,"pressure_1":-2,"pressure_bad":""})"));
}

TEST_F(ThingsBoardProfileTest, IntegersThatADoubleWouldChangeAreText) {
  EXPECT_EQ(live({good(test::pressure, Value(std::int64_t{9007199254740993}))}),
            R"({"pressure":"9007199254740993","pressure_bad":""})");
}

TEST_F(ThingsBoardProfileTest, HistoryHasManyRows) {
  const auto history = [&](const std::string& device) {
    const auto message = profile->begin_history(kHistoryBytes);
    for (const std::uint64_t seq : {1U, 2U})
      EXPECT_TRUE(message->add(Row(test::sample(seq)).record));
    return message->take({device, "fast"});
  };
  const auto sent = history("press1");
  ASSERT_EQ(sent.size(), 1U);
  EXPECT_EQ(sent[0].payload,
            R"({"press1":[{"ts":1790000000001,"values":{"temp":23.4,"temp_bad":""}},)"
            R"({"ts":1790000000002,"values":{"temp":23.4}}]})");
  // The device that the config has no more.
  const auto last = history("press9");
  ASSERT_EQ(last.size(), 3U);
  EXPECT_EQ(last[0].topic, "v1/gateway/connect");
  EXPECT_EQ(last[2].topic, "v1/gateway/disconnect");
}

TEST_F(ThingsBoardProfileTest, FullHistoryTakesNoMoreAndForgetsNoReason) {
  const auto message = profile->begin_history(60);
  EXPECT_TRUE(message->add(Row(test::sample(1)).record));
  EXPECT_FALSE(message->add(Row(test::sample(2)).record));
  EXPECT_EQ(json::parse(message->take({"press1", "fast"}).at(0).payload)["press1"].size(), 1U);
}

TEST_F(ThingsBoardProfileTest, MethodIsACommand) {
  EXPECT_EQ(command_of(R"({"id":0,"method":"write","params":{"tag":"setpoint","value":50}})"),
            json::parse(R"({"op":"write","tag":"setpoint","value":50,"expires":1790000010000})"));
  EXPECT_EQ(command_of(R"({"id":0,"method":"set_setpoint","params":0.1})"),
            json::parse(R"({"op":"write","tag":"setpoint","value":0.1,"expires":1790000010000})"));
  EXPECT_EQ(command_of(R"({"id":0,"method":"get_temp"})"),
            json::parse(R"({"op":"read","tag":"temp","expires":1790000010000})"));
  EXPECT_EQ(command_of(R"({"id":0,"method":"run","params":null})"),
            json::parse(R"({"op":"run","expires":1790000010000})"));
  EXPECT_EQ(command_of(R"({"id":0,"method":"stop","params":{"expires":5}})"),
            json::parse(R"({"op":"stop","expires":5})"));
  EXPECT_EQ(command_of(R"({"id":0,"method":"reboot","params":{"now":true}})"),
            json::parse(R"({"op":"reboot","expires":1790000010000})"));
  EXPECT_EQ(
      command_of(R"({"id":0,"method":"stop","params":{"id":"mine","op":"run"}})"),
      json::parse(R"({"op":"stop","params.id":"mine","params.op":"run","expires":1790000010000})"));
  EXPECT_EQ(relayed.back().sender, "thingsboard@cloud");
  EXPECT_EQ(relayed.back().device, "press1");
  EXPECT_EQ(relayed.back().ops, std::string(kOpNames) + ", set_{tag}, get_{tag}");
}

TEST_F(ThingsBoardProfileTest, NumberThatWouldBecome0IsNotTranslated) {
  const std::string request =
      R"({"device":"press1","data":{"id":0,"method":"set_setpoint","params":1e-400}})";
  ask(request);
  EXPECT_EQ(relayed.back().payload, request) << "admission names the fault";
}

TEST_F(ThingsBoardProfileTest, DeadlineIsAtMostThatOfTheDevice) {
  plant.devices[0].commands.max_expiry = 2s;
  EXPECT_EQ(command_of(R"({"id":0,"method":"run"})")["expires"], 1790000002000);
}

TEST_F(ThingsBoardProfileTest, RetainedRequestIsARetainedCommand) {
  ask(R"({"device":"press1","data":{"id":0,"method":"run"}})", true);
  EXPECT_TRUE(relayed.at(0).retained);
}

TEST_F(ThingsBoardProfileTest, AnswerHasTheIdOfTheRequest) {
  ask(R"({"device":"press1","data":{"id":3,"method":"run"}})");
  relayed.at(0).reply(R"({"status":"SUCCEEDED"})");
  EXPECT_EQ(due(), (std::vector<std::string>{
                       R"(rpc {"device":"press1","id":3,"data":{"status":"SUCCEEDED"}})"}));
}

TEST_F(ThingsBoardProfileTest, AnswerIsOnlyForTheSessionOfItsRequest) {
  ask(R"({"device":"press1","data":{"id":0,"method":"run"}})");
  ask(R"({"device":"press1","data":{"id":1,"method":"run"}})");
  relayed.at(0).reply("{}");
  profile->connection_ended();
  profile->connection_began({});
  relayed.at(1).reply("{}");
  EXPECT_EQ(due(), std::vector<std::string>());
}

TEST_F(ThingsBoardProfileTest, FaultyRequestIsLeftToAdmission) {
  for (const std::string data :
       {R"({"id":0,"method":"write","params":{"tag":"setpoint","value":1,"value":2}})",
        R"({"id":0,"method":"write","params":{"tag":"a","value":[[[[[[[[1]]]]]]]]}})",
        R"({"id":0,"method":5})", R"({"id":0})"}) {
    const std::string message = R"({"device":"press1","data":)" + data + "}";
    ask(message);
    EXPECT_EQ(relayed.back().payload, message);
  }
}

TEST_F(ThingsBoardProfileTest, RequestWithoutAnAddressForItsAnswerIsIgnored) {
  for (const std::string text :
       {"", "x", "7", "[]", "{}", R"({"device":"press1","data":{"method":"run"}})",
        R"({"device":"press1","data":{"id":"0","method":"run"}})",
        R"({"device":7,"data":{"id":0,"method":"run"}})",
        // Its own answer, from a broker that sends it back.
        R"({"device":"press1","id":0,"data":{"id":"id-1","status":"SUCCEEDED"}})"})
    ask(text);
  ask(std::string(65537, '['));
  ask("{\"device\":\"press1\",\"data\":" + std::string(60000, '['));
  EXPECT_TRUE(relayed.empty());
}

TEST_F(ThingsBoardProfileTest, ReloadConnectsAndDisconnects) {
  profile->connection_began({});
  profile->device_state(online(0));
  due();
  ConfigChange change;
  change.devices_end = {0};
  change.devices_begin = {0};
  plant.devices[0].name = "press7";
  change.config = plant;
  profile->change(change);
  EXPECT_EQ(due(), (std::vector<std::string>{R"(disconnect {"device":"press1"})"}));
  profile->device_state(online(0));
  EXPECT_EQ(due().front(), R"(connect {"device":"press7","type":"default"})");
}

TEST_F(WithoutCommands, HearsNothing) {
  EXPECT_TRUE(profile->subscriptions().empty());
  ask(R"({"device":"press1","data":{"id":0,"method":"run"}})");
  EXPECT_EQ(ids, 0);
}

}  // namespace
}  // namespace fxagent
