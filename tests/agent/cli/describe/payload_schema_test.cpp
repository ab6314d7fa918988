// docs/payloads.schema.json has the topics, words and limits of the program.
#include <gtest/gtest.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "agent/cli/describe/documents.h"
#include "agent/cli/describe/schema_parts.h"
#include "agent/cli/describe/topics.h"
#include "agent/commands/parse/parse.h"
#include "agent/handover/telemetry.h"
#include "agent/remote/desired_config.h"
#include "agent/remote/remote_report.h"
#include "agent/text/json_writer.h"

namespace fxagent::contract {
namespace {

/// Returns the words of the enumerators from `first` to `last`.
template <class Enum>
Json words(Enum first, Enum last) {
  Json out = Json::array();
  for (auto each = static_cast<unsigned>(first); each <= static_cast<unsigned>(last); ++each)
    out.push_back(to_string(static_cast<Enum>(each)));
  return out;
}

/// Returns the part of the schemas at a JSON pointer.
Json at(const char* pointer) { return payload_schemas().at(Json::json_pointer(pointer)); }

TEST(PayloadSchema, TopicsAreThoseOfTheProgram) {
  Json wanted = Json::object();
  for (const Topic& topic : topics())
    wanted["{base}/" + std::string(topic.address)] = {
        {"description", topic.summary}, {"$ref", "#/$defs/" + std::string(topic.schema)}};
  EXPECT_EQ(payload_page().at("properties").dump(), wanted.dump());
}

TEST(PayloadSchema, WordsAreThoseOfTheProgram) {
  const Json statuses = words(kCommandStatuses.front(), kCommandStatuses.back());
  EXPECT_EQ(at("/status/enum"), statuses);
  EXPECT_EQ(at("/health/properties/commands/required"), statuses);
  Json counted = Json::array();
  const Json counts = at("/health/properties/commands/properties");
  for (const auto& [word, count] : counts.items()) counted.push_back(word);
  EXPECT_EQ(counted, statuses);
  EXPECT_EQ(at("/reason/enum"), words(Reason::too_large, Reason::interrupted));
  EXPECT_EQ(at("/data_type/enum"), words(DataType::boolean, DataType::float64));
  using State = DeviceStatus::State;
  EXPECT_EQ(at("/device_state/properties/state/enum"), words(State::offline, State::online));
  const Json remote = words(RemoteReport::State::applied, RemoteReport::State::rolled_back);
  EXPECT_EQ(at("/reported/properties/state/enum"), remote);
  EXPECT_EQ(at("/health/properties/config/properties/remote/oneOf/0/properties/state/enum"),
            remote);
  Json why_bad = words(BadReason::timeout, BadReason::bad_value);
  EXPECT_EQ(at("/bad_reading/properties/why/enum"), why_bad);
  for (const char* word : {"starting", "never_silent", "model_unknown", "yielded"})
    why_bad.push_back(word);
  EXPECT_EQ(at("/device_state/properties/reason/oneOf/0/enum"), why_bad);
}

TEST(PayloadSchema, EachOperationHasACommandWithTheSameKeys) {
  Json commands = Json::array();
  const Json all = at("/command_write/properties");
  for (const Op op : kOps) {
    commands.push_back(reference(command_schema_name(op)));
    const Json command = payload_schemas().at(command_schema_name(op));
    EXPECT_EQ(command["properties"]["op"], constant(to_string(op)));
    EXPECT_EQ(command["additionalProperties"], false);
    for (const auto& [key, value] : command["properties"].items())
      EXPECT_TRUE(all.contains(key)) << key;
    std::vector<std::string> common{"id", "expires", "by", "dry_run"};
    if (op != Op::run && op != Op::stop) common.insert(common.end(), {"tag", "address", "type"});
    for (const std::string& key : common)
      EXPECT_EQ(command["properties"][key], all[key]) << to_string(op) << " " << key;
    for (const auto& [key, value] : all.items())
      EXPECT_TRUE(command["properties"].contains(key) || key == "value" || key == "expect") << key;
  }
  EXPECT_EQ(at("/command/oneOf"), commands);
}

TEST(PayloadSchema, LimitsAreThoseOfTheProgram) {
  for (const Op op : {Op::write, Op::force_on, Op::force_off})
    EXPECT_EQ(
        payload_schemas()[command_schema_name(op)]["properties"]["targets"]["oneOf"][0]["maxItems"],
        kMostTargets);
  EXPECT_EQ(at("/link_command/oneOf/0/properties/minutes/oneOf/0/maximum"), kLongestYield.count());
  for (const char* key :
       {"/desired/properties/version/maxLength", "/desired/properties/by/maxLength"})
    EXPECT_EQ(at(key), kMaxDesiredVersion);
  for (const char* place : {"/link_command/oneOf/0/properties/expires/oneOf",
                            "/link_command/oneOf/1/properties/expires/oneOf"})
    EXPECT_EQ(at(place), at("/command_write/properties/expires/oneOf"));
  EXPECT_EQ(at("/id/oneOf/1/maximum"), fxagent::json::kMaxExactInteger);
  EXPECT_EQ(at("/id/oneOf/1/minimum"), -fxagent::json::kMaxExactInteger);
  EXPECT_EQ(at("/command_write/properties/expires/oneOf/0/maximum"),
            fxagent::json::kMaxExactInteger);
}

}  // namespace
}  // namespace fxagent::contract
