#include "agent/config/loader.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <ctime>

#include "tests/agent/config/small_plant.h"
#include "tests/support/effort.h"
#include "tests/support/scratch.h"

namespace fxagent {
namespace {

using namespace test;
using std::chrono::nanoseconds;

std::string example() { return content_of(FXAGENT_CONFIG_DIR "/agent.example.json"); }

// ---- valid configs -----------------------------------------------------------------------------

TEST(Config, SmallPlantIsRightAndGetsTheDefaults) {
  const Config config = good(small_plant().dump());
  EXPECT_EQ(config.base_topic(), "fx/plant-a/edge7");
  EXPECT_EQ(config.mqtt.version, 5);
  EXPECT_EQ(config.mqtt.client_id, "fx-edge7");
  EXPECT_EQ(config.mqtt.qos, 1);
  EXPECT_EQ(config.mqtt.keep_alive, std::chrono::seconds(30));
  EXPECT_FALSE(config.mqtt.tls);
  EXPECT_EQ(config.store.max_bytes, 268435456U);
  EXPECT_EQ(config.store.max_age, std::chrono::hours(168));
  EXPECT_FALSE(config.store.sync_always);
  EXPECT_TRUE(config.warnings.empty()) << config.warnings.front();
}

TEST(Config, ExampleIsRightAndWarnsOfNothing) {
  const Config config = good(example());
  EXPECT_EQ(config.devices.size(), 6U);
  EXPECT_TRUE(config.warnings.empty()) << config.warnings.front();
}

TEST(Config, RootHasADefault) { EXPECT_EQ(good(without("/agent/root")).base_topic(), "fx/edge7"); }

TEST(Config, EverythingThatCanBeSetIsSet) {
  auto plant = small_plant();
  plant["$schema"] = "./agent.schema.json";
  plant["mqtt"] = nlohmann::json::parse(R"({
    "servers": ["mqtts://a.example", "mqtt://[2001:db8::1]", "mqtts://[::1]:9000", "mqtt://b:1"],
    "version": "3.1.1", "client_id": "c", "username": "u", "password_file": "/run/p",
    "password_env": "P", "tls": {"ca_file": "ca.pem", "cert_file": "c.pem", "key_file": "k.pem"},
    "keep_alive_s": 5, "qos": 0, "reconnect_spread_s": 60})");
  plant["store"] = nlohmann::json::parse(
      R"({"path": "/s", "max_bytes": 65536, "max_age_h": 1, "sync": "always",
          "audit_max_bytes": 65537, "audit_max_age_h": 2})");
  const Config config = good(plant.dump());
  EXPECT_EQ(config.mqtt.servers,
            (std::vector<std::string>{"mqtts://a.example:8883", "mqtt://[2001:db8::1]:1883",
                                      "mqtts://[::1]:9000", "mqtt://b:1"}));
  EXPECT_EQ(config.mqtt.version, 4);
  EXPECT_EQ(config.mqtt.client_id, "c");
  EXPECT_EQ(config.mqtt.password_env, "P");
  ASSERT_TRUE(config.mqtt.tls);
  EXPECT_EQ(config.mqtt.tls->key_file, "k.pem");
  EXPECT_EQ(config.mqtt.keep_alive.count(), 5);
  EXPECT_EQ(config.mqtt.qos, 0);
  EXPECT_EQ(config.mqtt.reconnect_spread.count(), 60);
  EXPECT_EQ(config.store.max_bytes, 65536U);
  EXPECT_EQ(config.store.max_age.count(), 1);
  EXPECT_TRUE(config.store.sync_always);
  EXPECT_EQ(config.store.audit_max_bytes, 65537U);
  EXPECT_EQ(config.store.audit_max_age.count(), 2);
}

// ---- the form of errors ------------------------------------------------------------------------

TEST(Config, ErrorTextHasFileLinePointerAndWords) {
  EXPECT_EQ(to_string(ConfigError{"/a/0", 12, "is wrong"}, "agent.json"),
            "agent.json:12: /a/0: is wrong");
  EXPECT_EQ(to_string(ConfigError{"", 0, "cannot be read"}, "agent.json"),
            "agent.json: cannot be read");
}

