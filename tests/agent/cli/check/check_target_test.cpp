#include "agent/cli/check/check_target.h"
#include "agent/config/loader.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "tests/support/says.h"

namespace fxagent {
namespace {

using Severity = TargetFinding::Severity;

/// A config that every target accepts, except for `change`, which replaces the text `old`.
std::string plant(const std::string& old = "", const std::string& change = "") {
  std::string text = R"({
"agent": {"id": "edge7", "root": "fx"},
"mqtt": {
  "servers": ["mqtts://broker:8883"],
  "version": "3.1.1",
  "username": "edge7",
  "password_file": "/run/secrets/mqtt",
  "tls": {"cert_file": "/etc/fxagent/cert.pem", "key_file": "/etc/fxagent/key.pem"}
},
"links": [{"name": "line1", "serial": {"path": "/dev/ttyUSB0"}}],
"devices": [
  {"name": "press1", "link": "line1", "protocol": "modbus-rtu", "unit": 1,
   "groups": [{"name": "fast", "interval_ms": 1000}],
   "tags": [{"name": "temp", "address": "hr:0", "group": "fast"}]}
]
})";
  if (old.empty()) return text;
  const std::size_t at = text.find(old);
  EXPECT_NE(at, text.npos) << old;
  return text.replace(at, old.size(), change);
}

std::vector<TargetFinding> findings(const std::string& target, const std::string& text) {
  const auto config = parse_config(text);
  EXPECT_TRUE(config.has_value()) << (config ? "" : config.error().front().text);
  EXPECT_EQ(target_fault(target), "");
  return config ? target_findings(*config, text, target) : std::vector<TargetFinding>{};
}

/// Returns "LINE POINTER" of each finding of this severity.
std::vector<std::string> places(const std::vector<TargetFinding>& found, Severity severity) {
  std::vector<std::string> out;
  for (const TargetFinding& finding : found)
    if (finding.severity == severity)
      out.push_back(std::to_string(finding.error.line) + " " + finding.error.pointer);
  return out;
}

using Places = std::vector<std::string>;

Places refused(const std::string& target, const std::string& text) {
  return places(findings(target, text), Severity::refused);
}
Places warned(const std::string& target, const std::string& text) {
  return places(findings(target, text), Severity::warning);
}

/// Returns the text of the only refusal.
std::string refusal(const std::string& target, const std::string& text) {
  std::vector<TargetFinding> found = findings(target, text);
  std::erase_if(found, [](const TargetFinding& one) { return one.severity != Severity::refused; });
  EXPECT_EQ(found.size(), 1U);
  return found.size() == 1 ? found.front().error.text : "";
}

/// Returns tags hr:0 … of one group, each with `more`.
std::string tags(std::size_t count, const std::string& more = "") {
  std::string out;
  for (std::size_t i = 0; i < count; ++i)
    out += (i == 0 ? "" : ",") + std::string(R"({"name": "tag)") + std::to_string(i) +
           R"(", "address": "hr:)" + std::to_string(i) + R"(", "group": "fast")" + more + "}";
  return out;
}
const std::string kTag = R"({"name": "temp", "address": "hr:0", "group": "fast"})";
const std::string kGroup = R"({"name": "fast", "interval_ms": 1000})";
const std::string kVersion = R"("version": "3.1.1",)";
const std::string kVersion5 = R"("version": "5",)";
const std::string kRoot = R"("root": "fx")";
const std::string kServer = "mqtts://broker:8883";
const std::string kTls =
    R"("tls": {"cert_file": "/etc/fxagent/cert.pem", "key_file": "/etc/fxagent/key.pem"})";

TEST(CheckTarget, EveryTargetAcceptsAPlainConfig) {
  for (const std::string target : {"aws", "azure", "hivemq", "nats", "rabbitmq"})
    EXPECT_EQ(refused(target, plant()), Places{}) << target;
}

TEST(CheckTarget, AnUnknownTargetNamesTheOthers) {
  test::expect_says(target_fault("iothub"), "Event Grid");
  test::expect_says(target_fault("rabitmq"), "did you mean rabbitmq");
  test::expect_says(target_fault("kafka"), "aws, azure, hivemq, nats and rabbitmq");
}

