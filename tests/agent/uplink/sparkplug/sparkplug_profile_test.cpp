#include "agent/uplink/sparkplug/sparkplug_profile.h"

#include <gtest/gtest.h>

#include "agent/store/samples/sample_record.h"
#include "agent/uplink/sparkplug/edge_node.h"
#include "tests/agent/uplink/plant.h"
#include "tests/agent/uplink/sparkplug/bytes.h"

namespace fxagent {
namespace {

using namespace std::chrono_literals;
using sparkplug::PrimaryHost;
using test::bytes;

constexpr std::int64_t kBornMs = 1790000000000;

// Frames of a gateway's manual: Elecsys, Sparkplug-B MQTT payload format.
constexpr const char* kRebirth =
    "08 9f af b8 f8 8d 31 12 23 0a 14 4E 6F 64 65 20 43 6F 6E 74 72 6F 6C 2F 52 65 62 69 72 74 68 "
    "18 9f af b8 f8 8d 31 20 0b 38 00 70 01 18 ff ff ff ff ff ff ff ff ff 01";
// Alias 47002 = 15.
constexpr const char* kWrite =
    "08 c0 b8 d8 9e 8e 31 12 0f 10 9a ef 02 18 c0 b8 d8 9e 8e 31 20 03 50 0f 18 ff ff ff ff ff ff "
    "ff ff ff 01";

struct SparkplugTest : testing::Test {
  SparkplugTest() {
    ProfileConfig what;
    what.kind = ProfileConfig::Kind::sparkplug;
    what.group = "plant-a";
    what.node = "edge7";
    what.host = host_;
    profile_.emplace(
        config_, what, [this](RelayedCommand command) { relayed_.push_back(std::move(command)); },
        [] { return std::string("id-1"); }, [] { return kBornMs; });
  }
  void device(DeviceStatus::State state, std::uint32_t index = 0) {
    profile_->device_state(test::status_of(index, state));
  }
  void hear(const std::string& topic, std::string payload, bool retained = false) {
    profile_->hear(test::message_on(topic, std::move(payload), retained));
  }
  /// Returns the topics that are due, without what all have in common.
  std::vector<std::string> due() {
    std::vector<std::string> topics;
    for (const Publication& each : profile_->due(now_, kBornMs)) {
      EXPECT_EQ(each.qos, 0);
      EXPECT_EQ(each.retain, Retain::no);
      topics.push_back(each.topic.substr(std::string("spBv1.0/plant-a/").size()));
    }
    return topics;
  }