TEST(Config, AllErrorsComeAtOnceInTheOrderOfTheFile) {
  const auto errors = errors_of(R"({
  "devices": [
    {"name": "a", "link": "nope", "protocol": "fx-programming-port", "model": "FX3U",
     "tags": [{"name": "x", "address": "X8"},
              {"name": "y", "address": "D9", "grup": "fast"}],
     "retries": -1}
  ],
  "mqtt": {"servers": []},
  "links": [{"name": "L1"}],
  "colour": "red",
  "agent": {"id": "edge7",
            "root": "fx/#"}
})");
  std::vector<std::pair<std::string, int>> places;
  for (const auto& error : errors) places.emplace_back(error.pointer, error.line);
  const std::vector<std::pair<std::string, int>> expected{{"/devices/0/link", 3},
                                                          {"/devices/0/tags/0/address", 4},
                                                          {"/devices/0/tags/1/grup", 5},
                                                          {"/devices/0/retries", 6},
                                                          {"/mqtt/servers", 8},
                                                          {"/links/0", 9},
                                                          {"/links/0/name", 9},
                                                          {"/colour", 10},
                                                          {"/agent/root", 12}};
  EXPECT_EQ(places, expected) << listed(errors);
}

TEST(Config, WhatIsNotJsonIsOneErrorWithLineAndColumn) {
  const auto errors = errors_of("{\n  \"agent\": {\n    \"id\": edge7\n");
  expect_error(errors, "", {"not JSON", "line 3", "column 11"});
  EXPECT_EQ(errors[0].line, 3);
}

TEST(Config, JsonThatIsNoObjectIsAnError) {
  for (const auto* text : {"[]", "5", "\"x\"", "null", "true"})
    expect_error(text, "", {"must be an object"});
}

TEST(Config, EmptyObjectNamesWhatIsMissing) {
  const auto errors = errors_of("{}");
  const std::string text = listed(errors);
  for (const auto* key : {"\"agent\"", "\"mqtt\"", "\"links\"", "\"devices\""})
    EXPECT_NE(text.find(std::string(key) + " is missing"), std::string::npos) << text;
}

TEST(Config, EveryRequiredKeyIsMissedWhereItBelongs) {
  expect_error(without("/agent/id"), "/agent", {"\"id\" is missing"});
  expect_error(without("/mqtt/servers"), "/mqtt", {"\"servers\" is missing"});
  expect_error(without("/store/path"), "/store", {"\"path\" is missing"});
  expect_error(without("/links/0/serial/path"), "/links/0/serial", {"\"path\" is missing"});
  expect_error(without("/links/1/tcp/host"), "/links/1/tcp", {"\"host\" is missing"});
  expect_error(without("/links/1/tcp/port"), "/links/1/tcp", {"\"port\" is missing"});
  expect_error(without("/devices/0/name"), "/devices/0", {"\"name\" is missing"});
  expect_error(without("/devices/0/link"), "/devices/0", {"\"link\" is missing"});
  expect_error(without("/devices/0/protocol"), "/devices/0",
               {"\"protocol\" is missing", "fx-programming-port"});
  expect_error(without("/devices/0/tags/0/name"), "/devices/0/tags/0", {"\"name\" is missing"});
  expect_error(without("/devices/0/tags/0/address"), "/devices/0/tags/0",
               {"\"address\" is missing"});
}

TEST(Config, UnknownKeyNamesTheNearestOne) {
  expect_refused("/agent/ID", "\"x\"", {"unknown key \"ID\"", "id"});
  expect_refused("/mqtt/keepalive_s", "5", {"keep_alive_s"});
  expect_refused("/store/max_byte", "5", {"max_bytes"});
  expect_refused("/links/0/serial/baudrate", "5", {"baud"});
  expect_refused("/devices/0/time_out_ms", "5", {"timeout_ms"});
  expect_refused("/devices/0/comand_set", "5", {"command_set"});
  expect_refused("/devices/0/groups/0/interval", "5", {"interval_ms"});
  expect_refused("/devices/0/tags/0/adress", "5", {"address"});
  expect_refused("/devices/0/commands/que", "5", {"queue"});
}

/// The small plant with additional keys under /mqtt.
std::string with_mqtt(const nlohmann::json& more) {
  auto plant = small_plant();
  plant["mqtt"].update(more);
  return plant.dump(1);
}

TEST(Config, PasswordInClearIsSentToAFileAndNotQuoted) {
  const auto errors = errors_of(changed("/mqtt/password", R"("hunter2")"));
  expect_error(errors, "/mqtt/password", {"password_file", "password_env", "chmod 600"});
  EXPECT_EQ(listed(errors).find("hunter2"), std::string::npos);
}