TEST(CheckTarget, OldBrokersRefuseMqtt5) {
  for (const std::string target : {"nats", "rabbitmq"})
    EXPECT_EQ(refused(target, plant(kVersion, kVersion5)), Places{"5 /mqtt/version"}) << target;
  for (const std::string target : {"aws", "azure", "hivemq"})
    EXPECT_EQ(refused(target, plant(kVersion, kVersion5)), Places{}) << target;
  // The place of a default is the section that lacks the key.
  EXPECT_EQ(refused("nats", plant(kVersion, "")), Places{"3 /mqtt/version"});
}

TEST(CheckTarget, CloudsRefuseAConnectionWithoutTls) {
  for (const std::string target : {"aws", "azure", "hivemq"})
    EXPECT_EQ(refused(target, plant(kServer, "mqtt://broker:1883")), Places{"4 /mqtt/servers/0"})
        << target;
  EXPECT_EQ(refused("nats", plant(kServer, "mqtt://broker:1883")), Places{});
}

TEST(CheckTarget, CloudsHavePortsWithoutPlainMqtt) {
  test::expect_says(refusal("aws", plant(kServer, "mqtts://broker:443")), "ALPN");
  EXPECT_EQ(refused("azure", plant(kServer, "mqtts://broker:443")), Places{"4 /mqtt/servers/0"});
  EXPECT_EQ(refused("hivemq", plant(kServer, "mqtts://broker:8884")), Places{"4 /mqtt/servers/0"});
}

TEST(CheckTarget, EachCloudHasItsProofOfIdentity) {
  const std::string no_certificate = plant(kTls, R"("tls": {})");
  EXPECT_EQ(refused("aws", no_certificate), Places{"8 /mqtt/tls"});
  EXPECT_EQ(refused("azure", no_certificate), Places{});  // a webhook may accept the password
  EXPECT_EQ(refused("hivemq", no_certificate), Places{});

  const std::string no_password = plant(R"("password_file": "/run/secrets/mqtt",)", "");
  EXPECT_EQ(refused("aws", no_password), Places{});
  EXPECT_EQ(refused("azure", no_password), Places{});
  EXPECT_EQ(refused("hivemq", no_password), Places{"3 /mqtt"});

  const std::string neither =
      plant("\"password_file\": \"/run/secrets/mqtt\",\n  " + kTls, R"("tls": {})");
  EXPECT_EQ(refused("azure", neither), Places{"7 /mqtt/tls"});
}

TEST(CheckTarget, AzureAndRabbitMqNeedAUser) {
  const std::string anonymous =
      plant("\"username\": \"edge7\",\n  \"password_file\": \"/run/secrets/mqtt\",", "");
  EXPECT_EQ(warned("azure", anonymous), Places{"3 /mqtt/username"});
  EXPECT_EQ(warned("rabbitmq", anonymous), (Places{"3 /mqtt", "3 /mqtt/username"}));
  for (const std::string server : {"mqtt://localhost", "mqtts://127.0.0.1", "mqtt://[::1]"}) {
    std::string local = anonymous;
    local.replace(local.find(kServer), kServer.size(), server);
    EXPECT_EQ(warned("rabbitmq", local), Places{"3 /mqtt"}) << server;
  }
}

TEST(CheckTarget, ClientIdsAreLimited) {
  const auto client = [](std::size_t bytes) {
    return plant(kVersion, kVersion + R"( "client_id": ")" + std::string(bytes, 'c') + "\",");
  };
  EXPECT_EQ(refused("aws", client(128)), Places{});
  EXPECT_EQ(refused("aws", client(129)), Places{"5 /mqtt/client_id"});
  EXPECT_EQ(refused("nats", client(129)), Places{});
}

TEST(CheckTarget, KeepAliveIsLimited) {
  const auto keep_alive = [](int s) {
    return plant(kVersion, kVersion + R"( "keep_alive_s": )" + std::to_string(s) + ",");
  };
  EXPECT_EQ(refused("azure", keep_alive(1160)), Places{});
  EXPECT_EQ(refused("azure", keep_alive(1161)), Places{"5 /mqtt/keep_alive_s"});
  EXPECT_EQ(refused("aws", keep_alive(1201)), Places{});
  EXPECT_EQ(warned("aws", keep_alive(30)), Places{"3 /mqtt"});
  EXPECT_EQ(warned("aws", keep_alive(29)), (Places{"5 /mqtt/keep_alive_s", "3 /mqtt"}));
  EXPECT_EQ(warned("aws", keep_alive(1201)), (Places{"5 /mqtt/keep_alive_s", "3 /mqtt"}));
}