  using Topics = std::vector<std::string>;
  const std::string host_;
  Config config_ = test::plant();
  SteadyTime now_ = SteadyTime(1h);
  std::vector<RelayedCommand> relayed_;
  std::optional<SparkplugProfile> profile_;
};

TEST_F(SparkplugTest, NodeIsBornBeforeItsLivingDevices) {
  profile_->last_will();
  device(DeviceStatus::State::online);
  device(DeviceStatus::State::offline, 1);
  profile_->connection_began(Connected{});
  EXPECT_FALSE(profile_->is_ready());
  EXPECT_EQ(due(), (Topics{"NBIRTH/edge7", "DBIRTH/edge7/press1"}));
  EXPECT_TRUE(profile_->is_ready());
  EXPECT_TRUE(due().empty());
  device(DeviceStatus::State::degraded, 1);
  EXPECT_EQ(due(), Topics{"DBIRTH/edge7/press2"});
  device(DeviceStatus::State::yielded);
  EXPECT_EQ(due(), Topics{"DDEATH/edge7/press1"});
}

TEST_F(SparkplugTest, RebirthOfACaptureIsCarriedOutOnceASecond) {
  profile_->connection_began(Connected{});
  due();
  for (int i = 0; i < 5; ++i) hear("spBv1.0/plant-a/NCMD/edge7", bytes(kRebirth));
  EXPECT_FALSE(profile_->is_ready()) << "no data before the births";
  EXPECT_TRUE(due().empty());
  EXPECT_EQ(profile_->next_wake(), now_ + 1s);
  now_ += 1s;
  EXPECT_EQ(due(), Topics{"NBIRTH/edge7"});
  EXPECT_TRUE(due().empty());
  hear("spBv1.0/plant-a/NCMD/edge7", bytes(kRebirth), /*retained=*/true);
  EXPECT_TRUE(profile_->is_ready());
}

TEST_F(SparkplugTest, HostileCommandsAreIgnored) {
  device(DeviceStatus::State::online);
  profile_->connection_began(Connected{});
  due();
  const std::string topic = "spBv1.0/plant-a/DCMD/edge7/press1";
  hear(topic, bytes(kWrite));  // an alias that is not ours
  hear(topic, "no protobuf");
  hear(topic, "");
  hear("spBv1.0/plant-a/DCMD/edge7/press9", bytes(kWrite));
  hear("spBv1.0/plant-a/DCMD/edge7/", bytes(kWrite));
  hear("spBv1.0/plant-a/NCMD/edge7", bytes(kWrite));
  hear("spBv1.0/plant-a/NCMD/edge7", std::string(3, '\xFF'));
  EXPECT_TRUE(relayed_.empty());
  EXPECT_TRUE(due().empty());
}

TEST_F(SparkplugTest, ArrayIsWrittenInItsOwnTypeOnly) {
  config_.devices[0].tags[test::setpoint].point.is_array = true;
  profile_->connection_began(Connected{});
  due();
  const std::string topic = "spBv1.0/plant-a/DCMD/edge7/press1";
  const std::string name = "0A 08 73 65 74 70 6F 69 6E 74 ";  // setpoint
  const std::string array = "82 01 04 07 00 FF FF";           // bytes_value
  hear(topic, bytes("12 11 " + name + array));                // no data type
  hear(topic, bytes("12 13 " + name + "20 17 " + array));     // Int16Array
  hear(topic, bytes("12 13 " + name + "20 18 " + array));     // Int32Array
  hear(topic, bytes("12 13 " + name + "38 01 " + array));     // is_null
  hear(topic, bytes("12 10 " + name + "82 01 03 07 00 FF"));  // half an element
  ASSERT_EQ(relayed_.size(), 2U);
  for (const RelayedCommand& each : relayed_)
    EXPECT_EQ(each.payload, R"({"id":"id-1","op":"write","tag":"setpoint","value":[7,-1]})");
}

TEST_F(SparkplugTest, IntegerHasTheSignOfItsOwnDataType) {
  Point& point = config_.devices[0].tags[test::setpoint].point;
  const std::string name = "0A 08 73 65 74 70 6F 69 6E 74 ";  // setpoint
  const std::string minus5 = "50 FB FF FF FF 0F ";            // int_value
  const std::string long_minus5 = "58 FB FF FF FF FF FF FF FF FF 01 ";
  const std::string large = "50 80 BC C1 96 0B ";  // 3000000000
  struct Case {
    std::string type;  // of the metric; empty: none
    std::string value;
    DataType tag;
    double scale;
    std::string expected;
  };
  for (const Case& each : {Case{"20 03 ", minus5, DataType::uint32, 1, "-5"},
                           Case{"20 04 ", long_minus5, DataType::uint64, 1, "-5"},
                           Case{"20 07 ", large, DataType::int64, 1, "3000000000"},
                           Case{"20 07 ", large, DataType::float64, 1, "3000000000"},
                           Case{"20 07 ", large, DataType::int32, 0.1, "3000000000"},
                           Case{"20 08 ", long_minus5, DataType::int64, 1, "18446744073709551611"},
                           Case{"20 01 ", "50 FB 01 ", DataType::int32, 1, "-5"},
                           Case{"20 01 ", minus5, DataType::int32, 1, "-5"},
                           Case{"20 02 ", "50 FB FF 03 ", DataType::int32, 1, "-5"},
                           Case{"20 02 ", minus5, DataType::uint16, 1, "-5"},
                           Case{"20 06 ", "50 FB FF 03 ", DataType::int16, 1, "65531"},
                           Case{"", "50 FB FF 03 ", DataType::int16, 1, "-5"},
                           Case{"", "50 FB FF 03 ", DataType::int32, 1, "65531"},
                           Case{"20 03 ", "50 02 ", DataType::boolean, 1, "2"},
                           Case{"20 04 ", long_minus5, DataType::string, 1, "-5"},
                           Case{"", minus5, DataType::int32, 1, "-5"},
                           Case{"", minus5, DataType::uint32, 1, "4294967291"}}) {
    SCOPED_TRACE(each.type + "to " + std::string(to_string(each.tag)));
    point.type = each.tag;
    point.scale = each.scale;
    const std::string metric = bytes(name + each.type + each.value);
    hear("spBv1.0/plant-a/DCMD/edge7/press1",
         "\x12" + std::string(1, static_cast<char>(metric.size())) + metric);
    ASSERT_FALSE(relayed_.empty());
    EXPECT_EQ(relayed_.back().payload,
              R"({"id":"id-1","op":"write","tag":"setpoint","value":)" + each.expected + "}");
  }
}

TEST_F(SparkplugTest, SessionsAreCountedFrom0To255) {
  Publication first = profile_->last_will();
  EXPECT_EQ(first.topic, "spBv1.0/plant-a/NDEATH/edge7");
  EXPECT_EQ(first.retain, Retain::no);
  std::vector<std::string> wills{first.payload};
  EXPECT_EQ(profile_->last_will().payload, wills[0]) << "the first attempt failed";
  const auto next = [&] {
    profile_->connection_began(Connected{});
    profile_->connection_ended();
    return profile_->last_will().payload;
  };
  for (int i = 1; i < 256; ++i) wills.push_back(next());
  EXPECT_NE(wills[1], wills[0]);
  EXPECT_EQ(next(), wills[0]) << "255 is followed by 0";
}

/// Returns `seq`, field 3 and the last of a payload.
unsigned seq_of(const Publication& message) {
  const std::string& bytes = message.payload;
  const bool is_long = static_cast<unsigned char>(bytes.back()) == 1 && bytes.size() >= 3 &&
                       bytes[bytes.size() - 3] == '\x18';
  const std::size_t at = bytes.size() - (is_long ? 2 : 1);
  EXPECT_EQ(bytes[at - 1], '\x18') << "field 3, varint";
  const unsigned low = static_cast<unsigned char>(bytes[at]);
  return is_long ? (low & 0x7F) | 0x80 : low;
}

TEST_F(SparkplugTest, MessagesOfASessionAreCountedFrom0To255AndOn) {
  profile_->connection_began(Connected{});
  unsigned expected = 0;
  for (int i = 0; i < 300; ++i) {
    device(i % 2 == 0 ? DeviceStatus::State::online : DeviceStatus::State::offline);
    for (const Publication& each : profile_->due(now_, kBornMs)) {
      ASSERT_EQ(seq_of(each), expected) << each.topic;
      expected = (expected + 1) % 256;
    }
  }
  EXPECT_EQ(expected, 301U % 256) << "NBIRTH, and each birth and death of the device";
}

TEST_F(SparkplugTest, ChangedDeviceDiesAndIsBornWithNewAliases) {
  device(DeviceStatus::State::online);
  profile_->connection_began(Connected{});
  due();
  ConfigChange change;
  change.config = config_;
  change.devices_end = {0};
  change.devices_begin = {0};
  profile_->change(change);
  EXPECT_EQ(due(), Topics{"DDEATH/edge7/press1"});
  device(DeviceStatus::State::online);
  EXPECT_EQ(due(), Topics{"DBIRTH/edge7/press1"});
}

TEST_F(SparkplugTest, BirthThatTheBrokerDoesNotAcceptLeavesNoGap) {
  device(DeviceStatus::State::online);
  Connected connected;
  connected.maximum_packet = 600;
  profile_->connection_began(connected);
  EXPECT_EQ(due(), Topics{"NBIRTH/edge7"});
}

TEST(SparkplugHost, OnlyItsOwnNewestStateCounts) {
  PrimaryHost host("spBv1.0/STATE/scada", /*old_state=*/false);
  EXPECT_FALSE(host.is_online());
  EXPECT_FALSE(host.is_offline());
  host.hear(R"({"online": true, "timestamp": 100})");
  EXPECT_TRUE(host.is_online());
  host.hear(R"({"online": false, "timestamp": 99})");
  EXPECT_TRUE(host.is_online()) << "older than its last online state";
  for (const char* text : {"OFFLINE", "{}", "[]", "", R"({"online": 0, "timestamp": 200})",
                           R"({"online": false})", R"({"online": false, "timestamp": "200"})"})
    host.hear(text);
  EXPECT_TRUE(host.is_online());
  host.hear(R"({"online": false, "timestamp": 100})");
  EXPECT_TRUE(host.is_offline());
  host.hear(R"({"online": true, "timestamp": 99})");
  EXPECT_TRUE(host.is_offline());
}

TEST(SparkplugHost, StateBeforeSparkplug3IsAWord) {
  PrimaryHost host("STATE/scada", /*old_state=*/true);
  host.hear("ONLINE");
  EXPECT_TRUE(host.is_online());
  host.hear(R"({"online": false, "timestamp": 1})");
  EXPECT_TRUE(host.is_online());
  host.hear("OFFLINE");
  EXPECT_TRUE(host.is_offline());
}

TEST(SparkplugHost, WithoutAHostNobodyIsWaitedFor) {
  EXPECT_TRUE(PrimaryHost("", false).is_online());
}

}  // namespace
}  // namespace fxagent
