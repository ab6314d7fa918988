#include "agent/config/read/config_limits.h"
#include "agent/config/loader.h"

#include <gtest/gtest.h>

#include "agent/config/json/tree.h"
#include "agent/config/suggestions.h"
#include "tests/agent/config/small_plant.h"
#include "tests/support/says.h"

namespace fxagent {
namespace {

using namespace test;
using nlohmann::json;

constexpr ConfigLimits kSmall{"this file", {2, 10, 6, 40, 100}, 1u << 20, 1u << 20};

std::string first_error(const json& plant, const ConfigLimits& limits = kSmall) {
  const auto config = parse_config(plant.dump(), environment(), FilePrivacy::shared, {limits});
  return config ? "" : config.error()[0].pointer + ": " + config.error()[0].text;
}

/// A link, a template, and for each of `counts` an entry for that many devices.
json plant_of(std::initializer_list<int> counts, const json& more = json::object()) {
  json plant = small_plant();
  plant["links"] = json::parse(R"([{"name": "gw", "tcp": {"host": "gw", "port": 502}}])");
  plant["templates"] = json::parse(R"({"m": {"protocol": "modbus-tcp", "link": "gw"}})");
  plant["templates"]["m"].update(more);
  plant["devices"] = json::array();
  for (const int count : counts) {
    const std::string name = "e" + std::to_string(plant["devices"].size()) + "-{n}";
    plant["devices"].push_back(
        {{"template", "m"}, {"name", name}, {"n", "1-" + std::to_string(count)}});
  }
  return plant;
}

json tags(int count, int values = 1) {
  json list = json::array();
  for (int i = 0; i < count; ++i)
    list.push_back({{"name", "t" + std::to_string(i)}, {"address", "hr:0"}, {"count", values}});
  return {{"tags", list}};
}

json groups(int count) {
  json list = json::array();
  for (int i = 0; i < count; ++i) list.push_back({{"name", "g" + std::to_string(i)}});
  return {{"groups", list}};
}

TEST(ConfigLimits, WhatAllEntriesMakeIsCounted) {
  const auto begins = [](const json& plant, const std::string& text) {
    const std::string error = first_error(plant);
    EXPECT_TRUE(error.starts_with(text)) << error;
  };
  EXPECT_EQ(first_error(plant_of({5, 5})), "");
  begins(plant_of({5, 6}),
         "/devices/1: with this there are 11 devices; this file may have at most 10");
  EXPECT_EQ(first_error(plant_of({5, 5}, tags(4))), "");
  begins(plant_of({5, 3, 1}, tags(5)),
         "/devices/2: with this there are 45 tags; this file may have at most 40");
  EXPECT_EQ(first_error(plant_of({2, 1}, groups(2))), "");
  begins(plant_of({2, 2}, groups(2)),
         "/devices/1: with this there are 8 groups; this file may have at most 6");
  EXPECT_EQ(first_error(plant_of({2, 3}, tags(2, 10))), "");
  begins(plant_of({2, 4}, tags(2, 10)),
         "/devices/1: with this there are 120 tag values; this file may have at most 100");
  begins(plant_of({9}, tags(5)),
         "/devices/0: with this there are 45 tags; this file may have at most 40");
}

TEST(ConfigLimits, DevicesOfDifferentSizesAreCountedAsTheyAre) {
  json plant = plant_of({2}, tags(1));
  plant["templates"]["m"]["tags"][0]["count"] = "{n}";
  plant["devices"][0]["n"] = json::array({1, 100});
  EXPECT_EQ(first_error(plant).find("/templates/m/tags/0: with this there are 101 tag values"), 0u)
      << first_error(plant);
}

TEST(ConfigLimits, LinksAndTextsAreCounted) {
  json plant = plant_of({1});
  for (int i = 0; i < 2; ++i)
    plant["links"].push_back({{"name", "x" + std::to_string(i)},
                              {"tcp", {{"host", "h" + std::to_string(i)}, {"port", 502}}}});
  EXPECT_EQ(first_error(plant).find("/links/2: with this there are 3 links"), 0u);
  json text = tags(1);
  text["tags"][0].update({{"type", "string"}, {"length", 202}});
  text["tags"][0].erase("count");
  EXPECT_EQ(first_error(plant_of({1}, text)).find("/templates/m/tags/0: with this there are 101"),
            0u);
}

/// Each entry and each template is small by itself.
TEST(ConfigLimits, WhatEntriesWouldBeWrittenOutIsAddedUp) {
  ConfigLimits limits = kSmall;
  limits.written = 10'000;
  const json more = {{"x", std::string(1000, 'x')}};
  EXPECT_EQ(first_error(plant_of({4}, more), limits).find("without templates"), std::string::npos);
  const auto config =
      parse_config(plant_of({4, 4}, more).dump(), environment(), FilePrivacy::shared, {limits});
  ASSERT_FALSE(config.has_value());
  expect_says(listed(config.error()), "without templates, the devices up to this one");
}

TEST(ConfigLimits, RemoteConfigMayBeAsLargeAsTheLocalFile) {
  const ConfigLimits small = remote_limits(good(small_plant().dump()));
  EXPECT_EQ(small.most.links, kRemoteLimits.most.links);
  EXPECT_EQ(small.memory, kRemoteLimits.memory);
  EXPECT_EQ(small.written, kRemoteLimits.written);
  Config large;
  large.links.resize(40'000);
  const ConfigLimits own = remote_limits(large);
  EXPECT_EQ(own.most.links, 40'000U);
  EXPECT_EQ(own.most.devices, kRemoteLimits.most.devices);
  EXPECT_EQ(own.memory, size_of(large).memory());
  EXPECT_GT(own.memory, kRemoteLimits.memory);
  EXPECT_EQ(own.written, kFileLimits.written);
}

TEST(ConfigLimits, MuchMemoryIsAWarning) {
  const auto warns = [](int values) {
    for (const std::string& warning : good(plant_of({16}, tags(1, values)).dump()).warnings)
      if (warning.find("MiB of memory") != std::string::npos) return true;
    return false;
  };
  EXPECT_FALSE(warns(60'000));
  EXPECT_TRUE(warns(65'535));
}

/// Finding a suggestion compares every word with every other word.
TEST(ConfigLimits, TwentyFindingsHaveASuggestion) {
  json plant = small_plant();
  plant["devices"] = json::array();
  for (int i = 0; i < 30; ++i)
    plant["devices"].push_back(
        {{"name", "d" + std::to_string(i)}, {"link", "lin"}, {"protocol", "modbus-tcp"}});
  const auto errors = error_of(parse_config(plant.dump(), environment()));
  ASSERT_EQ(errors.size(), 30u);
  for (std::size_t i = 0; i < 30; ++i)
    EXPECT_EQ(errors[i].text, i < 20 ? "there is no link \"lin\"; did you mean line1?"
                                     : "there is no link \"lin\"");
}

/// A template's error is one finding, however many devices it has.
TEST(ConfigLimits, ATemplateTakesOneSuggestion) {
  json plant = plant_of({30}, {{"link", "gx"}});
  plant["devices"].push_back({{"name", "last"}, {"link", "gx"}, {"protocol", "modbus-tcp"}});
  const auto errors = error_of(parse_config(plant.dump(), environment()));
  ASSERT_EQ(errors.size(), 2u);
  EXPECT_NE(listed(errors).rfind("did you mean gw?"), listed(errors).find("did you mean gw?"));
}

TEST(ConfigLimits, TheNearestOfVeryManyWordsIsNotLookedFor) {
  std::vector<std::string> words;
  for (int i = 0; i < 1001; ++i) words.push_back("name" + std::to_string(10'000 + i));
  std::vector<std::string_view> views(words.begin(), words.end());
  EXPECT_EQ(did_you_mean("nome10000", views), "");
  views.pop_back();
  EXPECT_EQ(did_you_mean("nome10000", views), "; did you mean name10000?");
  EXPECT_EQ(did_you_mean("NAME10000", views), "; did you mean name10000?");
}

TEST(ConfigLimits, ATextHasSoManyValuesOfJson) {
  const auto fault = [](const char* text, std::size_t nodes) {
    const auto tree = ConfigTree::parse(text, ConfigTree::Folding::tags, {.nodes = nodes});
    return tree ? std::string() : tree.error().text;
  };
  EXPECT_EQ(fault(R"({"a": [1, "x", null, true, 2.5]})", 7), "");
  EXPECT_EQ(fault(R"({"a": [1, "x", null, true, 2.5]})", 6), "holds more than 6 JSON values");
  // The limit applies to each folded array separately.
  constexpr const char* folded = R"({"devices": [{"tags": [1, 2, 3, 4], "groups": [1, 2, 3, 4]}]})";
  EXPECT_EQ(fault(folded, 5), "");
  EXPECT_EQ(fault(folded, 4), "holds more than 4 JSON values");
  EXPECT_EQ(fault(R"({"devices": [{"tags": [1, 2, 3, 4, 5, 6]}]})", 5),
            "holds more than 5 JSON values");
}

}  // namespace
}  // namespace fxagent