// The deepest topic is {root}/{id}/{device}/data/{group}/history.
TEST(CheckTarget, TopicsHaveALimitOfLevels) {
  EXPECT_EQ(refused("aws", plant(kRoot, R"("root": "a/b/c")")), Places{});
  const std::string text = refusal("aws", plant(kRoot, R"("root": "a/b/c/d")"));
  test::expect_says(text, "a/b/c/d/edge7/press1/data/fast/history has 9: remove 1 level from root");
  EXPECT_EQ(refused("azure", plant(kRoot, R"("root": "1/2/3/4/5/6/7/8/9/10")")), Places{});
  EXPECT_EQ(refused("azure", plant(kRoot, R"("root": "1/2/3/4/5/6/7/8/9/10/11")")),
            Places{"2 /agent/root"});
  EXPECT_EQ(refused("hivemq", plant(kRoot, R"("root": "1/2/3/4/5/6/7/8/9/10/11")")), Places{});
}

TEST(CheckTarget, TopicsHaveALimitOfBytes) {
  // "/edge7/press1/data/fast/history" has 31 bytes.
  const auto root = [](std::size_t bytes) {
    return plant(kRoot, R"("root": ")" + std::string(bytes, 'r') + "\"");
  };
  for (const std::string target : {"aws", "azure"}) {
    EXPECT_EQ(refused(target, root(225)), Places{}) << target;
    EXPECT_EQ(refused(target, root(226)), Places{"2 /agent/root"}) << target;
  }
  test::expect_says(refusal("aws", root(226)), "1 topic of this config is longer");
  EXPECT_EQ(refused("rabbitmq", root(226)), Places{});
}

TEST(CheckTarget, SomeCharactersAreNotForTopics) {
  EXPECT_EQ(refused("nats", plant(kRoot, R"("root": "fx/plant.a")")), Places{"2 /agent/root"});
  EXPECT_EQ(refused("nats", plant(kRoot, R"("root": "fx/plant a")")), Places{"2 /agent/root"});
  EXPECT_EQ(refused("nats", plant(kRoot, R"("root": "fx/plant*a")")), Places{});
  EXPECT_EQ(refused("rabbitmq", plant(kRoot, R"("root": "fx/plant.a")")), Places{"2 /agent/root"});
  EXPECT_EQ(refused("rabbitmq", plant(kRoot, R"("root": "fx/plant*a")")), Places{"2 /agent/root"});
  EXPECT_EQ(refused("rabbitmq", plant(kRoot, R"("root": "fx/plant a")")), Places{});
  EXPECT_EQ(refused("aws", plant(kRoot, R"("root": "fx/plant.a")")), Places{});
}

TEST(CheckTarget, SamplesHaveALimit) {
  // A bad tag takes about 110 bytes: name, reason, two times and the last value.
  const std::string large = plant(kTag, tags(1500));
  EXPECT_EQ(refused("aws", large), (Places{"12 /devices/0", "12 /devices/0"}));  // meta, sample
  EXPECT_EQ(refused("aws", plant(kTag, tags(800))), Places{});
  EXPECT_EQ(refused("hivemq", large), Places{});
  EXPECT_EQ(refused("rabbitmq", large), Places{});
}

TEST(CheckTarget, RetainedMessagesHaveALimitOfTheirOwn) {
  const std::string more = R"(, "description": ")" + std::string(200, 'd') + "\"";
  const std::string text = refusal("azure", plant(kTag, tags(300, more)));
  EXPECT_TRUE(text.starts_with("the meta of press1 has ")) << text;
  test::expect_says(text, "accepts 65536");
  EXPECT_EQ(refused("azure", plant(kTag, tags(150, more))), Places{});
  EXPECT_EQ(refused("aws", plant(kTag, tags(300, more))), Places{});
}

