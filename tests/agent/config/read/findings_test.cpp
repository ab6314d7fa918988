#include "agent/config/read/findings.h"

#include <gtest/gtest.h>

namespace fxagent {
namespace {

/// A template on line 1, two entries on lines 2 and 3.
struct FindingsTest : testing::Test {
  ConfigTree tree_ = *ConfigTree::parse(
      "{\"templates\": {\"m\": {\"unit\": 1}}, \"devices\": [\n{\"name\": \"a\"},\n{\"name\": "
      "\"b\"}]}");
  const ConfigNode& base_ = *tree_.root().find("templates")->find("m");
  const ConfigNode& unit_ = *base_.find("unit");
  const ConfigNode& first_ = tree_.root().find("devices")->children[0];
  const ConfigNode& second_ = tree_.root().find("devices")->children[1];
  Findings findings_;

  std::vector<std::string> texts() const {
    std::vector<std::string> list;
    for (const ConfigError& finding : findings_.in_order(tree_)) list.push_back(finding.text);
    return list;
  }
};

using Texts = std::vector<std::string>;

TEST_F(FindingsTest, OutsideOfManyDevicesEachStandsForItself) {
  findings_.add(second_.offset, second_, "late", nullptr, 0);
  findings_.add(first_.offset, first_, "same", nullptr, 0);
  findings_.add(first_.offset, first_, "same", nullptr, 0);
  EXPECT_EQ(texts(), (Texts{"same", "same", "late"}));
}

TEST_F(FindingsTest, OnePlaceOfManyDevicesIsSaidOnce) {
  for (std::uint32_t device = 1; device <= 3; ++device) {
    const DeviceOrigin origin{&first_, &base_, std::to_string(device)};
    findings_.add(unit_.offset, unit_, "wrong " + std::to_string(device), &origin, device);
  }
  EXPECT_EQ(texts(), (Texts{"wrong 1; for the device at /devices/0 (line 2), {n} being 1, and for "
                            "2 others"}));
}

TEST_F(FindingsTest, EntriesShareATextAndNotAnother) {
  const DeviceOrigin one{&first_, &base_, ""};
  const DeviceOrigin two{&second_, &base_, ""};
  findings_.add(unit_.offset, unit_, "same", &one, 1);
  findings_.add(unit_.offset, unit_, "same", &two, 2);
  EXPECT_EQ(texts(), (Texts{"same; for the device at /devices/0 (line 2), and for 1 other"}));
  findings_ = {};
  findings_.add(unit_.offset, unit_, "one", &one, 1);
  findings_.add(unit_.offset, unit_, "other", &two, 2);
  EXPECT_EQ(texts().size(), 2U);
}

TEST_F(FindingsTest, TwoFaultsOfOneDeviceAtOnePlaceAreBothSaid) {
  const DeviceOrigin one{&first_, &base_, "1"};
  const DeviceOrigin two{&first_, &base_, "2"};
  findings_.add(unit_.offset, unit_, "a", &one, 1);
  findings_.add(unit_.offset, unit_, "b", &one, 1);
  findings_.add(unit_.offset, unit_, "a", &two, 2);
  findings_.add(unit_.offset, unit_, "b", &two, 2);
  EXPECT_EQ(texts().size(), 2U);
}

TEST_F(FindingsTest, TheOtherPlaceIsNamed) {
  const DeviceOrigin with_base{&first_, &base_, ""};
  findings_.add(first_.offset, first_, "a", &with_base, 1);
  const DeviceOrigin without{&second_, nullptr, "7"};
  findings_.add(second_.offset, second_, "b", &without, 2);
  EXPECT_EQ(texts(), (Texts{"a; its template is at /templates/m (line 1)", "b; {n} being 7"}));
}

TEST_F(FindingsTest, WhatIsTooMuchIsCounted) {
  for (std::size_t i = 0; i < Findings::kMost; ++i)
    findings_.add(first_.offset, first_, std::to_string(i), nullptr, 0);
  EXPECT_EQ(texts().size(), Findings::kMost);
  EXPECT_EQ(texts().front(), "0");
  findings_.add(first_.offset, first_, "more", nullptr, 0);
  const DeviceOrigin origin{&first_, &base_, "1"};
  findings_.add(unit_.offset, unit_, "wrong", &origin, 1);
  EXPECT_EQ(texts().size(), Findings::kMost + 1);
  EXPECT_EQ(texts().front(), "2 more are not listed");
}

TEST_F(FindingsTest, WhatManyDevicesRepeatIsCountedOnce) {
  for (std::size_t i = 0; i < Findings::kMost; ++i)
    findings_.add(second_.offset, second_, std::to_string(i), nullptr, 0);
  for (std::uint32_t device = 1; device <= 50; ++device) {
    const DeviceOrigin origin{device <= 25 ? &first_ : &second_, &base_, std::to_string(device)};
    findings_.add(unit_.offset, unit_, "wrong", &origin, device);
    findings_.add(unit_.key_offset, unit_, "unknown", &origin, device);
  }
  EXPECT_EQ(texts().front(), "2 more are not listed");
}

TEST_F(FindingsTest, AFaultOfTheKeyIsToldFromOneOfTheValue) {
  findings_.add(unit_.offset, unit_, "value", nullptr, 0);
  findings_.add(unit_.key_offset, unit_, "key", nullptr, 0);
  const auto list = findings_.in_order(tree_);
  ASSERT_EQ(list.size(), 2U);
  EXPECT_EQ(list[0].pointer, list[1].pointer);
  EXPECT_TRUE(list[0].of_key);
  EXPECT_FALSE(list[1].of_key);
}

TEST(ErrorListTest, TheNumbersOfJoinedListsAreAdded) {
  ErrorList list;
  for (std::size_t i = 0; i < Findings::kMost - 1; ++i) list.add({"", 0, "fault"});
  list.add(ConfigErrors{unlisted_error(5), {"/a", 0, "one"}, {"/b", 0, "two"}});
  const auto errors = list.take();
  ASSERT_EQ(errors.size(), Findings::kMost + 1);
  EXPECT_EQ(errors.front().text, "6 more are not listed");
  EXPECT_EQ(errors.front().unlisted, 6U);
  EXPECT_EQ(errors.back().text, "one");
}

TEST_F(FindingsTest, WhatIsListedIsCountedForItsOthersThen) {
  const DeviceOrigin origin{&first_, &base_, "1"};
  findings_.add(unit_.offset, unit_, "wrong", &origin, 1);
  for (std::size_t i = 0; i < Findings::kMost; ++i)
    findings_.add(second_.offset, second_, std::to_string(i), nullptr, 0);
  findings_.add(unit_.offset, unit_, "wrong", &origin, 2);
  EXPECT_EQ(texts()[0], "1 more is not listed");
  EXPECT_NE(texts()[1].find("for 1 other"), std::string::npos) << texts()[1];
}

}  // namespace
}  // namespace fxagent