TEST(Config, PasswordInClearStandsInAPrivateFileOrWhereItIsAllowed) {
  const std::string text = with_mqtt({{"password", "hunter2"}});
  const auto own = parse_config(text, environment(), FilePrivacy::owner_only);
  ASSERT_TRUE(own) << listed(own.error());
  EXPECT_EQ(own->mqtt.password, "hunter2");
  EXPECT_TRUE(own->warnings.empty());
  const Config allowed = good(with_mqtt({{"password", "hunter2"}, {"allow_plain_secret", true}}));
  EXPECT_EQ(allowed.mqtt.password, "hunter2");
  EXPECT_TRUE(warns(allowed, {"/mqtt/password", "others"}));
  EXPECT_FALSE(warns(allowed, {"hunter2"}));
  expect_error(with_mqtt({{"password", "hunter2"}, {"allow_plain_secret", false}}),
               "/mqtt/password", {"allow_plain_secret"});
}

TEST(Config, PasswordOfAVariableIsNotInClearButOneThatIsPartlySoIs) {
  const Environment from = environment({{"PW", "hunter2"}});
  EXPECT_EQ(good(with_mqtt({{"password", "${PW}"}}), from).mqtt.password, "hunter2");
  for (const char* text : {"x${PW}", "${PW}x", "${PW}${PW}", "$${PW}"}) {
    const auto errors = errors_of(with_mqtt({{"password", text}}), from);
    expect_error(errors, "/mqtt/password", {"allow_plain_secret"});
    EXPECT_EQ(listed(errors).find("hunter2"), std::string::npos);
  }
}

TEST(Config, NoErrorQuotesAPassword) {
  for (const char* value :
       {"123456789", "[\"123456789\"]", "\"123456789${\"", "\"${123456789\"", "\"a${123456789}\"",
        "\"${x}123456789${NO}\"", "\"123456789\\u0001\""}) {
    const auto errors = errors_of(changed("/mqtt/password", value));
    expect_error(errors, "/mqtt/password", {});
    EXPECT_EQ(listed(errors).find("123456789"), std::string::npos) << listed(errors);
  }
  for (const char* text : {"{\"password\": \"123456789\" \"x\"}", "{\"password\" \"123456789\"}",
                           "{\"password\": \"123456789", "{\"password\": 123456789x}"}) {
    const auto errors = errors_of(text);
    expect_error(errors, "", {"not JSON", "line 1, column"});
    EXPECT_EQ(listed(errors).find("123456789"), std::string::npos) << listed(errors);
  }
  expect_refused("/mqtt/password", "\"${NOT_SET}\"", {"NOT_SET"});
}

TEST(Config, PasswordHasOnePlace) {
  for (const char* other : {"password_file", "password_env"})
    expect_error(with_mqtt({{"password", "x"}, {other, "y"}, {"allow_plain_secret", true}}),
                 "/mqtt/password", {"already"});
}

TEST(Config, PasswordThatLeavesTheMachineInClearIsAWarning) {
  const auto config = [](const char* server) {
    return good(with_mqtt({{"servers", {server}}, {"password_env", "P"}}));
  };
  for (const char* server : {"mqtt://a", "mqtt://192.0.2.1:1883", "mqtt://[2001:db8::1]"})
    EXPECT_TRUE(warns(config(server), {"/mqtt/password_env", "unencrypted", "mqtts://"})) << server;
  for (const char* server :
       {"mqtts://a", "mqtt://127.0.0.1", "mqtt://localhost:1884", "mqtt://[::1]"})
    EXPECT_TRUE(config(server).warnings.empty()) << server;
}

TEST(Config, KeyGivenTwiceIsAnErrorThatNamesBothLines) {
  const auto errors = errors_of(
      "{\"agent\": {\"id\": \"a\",\n \"id\": \"b\"},\n"
      " \"mqtt\": {\"servers\": [\"mqtt://a\"]}, \"links\": [], \"devices\": []}");
  expect_error(errors, "/agent/id", {"duplicate", "line 1"});
  EXPECT_EQ(errors[0].line, 2);
}

TEST(Config, TextCutAnywhereIsRefused) {
  std::string text = example();
  text.erase(text.find_last_of('}') + 1);
  for (std::size_t length = 0; length < text.size(); length += 5)
    EXPECT_FALSE(parse_config(text.substr(0, length), environment())) << length;
}

