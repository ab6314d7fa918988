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
                               {"devices", "plc", "level", "word_order", "\"CDAB\""}}));
  EXPECT_EQ(fixed["links"][1]["serial"]["parity"], "even");
  EXPECT_EQ(fixed["links"][1]["serial"]["path"], "/dev/ttyS0");
  EXPECT_EQ(fixed["devices"][0]["unit"], 5);
  EXPECT_EQ(fixed["devices"][0]["tags"][1]["word_order"], "CDAB");
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
