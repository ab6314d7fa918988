#include "agent/http/page_commands.h"

#include <gtest/gtest.h>

#include <fstream>

#include "tests/support/scratch.h"

namespace fxagent {
namespace {

using namespace test;

constexpr std::string_view kCommand =
    R"({"device":"press1","id":"a","op":"read","tag":"temp","by":"eve"})";

struct PageCommandsTest : testing::Test {
  PageCommandsTest() {
    std::ofstream file(scratch_.path("token"));
    file << "# people\n\nanna  0123456789abcdef\nsecret-without-name\r\n"
            "bob three words here1234567\n";
  }

  PageCommands& commands() {
    if (!commands_)
      commands_.emplace(scratch_.path("token"),
                        [this](RelayedCommand command) { placed_.push_back(std::move(command)); });
    return *commands_;
  }
  static HttpRequest request() {
    HttpRequest request;
    request.host = "127.0.0.1:8080";
    request.is_post = true;
    request.body = kCommand;
    request.authorization = "Bearer 0123456789abcdef";
    request.origin = "http://127.0.0.1:8080";
    request.fetch_site = "same-origin";
    request.number = 7;
    return request;
  }
  /// Returns the status of the refusal; 0: the command was placed.
  unsigned refused(const HttpRequest& of) {
    const auto answer = commands().place(of);
    return answer ? answer->status : 0;
  }

  const Scratch scratch_;
  std::vector<RelayedCommand> placed_;
  std::optional<PageCommands> commands_;
};

TEST_F(PageCommandsTest, CommandIsPlacedAndItsResultComesBack) {
  ASSERT_EQ(refused(request()), 0U);
  ASSERT_EQ(placed_.size(), 1U);
  EXPECT_EQ(placed_[0].device, "press1");
  EXPECT_EQ(placed_[0].payload, R"({"id":"a","op":"read","tag":"temp","by":"eve"})");
  EXPECT_EQ(placed_[0].sender, "page:anna");
  EXPECT_TRUE(commands().take_results().empty());
  placed_[0].reply("{}");
  const auto results = commands().take_results();
  ASSERT_EQ(results.size(), 1U);
  EXPECT_EQ(results[0].number, 7U);
  EXPECT_EQ(results[0].text, "{}\n");
  EXPECT_TRUE(commands().take_results().empty());
}

TEST_F(PageCommandsTest, ResultMayComeAfterTheEnd) {
  ASSERT_EQ(refused(request()), 0U);
  commands_.reset();
  placed_[0].reply("{}");
}

TEST_F(PageCommandsTest, TokenWithoutNameLeavesTheNameToTheCommand) {
  HttpRequest one = request();
  one.authorization = "Bearer secret-without-name";
  ASSERT_EQ(refused(one), 0U);
  EXPECT_EQ(placed_[0].sender, "page:eve");
}

TEST_F(PageCommandsTest, WithoutATokenFileThePageIsReadOnly) {
  PageCommands none("", [](const RelayedCommand&) { FAIL(); });
  EXPECT_EQ(none.place(request())->status, 403U);
}

TEST_F(PageCommandsTest, UnreadableTokenFileRefusesAll) {
  PageCommands none(scratch_.path("missing"), [](const RelayedCommand&) { FAIL(); });
  EXPECT_EQ(none.place(request())->status, 503U);
}

TEST_F(PageCommandsTest, OnlyAWholeTokenCounts) {
  for (const std::string_view given :
       {"", "Bearer", "Bearer ", "Bearer 0123456789abcde", "Bearer 0123456789abcdef0",
        "Bearer0123456789abcdef", "Basic 0123456789abcdef", "Bearer anna", "Bearer #",
        "Bearer three", "Bearer words", "Bearer here1234567", "Bearer bob",
        "Bearer anna 0123456789abcdef", "0123456789abcdef"}) {
    HttpRequest one = request();
    one.authorization = given;
    EXPECT_EQ(refused(one), 401U) << given;
  }
}

TEST_F(PageCommandsTest, SchemeMayBeInAnyCase) {
  for (const std::string_view given : {"bearer 0123456789abcdef", "BEARER 0123456789abcdef"}) {
    HttpRequest one = request();
    one.authorization = given;
    EXPECT_EQ(refused(one), 0U) << given;
  }
}

TEST_F(PageCommandsTest, OtherSitesAreRefused) {
  for (const std::string_view origin :
       {"http://evil.example", "http://127.0.0.1:9999", "http://127.0.0.1", "null",
        "http://127.0.0.1:8080.evil.example", "127.0.0.1:8080"}) {
    HttpRequest one = request();
    one.origin = origin;
    EXPECT_EQ(refused(one), 403U) << origin;
  }
  for (const std::string_view site : {"cross-site", "same-site", "none"}) {
    HttpRequest one = request();
    one.fetch_site = site;
    EXPECT_EQ(refused(one), 403U) << site;
  }
  HttpRequest script = request();  // curl sends neither
  script.origin = "";
  script.fetch_site = "";
  EXPECT_EQ(refused(script), 0U);
}

TEST_F(PageCommandsTest, OnlyTheDeviceIsTakenOutOfTheCommand) {
  const std::vector<std::pair<std::string, std::string>> cases{
      {R"({"device":"a"})", "{}"},
      {R"({ "device" : "a" , "id":"x"})", R"({  "id":"x"})"},
      {R"({"id":"x" , "device":"a"})", R"({"id":"x" })"},
      {R"({"id":"device","device":"a\"}b","op":["device",{"device":"b"}]})",
       R"({"id":"device","op":["device",{"device":"b"}]})"},
      {R"({"value":1e3,"device":"a","value":9007199254740993})",
       R"({"value":1e3,"value":9007199254740993})"},
      {"{\"id\":[7],\"\\u0064evice\":\"a,\\\\\",\"op\":1}", "{\"id\":[7],\"op\":1}"},
  };
  for (const auto& [body, payload] : cases) {
    HttpRequest one = request();
    one.body = body;
    ASSERT_EQ(refused(one), 0U) << body;
    EXPECT_EQ(placed_.back().payload, payload);
  }
}

TEST_F(PageCommandsTest, RefusalOfABrokenBodyNamesItsPlaceOrKey) {
  const std::vector<std::pair<std::string, std::string>> cases{
      {R"({"device":"a",})", "not JSON at line 1, column 15"},
      {"{\"device\":\"a\",\n\"id\" 7}", "not JSON at line 2, column 5"},
      {R"({"device":"a","device":"b"})", "key 'device' occurs twice"},
  };
  for (const auto& [body, why] : cases) {
    HttpRequest one = request();
    one.body = body;
    const auto answer = commands().place(one);
    ASSERT_TRUE(answer) << body;
    EXPECT_EQ(answer->status, 400U);
    EXPECT_NE(answer->body->find(why), std::string::npos) << *answer->body;
  }
}

TEST_F(PageCommandsTest, BodyMustNameItsDevice) {
  const std::string deep(60'000, '[');
  for (const std::string_view body :
       {std::string_view(""), std::string_view("[]"), std::string_view("{"),
        std::string_view(R"({"id":"a"})"), std::string_view(R"({"device":7})"),
        std::string_view(R"({"device":""})"), std::string_view(deep),
        std::string_view("{\"d\\u0065vice\":\"a\"}\0\"", 21)}) {
    HttpRequest one = request();
    one.body = body;
    EXPECT_EQ(refused(one), 400U) << body.substr(0, 20);
  }
  EXPECT_TRUE(placed_.empty());
}

}  // namespace
}  // namespace fxagent