TEST(Config, AnyBytesAreAnAnswer) {
  const std::string text = example();
  const int lines = static_cast<int>(std::count(text.begin(), text.end(), '\n')) + 1;
  int taken = 0;
  int no_json = 0;
  int wrong = 0;
  constexpr std::size_t kStep = 7 * 10 / effort(10);
  for (std::size_t i = 0; i < text.size(); i += kStep) {
    for (const char c : {'"', '}', '[', '0', '-', '$', '\0', '\xFF'}) {
      std::string spoiled = text;
      spoiled[i] = c;
      const auto config = parse_config(spoiled, environment());
      const bool is_json = nlohmann::json::accept(spoiled);
      ++(config ? taken : is_json ? wrong : no_json);
      if (config) {
        EXPECT_TRUE(is_json) << "taken, and no JSON: " << i << " " << c;
        continue;
      }
      ASSERT_FALSE(config.error().empty()) << "refused without a reason: " << i << " " << c;
      for (const ConfigError& error : config.error()) {
        EXPECT_FALSE(error.text.empty()) << i << " " << c;
        EXPECT_GE(error.line, 1) << i << " " << c << ": " << error.text;
        EXPECT_LE(error.line, lines) << i << " " << c << ": " << error.text;
      }
    }
  }
  // Every kind of error occurred.
  EXPECT_GT(taken, 0);
  EXPECT_GT(no_json, 0);
  EXPECT_GT(wrong, 0);
}

std::string plant_with_tags(int count) {
  std::string text = R"({"agent": {"id": "a"}, "mqtt": {"servers": ["mqtt://a"]},
    "links": [{"name": "l", "serial": {"path": "/dev/ttyS0"}}], "devices": [
    {"name": "d", "link": "l", "protocol": "fx-programming-port", "model": "FX3U",
     "groups": [{"name": "g"}], "tags": [)";
  for (int i = 0; i < count; ++i)
    text += std::string(i == 0 ? "" : ",\n") + R"({"name": "tag-)" + std::to_string(i) +
            R"(", "address": "D)" + std::to_string(i % 8000) +
            R"(", "type": "int16", "group": "g", "scale": 0.1, "unit": "bar", "deadband": 1})";
  return text + "]}]}";
}

/// Duplicate names, unknown keys and missing keys.
std::string plant_with_errors(int count) {
  std::string text = "{\"links\": [";
  for (int i = 0; i < count; ++i) text += "{\"name\": \"x\", \"k\": 1},\n";
  text += "{}], ";
  for (int i = 0; i < count; ++i) text += "\"k" + std::to_string(i) + "\": 1,\n";
  return text + "\"z\": 1}";
}

double processor_seconds_for(const std::string& text) {
  const std::clock_t begin = std::clock();
  const auto config = parse_config(text, environment());
  EXPECT_TRUE(config || !config.error().empty());
  return static_cast<double>(std::clock() - begin) / CLOCKS_PER_SEC;
}

TEST(Config, TimeGrowsWithTheTextAndNotWithItsSquare) {
  for (const auto plant : {plant_with_tags, plant_with_errors}) {
    const double few = processor_seconds_for(plant(2500));
    const double many = processor_seconds_for(plant(20000));
    EXPECT_LT(many, 24 * few) << "8 times the text; the square would be 64 times the time";
  }
}

