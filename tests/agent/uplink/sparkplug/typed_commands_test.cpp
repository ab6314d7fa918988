#include "agent/uplink/sparkplug/typed_commands.h"

#include <gtest/gtest.h>

#include "tests/agent/uplink/plant.h"
#include "tests/agent/uplink/sparkplug/bytes.h"
#include "tests/support/says.h"

namespace fxagent {
namespace {

using namespace std::chrono_literals;

constexpr std::int64_t kSentMs = 1790000000000;
constexpr std::uint64_t kAll = ~std::uint64_t{0};

// A DCMD by hand, from the field numbers of sparkplug_c.proto: source "scada"; metric
// "Write/setpoint", data type 35, command with argument "value" (Int16, int32_value 7) and
// correlation id "c1".
constexpr const char* kRequest =
    "2A 05 73 63 61 64 61 "                             // 5: source
    "12 29 "                                            // 2: metric, 41 bytes
    "0A 0E 57 72 69 74 65 2F 73 65 74 70 6F 69 6E 74 "  //   1: name
    "20 23 "                                            //   4: datatype
    "62 15 "                                            //   12: command, 21 bytes
    "0A 0F 0A 05 76 61 6C 75 65 "                       //     1: argument: 1: name
    "5A 06 08 02 18 07 10 00 "  //       11: value: datatype 2, int32 7, not null
    "1A 02 63 31";              //     3: correlation id

std::uint64_t varint(std::string_view& bytes) {
  std::uint64_t value = 0;
  for (int shift = 0; !bytes.empty(); shift += 7) {
    const auto byte = static_cast<std::uint8_t>(bytes[0]);
    bytes.remove_prefix(1);
    value |= std::uint64_t{byte & 0x7FU} << shift;
    if ((byte & 0x80) == 0) break;
  }
  return value;
}

/// The fields of a message: numbers as text, everything else as its bytes. The last one of a
/// repeated field.
std::map<unsigned, std::string> fields(std::string_view bytes) {
  std::map<unsigned, std::string> found;
  while (!bytes.empty()) {
    const std::uint64_t key = varint(bytes);
    const std::uint64_t value = varint(bytes);
    const auto field = static_cast<unsigned>(key >> 3);
    if ((key & 7) == 0) {
      found[field] = std::to_string(value);
    } else {
      found[field] = std::string(bytes.substr(0, value));
      bytes.remove_prefix(std::min<std::size_t>(value, bytes.size()));
    }
  }
  return found;
}

struct TypedCommandsTest : testing::Test {
  TypedCommandsTest() { begin(""); }
  void begin(const std::string& host) {
    ProfileConfig what;
    what.kind = ProfileConfig::Kind::sparkplug_commands;
    what.group = "plant-a";
    what.node = "edge7";
    what.host = host;
    profile_.emplace(
        config_, what, [this](RelayedCommand command) { relayed_.push_back(std::move(command)); },
        [] { return kSentMs; });
  }
  void device(DeviceStatus::State state, std::uint32_t index = 0) {
    profile_->device_state(test::status_of(index, state));
  }
  void hear(const std::string& topic, const char* text, bool retained = false) {
    profile_->hear(test::message_on("spCv1.0/plant-a/" + topic, test::bytes(text), retained));
  }
  /// Returns "VERB/node/device seq" of all that is due.
  std::vector<std::string> due() {
    std::vector<std::string> found;
    for (const Publication& each : profile_->due(now_, kSentMs)) {
      EXPECT_EQ(each.qos, 0);
      EXPECT_EQ(each.retain, Retain::no);
      auto all = fields(each.payload);
      EXPECT_EQ(all[1], "1790000000000000000") << "nanoseconds";
      found.push_back(each.topic.substr(std::string("spCv1.0/plant-a/").size()) + " " + all[3]);
    }
    return found;
  }
  void rebirth(const char* payload = "2A 05 73 63 61 64 61") { hear("REBIRTH/edge7", payload); }

