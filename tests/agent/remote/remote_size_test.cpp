// A document of a few KiB may expand to more than the machine's memory or take minutes to judge.
#include <gtest/gtest.h>

#include <atomic>

#include "agent/config/loader.h"
#include "agent/config/read/config_limits.h"
#include "tests/agent/remote/remote_run.h"

namespace fxagent {
namespace {

using namespace test;

json tag(const std::string& name, int count) {
  return {{"name", name}, {"address", "hr:0"}, {"type", "uint16"}, {"count", count}};
}

/// A template with these tags, and its devices.
json many(const std::string& n, const json& tags) {
  json config = json::parse(R"({
      "links": [{"name": "gw", "tcp": {"host": "gw", "port": 502}}],
      "templates": {"m": {"protocol": "modbus-tcp", "link": "gw"}},
      "devices": [{"template": "m", "name": "e{n}"}]})");
  config["templates"]["m"]["tags"] = tags;
  config["devices"][0]["n"] = n;
  return {{"version", "v1"}, {"config", config}};
}

struct Attack {
  const char* what;
  json document;
  const char* said;  ///< after "rejected v1: "
};

TEST(RemoteSize, WhatExpandsBeyondAMachineIsRejectedWithTheLimit) {
  json large = json::array();
  for (int i = 0; i < 8; ++i) large.push_back(tag("t" + std::to_string(i), 65535));
  json twelve = json::array();
  for (int i = 0; i < 12; ++i) twelve.push_back(tag("t" + std::to_string(i), 1));
  json text = json::array();
  text.push_back({{"name", "s"}, {"address", "hr:0"}, {"type", "string"}, {"length", 400}});
  json junk = many("1-2000", json::array());
  junk["config"]["templates"]["m"]["x"] = std::string(9000, 'x');
  const Attack attacks[] = {
      {"arrays in one device", many("1", large),
       "/templates/m/tags/7: with this there are 524280 tag values; a remote config may have "
       "at most 500000"},
      {"arrays in many devices", many("1-1000", json::array({tag("t", 1000)})),
       "/devices/0: with this there are 1000000 tag values; a remote config may have at most "
       "500000"},
      {"texts", many("1-3000", text), "/devices/0: with this there are 600000 tag values"},
      {"tags of many devices", many("1-9000", twelve),
       "/devices/0: with this there are 108000 tags; a remote config may have at most 100000"},
      {"memory", many("1-10000", json::array({tag("a", 40), tag("b", 9)})),
       "/devices/0: with this the agent needs about "},
      {"a long text in a template", junk,
       "/devices/0: without templates, the devices up to this one would be larger than 16 MiB, the "
       "limit for a remote config"},
  };
  Plant plant;
  for (const Attack& attack : attacks) {
    EXPECT_FALSE(plant.hear(attack.document)) << attack.what;
    EXPECT_EQ(plant.said().find(std::string("rejected \"v1\": ") + attack.said), 0u)
        << attack.what << ": " << plant.said();
  }
}

TEST(RemoteSize, APlantOfTheLargestKindIsTaken) {
  Plant plant;
  EXPECT_TRUE(plant.hear(many("1-50", json::array({tag("t", 10'000)})))) << plant.said();
}

/// A document may be as large as the local file.
TEST(RemoteSize, ALargeLocalFileStaysOpenForDocuments) {
  Config local;
  for (int i = 0; i < 10'001; ++i) local.devices.emplace_back();
  const ConfigLimits limits = remote_limits(local);
  EXPECT_EQ(limits.most.devices, 10'001u);
  EXPECT_EQ(limits.most.tags, kRemoteLimits.most.tags);
  EXPECT_EQ(limits.written, kFileLimits.written);
  EXPECT_EQ(remote_limits(Config{}).most.devices, kRemoteLimits.most.devices);
  EXPECT_EQ(remote_limits(Config{}).written, kRemoteLimits.written);
}

TEST(RemoteSize, ADocumentHasSoManyValuesOfJson) {
  std::string zeros = R"({"version": "v1", "config": {"devices": [0)";
  for (int i = 0; i < 200'000; ++i) zeros += ",0";
  const ReadDesired read = read_desired(zeros + "]}}");
  ASSERT_EQ(read.errors.size(), 1u);
  EXPECT_EQ(read.errors[0].text, "holds more than 200000 JSON values");
}

/// As many errors as a config lists, and the number of the others.
TEST(RemoteSize, ErrorsOfTheShapeAreCounted) {
  json document = {{"version", "v1"}, {"config", json::object()}};
  for (int i = 0; i < 1500; ++i) document["x" + std::to_string(i)] = 1;
  const auto errors = read_desired(document.dump()).errors;
  ASSERT_EQ(errors.size(), 1001u);
  EXPECT_EQ(errors[0].text, "500 more are not listed");
}

/// Errors of the limits and of the config share one list and one number.
TEST(RemoteSize, AllErrorsOfADocumentAreCountedTogether) {
  json plant = small_plant();
  plant["agent"]["remote_config"] = true;
  const Config local = good(plant.dump());
  json config = {{"devices", plant["devices"]}};
  json& tags = config["devices"][0]["tags"] = json::array();
  for (int i = 0; i < 1200; ++i) {
    config["x" + std::to_string(i)] = 1;
    tags.push_back({{"name", "t" + std::to_string(i)}, {"address", "X8"}});
  }
  const auto read = read_desired(json{{"version", "v1"}, {"config", config}}.dump());
  ASSERT_TRUE(read.errors.empty());
  const auto made = effective_config(plant.dump(), local, read.desired,
                                     [](std::string_view text) { return parse_config(text); });
  ASSERT_FALSE(made);
  EXPECT_EQ(made.error().size(), 1001u);
  EXPECT_EQ(made.error()[0].text, "1400 more are not listed");
}

TEST(RemoteSize, AnInterruptedJudgingEndsAtOnce) {
  std::atomic<bool> stop = true;
  int read = 0;
  const auto config = parse_config(small_plant().dump(),
                                   [&read](std::string_view) {
                                     ++read;
                                     return std::nullopt;
                                   },
                                   FilePrivacy::shared, {kRemoteLimits, &stop});
  EXPECT_FALSE(config.has_value());
  EXPECT_EQ(read, 0);
}

/// The reader itself requests the stop, at the first of 2,000 devices.
TEST(RemoteSize, JudgingIsInterruptedBetweenDevices) {
  std::atomic<bool> stop = false;
  int read = 0;
  json plant = small_plant();
  plant["devices"] = json::array();
  for (int i = 0; i < 2000; ++i)
    plant["devices"].push_back(
        {{"name", "d" + std::to_string(i)}, {"link", "${NAME}"}, {"protocol", "modbus-tcp"}});
  const auto config = parse_config(plant.dump(),
                                   [&](std::string_view) {
                                     ++read;
                                     stop = true;
                                     return "none";
                                   },
                                   FilePrivacy::shared, {kRemoteLimits, &stop});
  EXPECT_FALSE(config.has_value());
  EXPECT_LT(read, 10);
}

}  // namespace
}  // namespace fxagent
