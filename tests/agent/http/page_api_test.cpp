#include "agent/http/page_api.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "protocol/catalog.h"
#include "tests/agent/http/made_up_status.h"

namespace fxagent {
namespace {

using namespace test;
using nlohmann::json;

class FixedValues final : public GroupValues {
 public:
  explicit FixedValues(std::map<std::string, LastValue, std::less<>> values)
      : values_(std::move(values)) {}
  std::map<std::string, LastValue, std::less<>> by_tag() const override { return values_; }

 private:
  std::map<std::string, LastValue, std::less<>> values_;
};

LastValue number(std::int64_t value, std::int64_t ts_ms) {
  LastValue last;
  last.value = Value(Scalar(value));
  last.ts_ms = ts_ms;
  return last;
}

struct PageApiTest : testing::Test {
  PageApiTest() : status_(made_up_status()) {
    Config config = plant_with_store();
    for (DeviceConfig& device : config.devices)
      device.protocol = find_protocol("fx-programming-port");
    config.hash = "fed4";
    config.mqtt.password = "secret";
    status_.config = std::make_shared<const Config>(config);
    LastValue bad = number(7, 5000);
    bad.bad = BadReason::timeout;
    bad.bad_since_ms = 6000;
    status_.values = {{values({{"temp", number(21, 4000)}, {"pressure", bad}}), nullptr}, {}};
  }

  static std::shared_ptr<const GroupValues> values(
      std::map<std::string, LastValue, std::less<>> of) {
    return std::make_shared<const FixedValues>(std::move(of));
  }

  /// Asks for a path with a query, as the server passes it.
  HttpAnswer ask(const std::string& path,
                 std::map<std::string_view, std::string_view> arguments = {},
                 const std::string& etag = {}) {
    HttpRequest request{path, "localhost", etag, std::move(arguments)};
    return api_.answer(request, now_);
  }
  json changes(std::map<std::string_view, std::string_view> arguments) {
    const HttpAnswer answer = ask("/api/changes", std::move(arguments));
    EXPECT_EQ(answer.status, 200U);
    return json::parse(*answer.body);
  }
  /// Makes the current content of `status_` the newest status.
  void publish() { now_ = std::make_shared<const AgentStatus>(status_); }

