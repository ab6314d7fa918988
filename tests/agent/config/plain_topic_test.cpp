#include "agent/config/plain_topic.h"

#include <gtest/gtest.h>

namespace fxagent {
namespace {

TEST(PlainTopic, PlacesAreReplaced) {
  const auto topic = PlainTopic::parse("{root}/{id}/x-{device}/{group}/{tag}", "fx/a", "edge7");
  ASSERT_TRUE(topic.has_value());
  EXPECT_EQ(topic->of("press1", "fast", "temp"), "fx/a/edge7/x-press1/fast/temp");
}

TEST(PlainTopic, FilterHasAWildcardForEachLevelWithAPlace) {
  const auto filter = [](std::string_view text) {
    return PlainTopic::parse(text, "fx", "edge7")->filter();
  };
  EXPECT_EQ(filter("{root}/{id}/{device}/{tag}"), "fx/edge7/+/+");
  EXPECT_EQ(filter("ulm/x-{device}-{group}/{tag}/now"), "ulm/+/+/now");
  EXPECT_EQ(filter("{tag}"), "+");
}

}  // namespace
}  // namespace fxagent