TEST(Config, HundredThousandTagsLoad) {
  constexpr std::size_t kTags = effort(100'000);
  const Config config = good(plant_with_tags(kTags));
  ASSERT_EQ(config.devices.size(), 1U);
  EXPECT_EQ(config.devices[0].tags.size(), kTags);
}

// ---- agent ------------------------------------------------------------------------------------

TEST(Config, NamesAreWhatTopicsCanCarry) {
  const std::string longest(64, 'a');
  EXPECT_EQ(good(changed("/agent/id", "\"" + longest + "\"")).id, longest);
  EXPECT_EQ(good(changed("/agent/id", R"("0_-z")")).id, "0_-z");
  for (const std::string& name :
       std::vector<std::string>{longest + "a", std::string("Edge7"), std::string("a b"),
                                std::string("a/b"), std::string("é"), std::string("a+")})
    expect_refused("/agent/id", "\"" + name + "\"", {"1 to 64", name});
  expect_refused("/devices/0/name", R"("a{n}")", {"only the key \"n\" of a device replaces {n}"});
}

TEST(Config, RootIsPlainTopicLevels) {
  for (const auto* root : {"a", "a/b/c", "Werk 1/Ä", "a.b-c"})
    EXPECT_EQ(good(changed("/agent/root", "\"" + std::string(root) + "\"")).root, root);
  for (const auto* root : {"/a", "a/", "a//b", "+", "a/#", "$SYS/a", "/"})
    expect_refused("/agent/root", "\"" + std::string(root) + "\"", {"must"});
}

// ---- mqtt -------------------------------------------------------------------------------------

TEST(Config, ServersAreSchemeHostAndPort) {
  for (const auto* server :
       {"127.0.0.1:1883", "tcp://a:1883", "MQTT://a", "mqtt://", "mqtt://:1883",
        "mqtt://a:", "mqtt://a:0", "mqtt://a:65536", "mqtt://a:12x", "mqtt://a/b", "mqtt://a b",
        "mqtt://[::1", "mqtt://[]", "mqtt://[::1]x", "mqtt://[zz]", "mqtt://::1", "ws://a"})
    expect_refused("/mqtt/servers/0", "\"" + std::string(server) + "\"", {});
}

TEST(Config, PathOfAServerIsRefusedByItsSlash) {
  for (const auto* server : {"mqtt://127.0.0.1:21883/", "mqtt://a/", "mqtt://[::1]:1883/x"})
    expect_refused("/mqtt/servers/0", "\"" + std::string(server) + "\"", {"remove the /"});
}

TEST(Config, PasswordInTheServersAddressIsRefusedAndNotQuoted) {
  const auto errors = errors_of(changed("/mqtt/servers/0", R"("mqtt://u:hunter2@a")"));
  expect_error(errors, "/mqtt/servers/0", {"password_file"});
  EXPECT_EQ(listed(errors).find("hunter2"), std::string::npos);
}

TEST(Config, VersionIsAStringOfTwo) {
  EXPECT_EQ(good(changed("/mqtt/version", R"("3.1.1")")).mqtt.version, 4);
  expect_refused("/mqtt/version", R"("4")", {"5 or 3.1.1"});
  expect_refused("/mqtt/version", "5", {"a string", "the number 5"});
}

TEST(Config, QosTwoIsRefusedWithAReason) {
  expect_refused("/mqtt/qos", "2", {"0 or 1", "seq"});
  expect_refused("/mqtt/qos", "3", {"3"});
  expect_refused("/mqtt/qos", "7", {"from 0 to 1, found the number 7"});
}

TEST(Config, OldMqttTakesNoPasswordWithoutAUser) {
  auto plant = small_plant();
  plant["mqtt"]["version"] = "3.1.1";
  plant["mqtt"]["password_env"] = "P";
  expect_error(plant.dump(), "/mqtt/password_env", {"username"});
  plant["mqtt"]["username"] = "u";
  EXPECT_EQ(good(plant.dump()).mqtt.username, "u");
  plant["mqtt"].erase("username");
  plant["mqtt"].erase("password_env");
  plant["mqtt"]["password"] = "${P}";
  expect_error(errors_of(plant.dump(), environment({{"P", "x"}})), "/mqtt/password", {"username"});
}

TEST(Config, CertificateAndKeyBelongTogether) {
  auto plant = small_plant();
  plant["mqtt"]["servers"][0] = "mqtts://a";
  plant["mqtt"]["tls"] = {{"cert_file", "c.pem"}};
  expect_error(plant.dump(), "/mqtt/tls", {"cert_file", "key_file"});
}

TEST(Config, TlsWithoutAnEncryptedServerIsAWarning) {
  EXPECT_TRUE(warns(good(changed("/mqtt/tls", R"({"ca_file": "c"})")), {"/mqtt/tls", "mqtts://"}));
  EXPECT_TRUE(good(changed("/mqtt/servers/0", R"("mqtts://a")")).warnings.empty());
}

// ---- store ------------------------------------------------------------------------------------

TEST(Config, NoStoreIsAllowedAndWarnedOf) {
  const Config config = good(without("/store"));
  EXPECT_EQ(config.store.path, "");
  EXPECT_TRUE(warns(config, {"no store"}));
}

TEST(Config, StoreSyncIsOneOfTwoWords) {
  expect_refused("/store/sync", R"("allways")", {"offline or always", "did you mean always?"});
}

// ---- links ------------------------------------------------------------------------------------

TEST(Config, SerialLineTakesTheProtocolsDefaults) {
  const Config config = good(small_plant().dump());
  const auto& serial = std::get<SerialSettings>(config.links[0].channel);
  EXPECT_EQ(serial.path, "/dev/ttyUSB0");
  EXPECT_EQ(serial.baud, 9600);
  EXPECT_EQ(serial.data_bits, 7);
  EXPECT_EQ(serial.parity, Parity::even);
  EXPECT_EQ(serial.stop_bits, 1);
}

TEST(Config, SerialLineTakesWhatIsGiven) {
  const Config config = good(changed("/links/0/serial", R"({"path": "/dev/ttyS1", "baud": 19200,
      "data_bits": 8, "parity": "odd", "stop_bits": 2})"));
  const auto& serial = std::get<SerialSettings>(config.links[0].channel);
  EXPECT_EQ(serial.baud, 19200);
  EXPECT_EQ(serial.data_bits, 8);
  EXPECT_EQ(serial.parity, Parity::odd);
  EXPECT_EQ(serial.stop_bits, 2);
}

TEST(Config, DirectionOfASerialPortIsKeptBesideTheProtocolsDefaults) {
  EXPECT_FALSE(
      std::get<SerialSettings>(good(small_plant().dump()).links[0].channel).rs485.has_value());
  const Config config = good(changed("/links/0/serial", R"({"path": "/dev/ttymxc1",
      "rs485": {"rts_on_send": false, "delay_before_ms": 1, "delay_after_ms": 2}})"));
  const auto& serial = std::get<SerialSettings>(config.links[0].channel);
  EXPECT_EQ(serial.path, "/dev/ttymxc1");
  EXPECT_EQ(serial.data_bits, 7);
  ASSERT_TRUE(serial.rs485);
  EXPECT_FALSE(serial.rs485->rts_on_send);
  EXPECT_EQ(serial.rs485->delay_before.count(), 1);
  EXPECT_EQ(serial.rs485->delay_after.count(), 2);
  expect_error(changed("/links/0/serial/rs485", R"({"rts_on_sent": true})"),
               "/links/0/serial/rs485/rts_on_sent", {"rts_on_send"});
  expect_error(changed("/links/0/serial/rs485", R"({"delay_after_ms": 101})"),
               "/links/0/serial/rs485/delay_after_ms", {"100"});
}

TEST(Config, CharacterTimeCountsStartParityAndStop) {
  EXPECT_EQ(good(small_plant().dump()).links[0].char_time, nanoseconds(1041667));  // 10 bits, 9600
  const Config odd = good(changed("/links/0/serial", R"({"path": "/dev/ttyS1", "baud": 1000000,
      "data_bits": 8, "parity": "odd", "stop_bits": 2})"));
  EXPECT_EQ(odd.links[0].char_time, nanoseconds(12000));
  const Config none = good(changed("/links/0/serial", R"({"path": "/dev/ttyS1", "baud": 1000000,
      "data_bits": 8, "parity": "none"})"));
  EXPECT_EQ(none.links[0].char_time, nanoseconds(10000));
}

TEST(Config, LineListensForTwiceTheTimeoutOfItsSlowestDevice) {
  EXPECT_EQ(good(changed("/devices/0/timeout_ms", "300")).links[0].listening,
            std::chrono::milliseconds(600));
  EXPECT_EQ(good(changed("/devices/0/timeout_ms", "600000")).links[0].listening, kLongestListening);
  const Config numbered =
      good(changed("/devices/1", R"({"name": "meter", "link": "gw1", "protocol": "modbus-tcp"})"));
  EXPECT_EQ(numbered.links[1].listening.count(), 0) << "its answers have numbers";
  const Config anew =
      good(changed("/devices/1", R"({"name": "press2", "link": "gw1", "protocol": "mc-1e"})"));
  EXPECT_EQ(anew.links[1].listening.count(), 0) << "a new connection brings nothing old";
}

TEST(Config, PollsKeepAFifthOfTheLineUnlessTheLinkSaysOtherwise) {
  EXPECT_EQ(good(small_plant().dump()).links[0].poll_share, 0.2);
  EXPECT_EQ(good(changed("/links/0/poll_share_percent", "45")).links[0].poll_share, 0.45);
  expect_refused("/links/0/poll_share_percent", "91", {"90"});
}

TEST(Config, TcpLineSpeedIsKnownOnlyWhereItIsGiven) {
  EXPECT_EQ(good(small_plant().dump()).links[1].char_time, nanoseconds(1041667));
  EXPECT_EQ(good(without("/links/1/line_baud")).links[1].char_time, nanoseconds(0));
  const Config wide = good(changed(
      "/links/1",
      R"({"name": "gw1", "tcp": {"host": "a", "port": 1}, "line_baud": 1000000, "data_bits": 8,
          "parity": "none", "stop_bits": 2})"));
  EXPECT_EQ(wide.links[1].char_time, nanoseconds(11000));
  EXPECT_EQ(std::get<TcpSettings>(wide.links[1].channel).port, 1);
}

TEST(Config, LineSettingsOutOfRangeAreRefused) {
  expect_refused("/links/0/serial/baud", "49", {"50"});
  expect_refused("/links/0/serial/baud", "4000001", {"4000000"});
  EXPECT_EQ(
      std::get<SerialSettings>(good(changed("/links/0/serial/baud", "250000")).links[0].channel)
          .baud,
      250000);
  expect_refused("/links/0/serial/data_bits", "6", {"7 to 8"});
  expect_refused("/links/0/serial/parity", R"("Even")", {"none, even or odd"});
  expect_refused("/links/0/serial/stop_bits", "0", {"1 to 2"});
  expect_refused("/links/1/tcp/port", "0", {"1 to 65535"});
  expect_refused("/links/1/tcp/host", R"("http://a/")", {"host name"});
  expect_refused("/links/1/tcp/host", R"("http://10.0.0.1")", {"remove the scheme with its ://"});
  expect_refused("/links/1/tcp/host", R"("[::1]")", {"remove the brackets"});
  expect_refused("/links/1/tcp/host", R"("[::1]:502")", {"belongs in \"port\""});
  good(changed("/links/1/tcp/host", R"("::1")"));
}

TEST(Config, HostOfNumbersIsAnAddressOfFourDecimalNumbers) {
  for (const std::string host :
       {"127.000.000.010", "10.0.0.08", "127.1", "2130706433", "192.168.1", "192.168.1.300",
        "256.1.1.1", "192.168.1.10.", "1.2.3.4.5", "0x7f000001", "0x7f.1", "."}) {
    expect_refused("/links/1/tcp/host", "\"" + host + "\"", {host, "without leading zeros"});
    expect_error(
        changed("/links/2", R"({"name": "u1", "udp": {"host": ")" + host + R"(", "port": 1}})"),
        "/links/2/udp/host", {host, "without leading zeros"});
    expect_refused("/mqtt/servers/0", "\"mqtt://" + host + ":1883\"", {"without leading zeros"});
  }
  for (const std::string host : {"0.0.0.0", "192.168.100.255", "10.0.0.1.example", "0xcafe.example",
                                 "3com", "1-2", "fe80::1"})
    good(changed("/links/1/tcp/host", "\"" + host + "\""));
  for (const std::string host : {"224.0.0.1", "239.255.255.255", "255.255.255.255", "ff02::1",
                                 "ff02::1%eth0", "::ffff:224.0.0.1"})
    expect_refused("/links/1/tcp/host", "\"" + host + "\"", {host, "group of machines"});
}

TEST(Config, LinkIsEitherSerialOrTcpOrUdp) {
  expect_error(changed("/links/0/tcp", R"({"host": "b", "port": 1})"), "/links/0",
               {"more than one", "\"tcp\"", "keep one"});
  expect_error(changed("/links/1/udp", R"({"host": "b", "port": 1})"), "/links/1",
               {"more than one", "\"udp\"", "keep one"});
  expect_error(without("/links/0/serial"), "/links/0", {"needs", "udp"});
}

TEST(Config, LineKeysBelongToTheirKindOfLink) {
  expect_refused("/links/0/line_baud", "9600", {"serial/baud"});
  expect_refused("/links/0/parity", R"("even")", {"inside"});
  auto plant = small_plant();
  plant["links"][1].erase("line_baud");
  plant["links"][1]["data_bits"] = 8;
  expect_error(plant.dump(), "/links/1/data_bits", {"line_baud"});
}

TEST(Config, TwoLinksOfOneNameAreAnErrorThatNamesBoth) {
  const auto errors = errors_of(changed("/links/1/name", R"("line1")"));
  ASSERT_EQ(errors.size(), 2U) << listed(errors);  // gw1, which the mixer needs, is missing too
  EXPECT_EQ(errors[1].pointer, "/links/1/name");
  EXPECT_NE(errors[1].text.find("/links/0/name (line "), std::string::npos) << errors[1].text;
}

TEST(Config, TwoLinksOnOnePortAreAnErrorThatNamesBoth) {
  expect_error(changed("/links/1", R"({"name": "gw1", "serial": {"path": "/dev/ttyUSB0"}})"),
               "/links/1/serial/path", {"already used", "/links/0/serial/path (line "});
}

TEST(Config, TwoLinksToOneServerAreAWarning) {
  EXPECT_TRUE(warns(
      good(changed("/links/2", R"({"name": "gw2", "tcp": {"host": "192.0.2.10", "port": 5551}})")),
      {"/links/2/tcp", "\"gw2\"", "\"gw1\" at /links/1 (line ", "put the devices of both"}));
}

/// The small plant with these links in addition to its own.
std::string with_links(const std::vector<std::string>& links) {
  auto plant = small_plant();
  for (const std::string& link : links) plant["links"].push_back(nlohmann::json::parse(link));
  return plant.dump();
}

TEST(Config, UdpLinkHasAPlaceAndPerhapsAPortOfItsOwn) {
  const Config config =
      good(with_links({R"({"name": "u1", "udp": {"host": "192.0.2.10", "port": 5007}})",
                       R"({"name": "u2", "udp": {"host": "a", "port": 1, "local_port": 65535}})"}));
  EXPECT_EQ(std::get<UdpSettings>(config.links[2].channel), (UdpSettings{"192.0.2.10", 5007, 0}));
  EXPECT_EQ(std::get<UdpSettings>(config.links[3].channel), (UdpSettings{"a", 1, 65535}));
  EXPECT_EQ(config.links[2].char_time.count(), 0);
}

TEST(Config, UdpLinkThatCannotBeIsAnError) {
  const auto udp = [](const std::string& inside, const std::string& beside = "") {
    return with_links({R"({"name": "u1", "udp": {)" + inside + "}" + beside + "}"});
  };
  expect_error(udp(R"("host": "a", "port": 0)"), "/links/2/udp/port", {"1 to 65535"});
  expect_error(udp(R"("host": "a/b", "port": 1)"), "/links/2/udp/host", {"host name"});
  expect_error(udp(R"("host": "meter.local:502", "port": 1)"), "/links/2/udp/host",
               {"\"meter.local:502\"", "belongs in \"port\""});
  good(with_links({R"({"name": "u1", "udp": {"host": "fe80::1", "port": 5007}})"}));
  expect_error(udp(R"("host": "a", "port": 1, "local_port": 0)"), "/links/2/udp/local_port",
               {"1 to 65535"});
  expect_error(udp(R"("host": "a", "port": 1)", R"(, "line_baud": 9600)"), "/links/2/line_baud",
               {"udp"});
}

TEST(Config, UdpIsListenedToOnlyWhereALateAnswerCouldCome) {
  const auto listening = [](const char* protocol, const std::string& local_port) {
    auto plant = nlohmann::json::parse(
        with_links({R"({"name": "u1", "udp": {"host": "a", "port": 5007)" + local_port + "}}"}));
    plant["devices"].push_back({{"name", "p"}, {"link", "u1"}, {"protocol", protocol}});
    return good(plant.dump()).links[2].listening.count();
  };
  const std::string fixed = R"(, "local_port": 5008)";
  EXPECT_EQ(listening("mc-3e", ""), 0) << "it comes to another port";
  EXPECT_GT(listening("mc-3e", fixed), 0);
  EXPECT_EQ(listening("mc-4e", fixed), 0) << "it has a number";
}

TEST(Config, TwoLinksToOneUdpPortAreAWarningAndFromOnePortAnError) {
  const std::string first = R"({"name": "u1", "udp": {"host": "a", "port": 1, "local_port": 5}})";
  EXPECT_TRUE(
      warns(good(with_links({first, R"({"name": "u2", "udp": {"host": "a", "port": 1}})"})),
            {"/links/3/udp", "\"u2\"", "\"u1\" at /links/2 (line ", "put the devices of both"}));
  EXPECT_FALSE(warns(good(with_links({R"({"name": "u2", "udp": {"host": "192.0.2.10",
                                          "port": 5551}})"})),
                     {"same host"}))
      << "gw1 is there by TCP";
  expect_error(
      with_links({first, R"({"name": "u2", "udp": {"host": "b", "port": 1, "local_port": 5}})"}),
      "/links/3/udp/local_port", {"already used", "/links/2/udp/local_port (line "});
}

TEST(Config, ProtocolThatHasNoDatagramsIsToldWhatItNeeds) {
  auto plant = small_plant();
  plant["links"].push_back({{"name", "u1"}, {"udp", {{"host", "a"}, {"port", 502}}}});
  plant["devices"].push_back({{"name", "m"}, {"link", "u1"}, {"protocol", "modbus-tcp"}});
  expect_error(plant.dump(), "/devices/2/link",
               {"modbus-tcp does not run over a udp link; it needs one with \"tcp\""});
  expect_error(plant.dump(), "/devices/2/link", {"; over udp run ", "mc-4e"});
  plant["devices"][2]["protocol"] = "modbus-rtu";
  expect_error(plant.dump(), "/devices/2/link", {"\"serial\" or \"tcp\""});
}

TEST(Config, LinkWithoutADeviceIsAWarning) {
  EXPECT_TRUE(
      warns(good(changed("/links/2", R"({"name": "l3", "serial": {"path": "/dev/ttyS9"}})")),
            {"/links/2", "no device"}));
}

TEST(Config, NoDevicesAreAllowedAndWarnedOf) {
  const Config config = good(changed("/devices", "[]"));
  EXPECT_TRUE(warns(config, {"/devices", "no devices"}));
}

}  // namespace
}  // namespace fxagent
