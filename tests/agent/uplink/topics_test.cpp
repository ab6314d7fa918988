#include "agent/uplink/topics.h"

#include <gtest/gtest.h>

namespace fxagent {
namespace {

TEST(Topics, WildcardsControlAndForeignEncodingsAreNotPublishable) {
  EXPECT_TRUE(is_publishable("fx/plant-a/edge7/press1/result"));
  EXPECT_TRUE(is_publishable("halle/öl"));
  for (const std::string bad : {"", "a/+/b", "a/#", "$SYS/x", "\xFF"})
    EXPECT_FALSE(is_publishable(bad)) << bad;
  EXPECT_FALSE(is_publishable(std::string("a\0b", 3)));
  EXPECT_TRUE(is_publishable(std::string(65535, 'a')));
  EXPECT_FALSE(is_publishable(std::string(65536, 'a')));
}

TEST(Topics, DeviceIsTheOneLevelBetweenBaseAndLeaf) {
  EXPECT_EQ(device_of("fx/e/press1/command", "fx/e", "command"), "press1");
  EXPECT_EQ(device_of("fx/e/press1/state", "fx/e", "command"), std::nullopt);
  EXPECT_EQ(device_of("fx/e/a/b/command", "fx/e", "command"), std::nullopt);
  EXPECT_EQ(device_of("fx/e//command", "fx/e", "command"), std::nullopt);
  EXPECT_EQ(device_of("fx/e/command", "fx/e", "command"), std::nullopt);
  EXPECT_EQ(device_of("fx/edge/press1/command", "fx/e", "command"), std::nullopt);
}

TEST(Topics, DataTopicNamesDeviceAndGroup) {
  const auto live = data_topic_of("fx/e/press1/data/fast", "fx/e");
  ASSERT_TRUE(live);
  EXPECT_EQ(live->device, "press1");
  EXPECT_EQ(live->group, "fast");
  EXPECT_FALSE(live->is_history);
  const auto history = data_topic_of("fx/e/press1/data/history/history", "fx/e");
  ASSERT_TRUE(history);
  EXPECT_EQ(history->group, "history");
  EXPECT_TRUE(history->is_history);
  for (const std::string_view other :
       {"fx/e/press1/data", "fx/e/press1/data/", "fx/e/press1/state", "fx/e//data/fast",
        "fx/e/data/fast", "fx/edge/press1/data/fast", "fx/e/press1/data/fast/x",
        "fx/e/press1/data/a/b/history", "fx/e/press1/data//history", "fx/e"})
    EXPECT_FALSE(data_topic_of(other, "fx/e")) << other;
}

std::string fault_of(std::string_view topic) {
  return response_topic_fault(topic, "fx/plant-a/edge7", "press1");
}

TEST(Topics, ResponseTopicBelowTheOwnResultIsTaken) {
  EXPECT_EQ(fault_of("fx/plant-a/edge7/press1/result/hmi"), "");
  EXPECT_EQ(fault_of("fx/plant-a/edge7/press1/result/hmi/7"), "");
}

TEST(Topics, ResponseTopicThatCouldForgeOrCommandIsRefused) {
  for (const std::string_view bad :
       {"a/+", "#", "$share/x", "other/command", "command", "fx/plant-a/edge7/press1/command",
        "fx/plant-a/edge7/press1/state", "fx/plant-a/edge7/press1/result",
        "fx/plant-a/edge7/press1/result/", "fx/plant-a/edge7/press2/result/x",
        "fx/plant-a/edge8/press1/result/x", "fx/plant-a/edge7/press1/result/command", "fx/plant-a/",
        "clients/hmi/replies", "fx/plant-ab/x", "zigbee/lamp/set",
        "fx/plant-b/edge7/press1/result/x"})
    EXPECT_NE(fault_of(bad), "") << bad;
}

}  // namespace
}  // namespace fxagent
