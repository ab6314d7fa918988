#include "agent/remote/kept_configs.h"

#include <gtest/gtest.h>

#include "tests/agent/remote/remote_plant.h"
#include "tests/support/says.h"

namespace fxagent {
namespace {

using namespace test;

KeptConfigs some() {
  KeptConfigs kept;
  kept.good = KeptConfig{desired_of({{"version", "1"}, {"patch", json::object()}}), 1000};
  kept.trying =
      KeptConfig{desired_of({{"version", "2"}, {"by", "ann"}, {"config", json::object()}}), 2000};
  kept.stopped = true;
  kept.agent = "fx/edge7";
  kept.before = KeptConfig{desired_of({{"version", "0"}, {"patch", json::object()}}), 500};
  kept.watched = true;
  kept.ends = 1;
  kept.boot = "b00t";
  kept.judged = {"{}", "fedcba9876543210", "4", "eve"};
  kept.rolled_back = {"0123456789abcdef", "3", "bob", "the broker was lost", 3000};
  return kept;
}

TEST(KeptConfigs, ComeBackAsTheyWere) {
  const auto back = kept_configs_from(to_text(some()));
  ASSERT_TRUE(back.has_value()) << back.error();
  ASSERT_TRUE(back->good && back->trying && back->judged && back->rolled_back);
  EXPECT_EQ(back->good->document.text, some().good->document.text);
  EXPECT_EQ(back->good->document.hash, some().good->document.hash);
  EXPECT_EQ(back->good->since_ms, 1000);
  EXPECT_EQ(back->trying->document.version, "2");
  EXPECT_EQ(back->trying->document.by, "ann");
  EXPECT_TRUE(back->stopped);
  EXPECT_EQ(back->rolled_back->why, "the broker was lost");
  EXPECT_EQ(back->rolled_back->by, "bob");
  EXPECT_EQ(back->rolled_back->since_ms, 3000);
  EXPECT_EQ(back->agent, "fx/edge7");
  ASSERT_TRUE(back->before.has_value());
  EXPECT_EQ(back->before->document.version, "0");
  EXPECT_EQ(back->before->since_ms, 500);
  EXPECT_TRUE(back->watched);
  EXPECT_EQ(back->ends, 1);
  EXPECT_EQ(back->boot, "b00t");
  EXPECT_EQ(back->judged->text, "{}");
  EXPECT_EQ(back->judged->hash, "fedcba9876543210");
  EXPECT_EQ(back->judged->version, "4");
  EXPECT_EQ(back->judged->by, "eve");
  const auto none = kept_configs_from(to_text(KeptConfigs{}));
  ASSERT_TRUE(none.has_value());
  EXPECT_TRUE(none->empty());
}

TEST(KeptConfigs, DamageIsFound) {
  const std::string text = to_text(some());
  for (std::size_t length = 0; length + 2 < text.size(); length += 7)
    EXPECT_FALSE(kept_configs_from(text.substr(0, length)).has_value()) << length;
  std::string other = text;
  other.replace(other.find("\\\"1\\\""), 5, "\\\"7\\\"");  // the version inside the good document
  expect_says(error_of(kept_configs_from(other)), "does not match its hash");
  EXPECT_FALSE(kept_configs_from(R"({"format": 2})").has_value());
}

/// After an update of the agent the last good config is still available.
TEST(KeptConfigs, OfAnEarlierVersionAreRead) {
  json text = json::parse(to_text(some()));
  for (const char* key : {"before", "watched", "ends", "boot"}) text.erase(key);
  text["judged"].erase("document");
  const auto back = kept_configs_from(text.dump());
  ASSERT_TRUE(back.has_value()) << back.error();
  EXPECT_EQ(back->good->document.version, "1");
  EXPECT_FALSE(back->before.has_value());
  EXPECT_FALSE(back->watched);
  EXPECT_EQ(back->judged->text, "");
}

/// The text becomes part of the publicly readable answer.
TEST(KeptConfigs, DamageIsToldInWordsOfOurOwn) {
  const std::string text = to_text(some());
  std::string other_kind = text;
  other_kind.replace(other_kind.find("\"stopped\": true"), 15, "\"stopped\": 1234");
  for (const std::string& damaged :
       {text.substr(0, 100), std::string(), std::string("[]"), other_kind,
        std::string(R"({"format": 1})"), std::string("\xff\xfe")}) {
    const auto kept = kept_configs_from(damaged);
    ASSERT_FALSE(kept.has_value()) << damaged;
    EXPECT_EQ(kept.error().find("json.exception"), std::string::npos) << kept.error();
    EXPECT_EQ(kept.error().find("it "), 0u) << kept.error();
  }
  expect_says(kept_configs_from(text.substr(0, 100)).error(), "byte 101");
}

}  // namespace
}  // namespace fxagent