TEST(CheckTarget, NatsOnlyWarnsOfALargeMessage) {
  const std::string more = R"(, "description": ")" + std::string(900, 'd') + "\"";
  const std::string large = plant(kTag, tags(1100, more));
  EXPECT_EQ(refused("nats", large), Places{});
  EXPECT_EQ(warned("nats", large), Places{"12 /devices/0"});
}

TEST(CheckTarget, ListsAtMost20LargeMessages) {
  std::string devices;
  const std::string more = R"(, "description": ")" + std::string(200, 'd') + "\"";
  for (int i = 1; i <= 25; ++i)
    devices += std::string(i == 1 ? "" : ",") + R"({"name": "m)" + std::to_string(i) +
               R"(", "link": "line1", "protocol": "modbus-rtu", "unit": )" + std::to_string(i) +
               R"(, "groups": [{"name": "fast", "interval_ms": 60000}], "tags": [)" +
               tags(300, more) + "]}";
  std::string text = plant();
  const std::size_t begin = text.find(R"(  {"name": "press1")");
  text.replace(begin, text.rfind(']') - begin, devices);
  const auto found = findings("azure", text);
  ASSERT_EQ(found.size(), 21U);
  EXPECT_EQ(found.back().error.text, "5 more are not listed");
}

TEST(CheckTarget, AConnectionHasALimitOfMessages) {
  const auto groups = [](int interval_ms, const std::string& more, int count) {
    std::string out;
    for (int i = 0; i < count; ++i)
      out += std::string(i == 0 ? "" : ",") + R"({"name": "g)" + std::to_string(i) +
             R"(", "interval_ms": )" + std::to_string(interval_ms) + more + "}";
    return plant(kGroup + "],\n   \"tags\": [" + kTag,
                 out + R"(], "tags": [)" + R"({"name": "t", "address": "hr:0", "group": "g0"})");
  };
  EXPECT_EQ(refused("aws", groups(100, "", 10)), Places{});
  const std::string text = refusal("aws", groups(100, "", 11));
  EXPECT_TRUE(text.starts_with("the groups publish 110 messages a second")) << text;
  EXPECT_EQ(refused("azure", groups(100, "", 11)), Places{});
  // Groups that publish changes may stay below the limit.
  const std::string on_change = groups(100, R"(, "publish": "on_change")", 11);
  EXPECT_EQ(refused("aws", on_change), Places{});
  EXPECT_EQ(warned("aws", on_change), (Places{"11 /devices", "3 /mqtt"}));
  // A slow line limits a group without an interval.
  EXPECT_EQ(refused("aws", groups(0, "", 1)), Places{});
  EXPECT_EQ(warned("aws", groups(0, "", 1)), Places{"3 /mqtt"});
}

TEST(CheckTarget, WarnsOfWhatABrokerDoesDifferently) {
  const std::string remote = plant(kRoot, kRoot + R"(, "remote_config": true)");
  EXPECT_EQ(warned("aws", remote), (Places{"3 /mqtt", "2 /agent/remote_config"}));
  EXPECT_EQ(warned("hivemq", remote), Places{});
  EXPECT_EQ(warned("aws", plant(kVersion, kVersion5)), (Places{"3 /mqtt", "5 /mqtt/version"}));
  EXPECT_EQ(warned("rabbitmq", plant()), Places{"3 /mqtt"});
  EXPECT_EQ(warned("azure", plant()), Places{});
}

TEST(ConfigPlaces, ADeviceOfAnEntryForManyHasThePlaceOfTheList) {
  const std::string text =
      "{\n\"devices\": [\n{\"name\": \"a\"},\n{\"name\": \"m{n}\", \"n\": \"1-3\"}]}";
  const ConfigPlaces places(text);
  EXPECT_EQ(places.device("a"), "/devices/0");
  EXPECT_EQ(places.device("m2"), "/devices");
  EXPECT_EQ(places.line("/devices/1/name"), 4);
  EXPECT_EQ(places.line("/devices/1/absent"), 4);
  EXPECT_EQ(ConfigPlaces("no json").line("/devices"), 0);
}

}  // namespace
}  // namespace fxagent
