#include "agent/cli/doctor/fixed_config.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

namespace fxagent {
namespace {

const std::string kTwoLinks = R"({ // a comment
  "links": [{"name": "a"}, {"name": "line1", "serial": {"path": "/dev/ttyS0"}}],
  "devices": [{"name": "plc", "tags": [{"name": "x"}, {"name": "level", "address": "D0"}]}]})";

TEST(FixedConfig, SetsKeysOfLinksDevicesAndTagsByTheirNames) {
  const auto fixed = nlohmann::json::parse(
      fixed_config(kTwoLinks, {{"links", "line1", "", "serial/parity", "\"even\""},
                               {"devices", "plc", "", "unit", "5"},
                               {"devices", "plc", "level", "word_order", "\"CDAB\""}}),
      nullptr, true, true);
  EXPECT_EQ(fixed["links"][1]["serial"]["parity"], "even");
  EXPECT_EQ(fixed["links"][1]["serial"]["path"], "/dev/ttyS0");
  EXPECT_EQ(fixed["devices"][0]["unit"], 5);
  EXPECT_EQ(fixed["devices"][0]["tags"][1]["word_order"], "CDAB");
}

// Only what changes differs from the text that the engineer wrote.
TEST(FixedConfig, KeepsTextAndComments) {
  const std::string text = R"({
  // The hall.
  "links": [
    {
      "name": "line1", // "parity": "odd"
      "serial": { "path": "/dev/ttyS0", "baud" /* of the meter */ : /* was 1200 */ 9600 }
    }
  ],
  "devices": [
    {
      /* first */
      "name": "m",
      "echo": true, "tags": [ {"name": "x", "scale": 0.10} ], "unit":1}
  ]
}
)";
  std::string expected = text;
  const auto expect = [&](const std::string& before, const std::string& after) {
    const std::size_t at = expected.find(before);
    ASSERT_NE(at, std::string::npos) << before;
    expected.replace(at, before.size(), after);
  };
  expect("*/ 9600 }", "*/ 19200 }");
  expect("{ \"path\"", "{ \"parity\": \"even\", \"path\"");
  expect("true,", "false,");
  expect("    {\n      /* first", "    {\n      \"timeout_ms\": 400,\n      /* first");
  expect("0.10}", "2}");
  expect(":1}", ":12}");
  EXPECT_EQ(fixed_config(text, {{"links", "line1", "", "serial/baud", "19200"},
                                {"links", "line1", "", "serial/parity", "\"even\""},
                                {"devices", "m", "", "echo", "false"},
                                {"devices", "m", "", "timeout_ms", "400"},
                                {"devices", "m", "x", "scale", "2"},
                                {"devices", "m", "", "unit", "12"}}),
            expected);
}

TEST(FixedConfig, AnyLineEndEndsAComment) {
  for (const std::string end : {"\n", "\r\n", "\r"}) {
    const std::string text =
        "{\"devices\": [{\"name\": \"m\", \"unit\": // 7" + end + " 1}]} // end" + end;
    std::string expected = text;
    expected.replace(text.find(" 1}"), 2, " 12");
    EXPECT_EQ(fixed_config(text, {{"devices", "m", "", "unit", "12"}}), expected);
  }
}

TEST(FixedConfig, SeveralKeysOfOneObjectAreAdded) {
  const auto fixed = nlohmann::json::parse(fixed_config(
      R"({"links": [{"name": "a", "serial": {"path": "p"}}]})",
      {{"links", "a", "", "serial/baud", "9600"}, {"links", "a", "", "serial/parity", "\"odd\""}}));
  EXPECT_EQ(fixed["links"][0]["serial"],
            nlohmann::json::parse(R"({"path": "p", "baud": 9600, "parity": "odd"})"));
}

TEST(FixedConfig, AnObjectIsNotReplaced) {
  const std::string text = R"({"devices": [{"name": "m", "commands": {"allow": []}}]})";
  const KeyChange change{"devices", "m", "", "commands", "5"};
  EXPECT_EQ(pointer_of(text, change), std::nullopt);
  EXPECT_EQ(fixed_config(text, {change}), text);
}

TEST(FixedConfig, AddsTheFirstKeyOfAnObject) {
  EXPECT_EQ(fixed_config(R"({"links": [{"name": "a", "serial": {}}]})",
                         {{"links", "a", "", "serial/baud", "9600"}}),
            R"({"links": [{"name": "a", "serial": {"baud": 9600}}]})");
}

TEST(FixedConfig, PointsAtTheKey) {
  EXPECT_EQ(pointer_of(kTwoLinks, {"devices", "plc", "level", "word_order", "0"}),
            "/devices/0/tags/1/word_order");
}

TEST(FixedConfig, EntryOfATemplateHasNoPointerAndChangesNothing) {
  const KeyChange change{"devices", "plc", "of_template", "word_order", "\"CDAB\""};
  EXPECT_EQ(pointer_of(kTwoLinks, change), std::nullopt);
  EXPECT_EQ(fixed_config(kTwoLinks, {change}), fixed_config(kTwoLinks, {}));
}

}  // namespace
}  // namespace fxagent