  using Lines = std::vector<std::string>;
  Config config_ = test::plant();
  SteadyTime now_ = SteadyTime(1h);
  std::vector<RelayedCommand> relayed_;
  std::optional<TypedCommandsProfile> profile_;
};

TEST_F(TypedCommandsTest, RebirthThatAHostAskedForRepeatsTheLastNumbers) {
  device(DeviceStatus::State::online);
  profile_->connection_began(Connected{});
  EXPECT_EQ(due(), (Lines{"NBIRTH/edge7 0", "DBIRTH/edge7/press1 1"}));
  for (int i = 0; i < 9; ++i) rebirth();
  // What is due meanwhile does not wait, and has numbers of its own.
  device(DeviceStatus::State::online, 1);
  EXPECT_EQ(due(), Lines{"DBIRTH/edge7/press2 2"});
  device(DeviceStatus::State::offline);
  EXPECT_EQ(due(), Lines{"DDEATH/edge7/press1 3"});
  EXPECT_EQ(profile_->next_wake(), now_ + 1s);
  now_ += 1s;
  EXPECT_EQ(due(), (Lines{"NREBIRTH/edge7 2", "DREBIRTH/edge7/press2 3"}));
  EXPECT_TRUE(due().empty());
  EXPECT_EQ(profile_->next_wake(), SteadyTime::max());
  device(DeviceStatus::State::online);
  EXPECT_EQ(due(), Lines{"DBIRTH/edge7/press1 4"});
  // What the library refused is missing in the order: the births begin anew.
  now_ += 1s;
  rebirth();
  profile_->due_was_refused();
  EXPECT_EQ(due(), (Lines{"NBIRTH/edge7 0", "DBIRTH/edge7/press1 1", "DBIRTH/edge7/press2 2"}));
  now_ += 1s;
  EXPECT_TRUE(due().empty()) << "the host has them";
}

/// After the births of the node and of press1.
struct TypedCommandsBorn : TypedCommandsTest {
  TypedCommandsBorn() {
    device(DeviceStatus::State::online);
    profile_->connection_began(Connected{});
    due();
  }
};

TEST_F(TypedCommandsBorn, DeviceThatAReloadRemovesDies) {
  hear("DCMD/edge7/press1", kRequest);
  rebirth();
  ConfigChange change;
  change.config = config_;
  change.devices_end = {0};
  profile_->change(change);
  EXPECT_EQ(due(), Lines{"DDEATH/edge7/press1 2"});
  hear("DCMD/edge7/press1", kRequest);
  EXPECT_EQ(relayed_.size(), 1U) << "it is no device any more";
  relayed_[0].reply(R"({"status":"REJECTED","reason":"reloading"})");
  EXPECT_EQ(due(), Lines{"DRESP/edge7/press1 "});
  EXPECT_EQ(due(), Lines{"DRESP/edge7/press1 "});
  now_ += 1s;
  EXPECT_EQ(due(), Lines{"NREBIRTH/edge7 2"});
}

TEST_F(TypedCommandsTest, BirthThatTheBrokerDoesNotAcceptLeavesNoGap) {
  device(DeviceStatus::State::online);
  Connected connected;
  connected.maximum_packet = 600;
  profile_->connection_began(connected);
  EXPECT_EQ(due(), Lines{"NBIRTH/edge7 0"});
  now_ += 1s;
  rebirth();
  EXPECT_EQ(due(), Lines{"NREBIRTH/edge7 0"});
}

TEST_F(TypedCommandsTest, RunAndStopAreCommandsIfAllowed) {
  config_.devices[0].commands.allow_run_stop = true;
  device(DeviceStatus::State::online);
  profile_->connection_began(Connected{});
  const auto births = profile_->due(now_, kSentMs);
  // The last metric of the birth.
  auto last = fields(fields(births.at(1).payload)[2]);
  EXPECT_EQ(last[1] + " " + last[4], "Stop 35");
  EXPECT_NE(births[1].payload.find(test::bytes("0A 03 52 75 6E")), std::string::npos) << "Run";
  hear("DCMD/edge7/press1", "2A 01 68 12 0B 0A 03 52 75 6E 62 04 1A 02 63 31");
  ASSERT_EQ(relayed_.size(), 1U);
  EXPECT_EQ(relayed_[0].payload, R"({"id":"h/c1","op":"run"})");
}

TEST_F(TypedCommandsTest, WillHasTheNumberOfTheSessionAlone) {
  profile_->last_will();  // of an attempt that failed
  for (const char* session : {"0", "1", "2"}) {
    const Publication will = profile_->last_will();
    EXPECT_EQ(will.topic, "spCv1.0/plant-a/NDEATH/edge7");
    EXPECT_EQ(will.retain, Retain::no);
    EXPECT_EQ(fields(will.payload), (std::map<unsigned, std::string>{{4, session}}));
    profile_->connection_began(Connected{});
    EXPECT_EQ(fields(profile_->due(now_, kSentMs)[0].payload)[4], session);
    EXPECT_EQ(profile_->farewell(kSentMs)[0].payload, will.payload);
    profile_->connection_ended();
  }
  EXPECT_TRUE(profile_->farewell(kSentMs).empty()) << "not born";
}

TEST_F(TypedCommandsBorn, RequestIsOneCommandAndItsResultTheAnswer) {
  hear("DCMD/edge7/press1", kRequest);
  ASSERT_EQ(relayed_.size(), 1U);
  EXPECT_EQ(relayed_[0].device, "press1");
  EXPECT_EQ(relayed_[0].sender, "sparkplug-commands/scada");
  EXPECT_EQ(relayed_[0].payload, R"({"id":"scada/c1","op":"write","tag":"setpoint","value":7})");
  EXPECT_TRUE(due().empty()) << "no answer before the result";
  relayed_[0].reply(
      R"({"id":"scada/c1","status":"SUCCEEDED","reason":null,"detail":null,"plc":"ACK","value":7})");
  const auto messages = profile_->due(now_, kSentMs);
  ASSERT_EQ(messages.size(), 1U);
  EXPECT_EQ(messages[0].topic, "spCv1.0/plant-a/DRESP/edge7/press1");
  auto packet = fields(messages[0].payload);
  EXPECT_FALSE(packet.contains(3)) << "an answer has no seq";
  auto metric = fields(packet[2]);
  EXPECT_EQ(metric[1], "Write/setpoint");
  EXPECT_EQ(metric[4], "35");
  auto command = fields(metric[12]);
  EXPECT_EQ(command[3], "c1");
  EXPECT_EQ(fields(command[4])[1], "0");
  EXPECT_EQ(fields(command[4])[2], "SUCCEEDED, ACK");
  auto result = fields(command[2]);
  EXPECT_EQ(result[1], "value");
  EXPECT_EQ(fields(result[11]), (std::map<unsigned, std::string>{{1, "2"}, {3, "7"}}));
}

TEST_F(TypedCommandsTest, ResultHasTheTypeOfItsTag) {
  DeviceConfig& press = config_.devices[0];
  const auto answered = [&](DataType type, bool is_array, const std::string& value) {
    press.tags[test::setpoint].point.type = type;
    press.tags[test::setpoint].point.is_array = is_array;
    hear("DCMD/edge7/press1", kRequest);
    relayed_.back().reply(R"({"status":"SUCCEEDED","value":)" + value + "}");
    const auto answer = profile_->due(now_, kSentMs).at(0);
    return fields(fields(fields(fields(fields(answer.payload)[2])[12])[2])[11]);
  };
  using Fields = std::map<unsigned, std::string>;
  const std::string most = std::to_string(kAll);
  profile_->connection_began(Connected{});
  due();
  EXPECT_EQ(answered(DataType::int64, false, R"("-9007199254740993")"),
            (Fields{{1, "4"}, {4, std::to_string(kAll - 9007199254740992U)}}));
  EXPECT_EQ(answered(DataType::uint64, false, '"' + most + '"'), (Fields{{1, "8"}, {6, most}}));
  EXPECT_EQ(answered(DataType::uint32, false, "4294967295"), (Fields{{1, "7"}, {5, "4294967295"}}));
  EXPECT_EQ(answered(DataType::boolean, false, "true"), (Fields{{1, "11"}, {9, "1"}}));
  EXPECT_EQ(answered(DataType::string, false, R"("7")"), (Fields{{1, "12"}, {10, "7"}}));
  EXPECT_EQ(answered(DataType::int16, true, "[1,-1]"),
            (Fields{{1, "23"}, {11, test::bytes("01 00 FF FF")}}));
  EXPECT_EQ(answered(DataType::int16, false, "null"), (Fields{{1, "2"}, {2, "1"}})) << "is_null";
}

TEST_F(TypedCommandsTest, EachStatusHasACodeOfItsOwn) {
  profile_->connection_began(Connected{});
  due();
  std::vector<std::string> codes;
  for (const char* word :
       {"SUCCEEDED", "FAILED", "PARTIAL", "REJECTED", "EXPIRED", "DUPLICATE", "UNKNOWN_OUTCOME"}) {
    hear("DCMD/edge7/press1", kRequest);
    relayed_.back().reply(R"({"status":")" + std::string(word) + R"(","reason":"x","detail":"y"})");
    const auto answer = profile_->due(now_, kSentMs).at(0);
    const auto status = fields(fields(fields(fields(answer.payload)[2])[12])[4]);
    EXPECT_EQ(status.at(2), std::string(word) + ": x: y");
    codes.push_back(status.at(1));
  }
  EXPECT_EQ(codes, (Lines{"0", "1", "2", "3", "4", "5", "6"}));
}

TEST_F(TypedCommandsBorn, AnswerOfAnOutageFollowsTheBirthsOfTheNextSession) {
  hear("DCMD/edge7/press1", kRequest);
  profile_->connection_ended();
  relayed_[0].reply(R"({"status":"SUCCEEDED","value":7})");
  EXPECT_TRUE(due().empty());
  profile_->connection_began(Connected{});
  EXPECT_EQ(due(), (Lines{"NBIRTH/edge7 0", "DBIRTH/edge7/press1 1"}));
  EXPECT_EQ(due(), Lines{"DRESP/edge7/press1 "});
}

TEST_F(TypedCommandsTest, AnswersThatWaitOutliveTheConnection) {
  profile_->connection_began(Connected{});
  due();
  for (int i = 0; i < 3; ++i) hear("DCMD/edge7/other", kRequest);
  EXPECT_EQ(due(), Lines{"DRESP/edge7/other "});
  profile_->connection_ended();
  Connected connected;
  connected.maximum_packet = 700;
  profile_->connection_began(connected);
  EXPECT_EQ(due(), Lines{"NBIRTH/edge7 0"});
  EXPECT_EQ(due(), Lines{"DRESP/edge7/other "});
  profile_->connection_ended();
  connected.maximum_packet = 550;
  profile_->connection_began(connected);
  EXPECT_EQ(due(), Lines{"NBIRTH/edge7 0"});
  EXPECT_TRUE(due().empty()) << "too large for this broker";
}

TEST_F(TypedCommandsBorn, HostileMessagesAreNoCommands) {
  now_ += 1s;
  hear("DCMD/edge7/press1", "FF FF FF");
  hear("DCMD/edge7/press1", "");
  hear("DCMD/edge7/press1", "12 02 20 23");              // without a command
  hear("DCMD/edge7/press1", "12 06 0A 04 74 65 6D 70");  // a value, as in payload B
  hear("DCMD/edge7/", kRequest);
  std::string many;
  for (int i = 0; i < 65; ++i) many += "12 02 62 00 ";
  hear("DCMD/edge7/press1", many.c_str());
  hear("REBIRTH/edge7", "FF");
  hear("REBIRTH/edge7", "", /*retained=*/true);
  profile_->hear(test::message_on(
      "spCv1.0/plant-a/DCMD/edge7/press1",
      std::string("\x12\x02\x62\x00\x2A\x80\x80\x04", 8) + std::string(65536, 'x')));
  EXPECT_TRUE(relayed_.empty());
  EXPECT_TRUE(due().empty());
  // This one has nothing but a command, and is answered.
  hear("DCMD/edge7/press1", "12 02 62 00");
  ASSERT_EQ(relayed_.size(), 1U);
  EXPECT_EQ(relayed_[0].payload, R"({"op":""})") << "admission refuses it";
}

TEST_F(TypedCommandsTest, WhileItsHostIsOfflineTheNodeDoesNothing) {
  begin("scada");
  device(DeviceStatus::State::online);
  profile_->connection_began(Connected{});
  hear("DCMD/edge7/press1", kRequest);
  EXPECT_TRUE(relayed_.empty());
  EXPECT_TRUE(due().empty());
  profile_->hear(test::message_on("spCv1.0/STATE/scada",
                                  R"({"online": true, "timestamp": 1790000000000000000})"));
  hear("DCMD/edge7/press1", kRequest);
  EXPECT_EQ(relayed_.size(), 1U);
  EXPECT_EQ(due(), (Lines{"NBIRTH/edge7 0", "DBIRTH/edge7/press1 1"}));
}

/// Returns the JSON of the command that a request of this source and correlation id makes; the
/// argument is bytes.
struct TypedRequest : TypedCommandsTest {
  TypedRequest() {
    profile_->connection_began(Connected{});
    due();
  }
  static std::string field(char key, const std::string& content) {
    return std::string(1, key) + static_cast<char>(content.size()) + content;
  }
  std::string command(const std::string& source, const std::string& id,
                      const std::string& argument = {}) {
    std::string parts = field('\x1A', id);
    if (!argument.empty()) parts = field('\x0A', argument) + parts;
    profile_->hear(test::message_on(
        "spCv1.0/plant-a/DCMD/edge7/press1",
        field('\x2A', source) +
            field('\x12', field('\x0A', "Write/setpoint") + field('\x62', parts))));
    return relayed_.empty() ? "" : relayed_.back().payload;
  }
  /// Returns the value that the command would write.
  std::string value(const char* typed_value, const char* before = "") {
    const std::string payload = command(
        "h", "c",
        field('\x0A', "value") + test::bytes(before) + field('\x5A', test::bytes(typed_value)));
    const auto at = payload.find(R"("value":)");
    return payload.substr(at + 8, payload.size() - at - 9);
  }
};

TEST_F(TypedRequest, IdsOfDifferentRequestsDiffer) {
  const auto id = [this](const std::string& source, const std::string& correlation_id) {
    const std::string payload = command(source, correlation_id);
    return payload.substr(0, payload.find(R"(,"op")"));
  };
  EXPECT_EQ(id("scada", "17"), R"({"id":"scada/17")");
  std::set<std::string> ids;
  const std::string longest(59, 'x');
  const std::vector<std::pair<std::string, std::string>> requests{{"a/b", "c"},
                                                                  {"a", "b/c"},
                                                                  {"a/", "bc"},
                                                                  {"h\xC3\xB6st", "1"},
                                                                  {"host", "1"},
                                                                  {"scada", longest},
                                                                  {"scad", longest + "yz"},
                                                                  {"scada", longest + "y"}};
  for (const auto& [source, correlation_id] : requests) {
    const std::string made = id(source, correlation_id);
    EXPECT_TRUE(ids.insert(made).second) << made;
    EXPECT_LE(made.size(), std::string(R"({"id":"")").size() + 64);
    for (const char c : made) EXPECT_TRUE(c >= ' ' && c <= '~') << made;
  }
  EXPECT_EQ(id("", "c"), "{\"op\":\"write\",\"tag\":\"setpoint\"}");
  EXPECT_EQ(id("a", ""), "{\"op\":\"write\",\"tag\":\"setpoint\"}");
}

TEST_F(TypedRequest, ArgumentThatCannotBeReadIsNotAbsent) {
  EXPECT_EQ(value("18 07"), "7");
  EXPECT_EQ(value("08 04 20 07"), "7") << "an Int64";
  EXPECT_EQ(value("08 02"), "{}") << "no value";
  EXPECT_EQ(value("10 01 18 07"), "{}") << "is_null";
  EXPECT_EQ(value("62 02 08 01"), "{}") << "a data set";
  EXPECT_EQ(value("41 00 00 00 00 00 00 F8 7F"), "{}") << "not a number";
  EXPECT_EQ(value("5A 02 07 00"), "{}") << "bytes for an integer";
  config_.devices[0].tags[test::setpoint].point.is_array = true;
  EXPECT_EQ(value("5A 04 07 00 FF FF"), "[7,-1]") << "no data type";
  EXPECT_EQ(value("08 17 5A 04 07 00 FF FF"), "[7,-1]");
  EXPECT_EQ(value("5A 04 07 00 FF FF", "20 17"), "[7,-1]");
  EXPECT_EQ(value("08 18 5A 04 07 00 FF FF"), "{}") << "an Int32Array";
  EXPECT_EQ(value("5A 04 07 00 FF FF", "20 18"), "{}");
  EXPECT_EQ(value("08 00 5A 04 07 00 FF FF", "20 18"), "{}");
  EXPECT_EQ(value("08 17 5A 03 07 00 FF"), "{}") << "half an element";
}

TEST_F(TypedRequest, NoAnswerIsWithoutABound) {
  hear("DCMD/edge7/" + std::string(257, 'x'), kRequest);
  EXPECT_TRUE(due().empty());
  for (int i = 0; i < 300; ++i) hear("DCMD/edge7/other", kRequest);
  std::size_t answers = 0;
  while (!due().empty()) ++answers;
  EXPECT_EQ(answers, 200U);
  hear("DCMD/edge7/other", kRequest);
  EXPECT_EQ(due(), Lines{"DRESP/edge7/other "});
  for (const char* topic : {"DCMD/edge7/other", "DCMD/edge7/press1", "NCMD/edge7"})
    hear(topic, kRequest, /*retained=*/true);
  EXPECT_TRUE(relayed_.empty());
  EXPECT_TRUE(due().empty()) << "one in each connection";
  hear("NCMD/edge7", kRequest);
  EXPECT_EQ(due(), Lines{"NRESP/edge7 "});
}

TEST_F(TypedRequest, WordsOfTheAgentAreNoCommands) {
  for (const char* name :
       {"12 0E 0A 04 72 65 61 64 62 06 1A 04 63 63 63 63",                 // read
        "12 12 0A 08 66 6F 72 63 65 5F 6F 6E 62 06 1A 04 63 63 63 63"}) {  // force_on
    hear("DCMD/edge7/press1", (std::string("2A 01 68 ") + name).c_str());
    test::expect_says(relayed_.back().payload, R"("op":"DCMD )");
  }
  hear("DCMD/edge7/press1", "2A 01 68 12 10 0A 06 52 65 62 6F 6F 74 62 06 1A 04 63 63 63 63");
  test::expect_says(relayed_.back().payload, R"("op":"Reboot")");
  EXPECT_EQ(relayed_.back().ops, "Write/{tag}, Run, Stop");
}

}  // namespace
}  // namespace fxagent