  AgentStatus status_;
  std::shared_ptr<const AgentStatus> now_;
  PageApi api_;
};

TEST_F(PageApiTest, ConfigHasLinksDevicesAndTagsAndNoSecret) {
  publish();
  const HttpAnswer answer = ask("/api/config");
  EXPECT_EQ(answer.body->find("secret"), std::string::npos);
  const json config = json::parse(*answer.body);
  EXPECT_EQ(config["hash"], "fed4");
  EXPECT_EQ(config["base"], "fx/plant-a/edge7");
  EXPECT_EQ(config["links"][0]["wire"], "serial  9600 7E1");
  const json& press = config["devices"][0];
  EXPECT_EQ(press["protocol"], "fx-programming-port");
  EXPECT_EQ(press["groups"][0]["tags"][0],
            json::parse(R"(["temp","D100","int16","°C",0,"",1,{}])"));
  EXPECT_EQ(press["groups"][1]["tags"][0][0], "setpoint");
  EXPECT_EQ(press["groups"][1]["tags"][0][4], 1);
  EXPECT_EQ(ask("/api/config", {}, answer.etag).status, 304U);
  status_.boot = "another";
  publish();
  EXPECT_EQ(ask("/api/config", {}, answer.etag).status, 200U) << "another run";
}

TEST_F(PageApiTest, CommandsAfterTheLastThatAPageHas) {
  status_.last_commands.clear();
  for (const std::uint64_t number : {3U, 4U, 5U}) {
    LastCommand last;
    last.number = number;
    status_.last_commands.push_back(std::make_shared<const LastCommand>(last));
  }
  publish();
  EXPECT_EQ(changes({})["last_commands"].size(), 3U);
  const json after = changes({{"commands", "4"}})["last_commands"];
  ASSERT_EQ(after.size(), 1U);
  EXPECT_EQ(after[0]["n"], 5);
}

TEST_F(PageApiTest, ATagHasTheLabelsOfItsValues) {
  Config config = *status_.config;
  config.devices[0].tags[0].units =
      std::make_shared<const TagUnits>(TagUnits{.states = {{0, "stop"}, {-1, "jam"}}});
  status_.config = std::make_shared<const Config>(config);
  publish();
  const json out = json::parse(*ask("/api/config").body);
  EXPECT_EQ(out["devices"][0]["groups"][0]["tags"][0][7],
            json::parse(R"({"0": "stop", "-1": "jam"})"));
}

TEST_F(PageApiTest, AVacantPlaceIsNull) {
  Config config = *status_.config;
  config.devices[0] = {};
  config.links[0] = {};
  status_.config = std::make_shared<const Config>(config);
  status_.values = {};
  publish();
  const json out = json::parse(*ask("/api/config").body);
  EXPECT_TRUE(out["devices"][0].is_null());
  EXPECT_TRUE(out["links"][0].is_null());
  EXPECT_TRUE(changes({})["links"][0].is_null());
  EXPECT_EQ(ask("/api/plan", {{"link", "0"}}).status, 404U);
}

TEST_F(PageApiTest, FirstAnswerHasEverythingAndTheNextOnlyChanges) {
  publish();
  const json first = changes({{"groups", "0.0"}});
  EXPECT_EQ(first["devices"].size(), 2U);
  EXPECT_EQ(first["devices"]["1"]["reason"], "timeout");
  EXPECT_EQ(first["values"]["0.0"],
            json::parse(R"([[21,4000],null,[7,5000,"timeout",6000],null,null])"));
  EXPECT_EQ(first["samples"]["waiting"], 6);
  EXPECT_EQ(first["links"][0], json::parse("[1,0,82,125,0]"));
  const std::string now = std::to_string(first["now"].get<int>());
  const std::string events =
      std::to_string(first["events"].empty() ? 0 : first["events"].back()["n"].get<int>());
  EXPECT_EQ(
      ask("/api/changes", {{"since", now}, {"values", now}, {"events", events}, {"groups", "0.0"}})
          .status,
      304U);

  status_.devices[0] = std::make_shared<const DeviceStatus>(offline(0, "link_down"));
  publish();
  const json next = changes({{"since", now}, {"values", now}, {"groups", "0.0"}});
  EXPECT_EQ(next["devices"].size(), 1U);
  EXPECT_EQ(next["devices"]["0"]["reason"], "link_down");
  EXPECT_TRUE(next["values"].empty()) << "the group has not changed";

  status_.values[0][0] = values({{"temp", number(22, 9000)}});
  publish();
  const std::string then = std::to_string(next["now"].get<int>());
  EXPECT_EQ(changes({{"since", then}, {"values", then}, {"groups", "0.0"}})["values"]["0.0"][0],
            json::parse("[22,9000]"));
}

TEST_F(PageApiTest, GroupsThatAreNewToThePageComeWhole) {
  publish();
  const std::string now = std::to_string(changes({})["now"].get<int>());
  const json more = changes({{"since", now}, {"values", "0"}, {"groups", "0.0"}});
  EXPECT_TRUE(more["devices"].empty());
  EXPECT_EQ(more["values"].size(), 1U);
}

TEST_F(PageApiTest, ANumberOfAnotherRunMeansNothing) {
  publish();
  EXPECT_EQ(changes({{"since", "99"}})["devices"].size(), 2U);
}

TEST_F(PageApiTest, AnotherConfigIsAllNew) {
  publish();
  const std::string now = std::to_string(changes({})["now"].get<int>());
  Config config = *status_.config;
  config.hash = "0002";
  status_.config = std::make_shared<const Config>(config);
  publish();
  const json next = changes({{"since", now}});
  EXPECT_EQ(next["hash"], "0002");
  EXPECT_EQ(next["devices"].size(), 2U);
}

TEST_F(PageApiTest, AGroupOrLinkThatDoesNotExistIsLeftOut) {
  publish();
  const json out = changes({{"groups", "9.0,0.9,1.0,4000000000.4000000000"}, {"link", "7"}});
  EXPECT_TRUE(out["values"].empty());
  EXPECT_FALSE(out.contains("link"));
  EXPECT_EQ(ask("/api/plan", {{"link", "7"}}).status, 404U);
  EXPECT_EQ(ask("/api/plan").status, 404U);
}

TEST_F(PageApiTest, WrongArgumentsAreNamed) {
  publish();
  std::string many = "0.0";
  for (int i = 0; i < 250; ++i) many += ",0.0";
  for (const auto& [name, value] : std::map<std::string, std::string>{{"since", "x"},
                                                                      {"values", "-1"},
                                                                      {"events", ""},
                                                                      {"link", "1e3"},
                                                                      {"groups", "0"},
                                                                      {"groups", "0.x"},
                                                                      {"groups", many}}) {
    const HttpAnswer answer = ask("/api/changes", {{name, value}});
    EXPECT_EQ(answer.status, 400U) << name << "=" << value;
    EXPECT_NE(answer.body->find("groups is a list"), std::string::npos);
  }
  EXPECT_EQ(ask("/api/other").status, 404U);
}

TEST_F(PageApiTest, ALinkHasItsCountersAndItsPlan) {
  publish();
  const json link = changes({{"link", "0"}})["link"];
  EXPECT_EQ(link["exchanges"], 9642);
  EXPECT_EQ(link["devices"][0]["polls"], 4821);
  const json plan = json::parse(*ask("/api/plan", {{"link", "0"}}).body);
  ASSERT_EQ(plan["groups"].size(), 4U);
  EXPECT_GT(plan["groups"][0]["exchanges"], 0);
  EXPECT_TRUE(plan["groups"][0]["ms"].is_null()) << "the line has no speed";
}

}  // namespace
}  // namespace fxagent
