#include "agent/pair/pair_messages.h"

#include <gtest/gtest.h>

#include <chrono>

namespace fxagent {
namespace {

using namespace std::chrono_literals;
namespace messages = pair_messages;

TEST(PairMessages, AnnouncementKeepsWhatTheOtherGatewayMustAnswer) {
  messages::Announcement sent{.boot = "9f3c21aa"};
  sent.entry.device = "press1";
  sent.entry.id = "order \"7\"";
  sent.entry.op = "write";
  sent.entry.received_ms = 1790000000000;
  sent.entry.deadline_ms = 1790000030000;
  sent.entry.response_topic = "fx/p/press1/result/me";
  sent.entry.correlation = {0x00, 0xFF};
  const auto heard = messages::announcement_from(messages::announcement(sent));
  ASSERT_TRUE(heard);
  EXPECT_EQ(heard->boot, sent.boot);
  EXPECT_EQ(heard->mark, 0U);
  EXPECT_EQ(heard->entry.device, sent.entry.device);
  EXPECT_EQ(heard->entry.id, sent.entry.id);
  EXPECT_EQ(heard->entry.op, sent.entry.op);
  EXPECT_EQ(heard->entry.received_ms, sent.entry.received_ms);
  EXPECT_EQ(heard->entry.deadline_ms, sent.entry.deadline_ms);
  EXPECT_EQ(heard->entry.response_topic, sent.entry.response_topic);
  EXPECT_EQ(heard->entry.correlation, sent.entry.correlation);
}

TEST(PairMessages, CommandThatWasLeftKeepsWhatItsResultNeeds) {
  messages::Announcement sent{.boot = "b", .unanswered = true, .id_is_number = true};
  sent.entry.device = "press1";
  sent.entry.id = "7";
  sent.entry.surely_not_sent = sent.entry.refused = true;
  sent.entry.result = R"({"id":7,"status":"REJECTED"})";
  const auto heard = messages::announcement_from(messages::announcement(sent));
  ASSERT_TRUE(heard);
  EXPECT_TRUE(heard->unanswered);
  EXPECT_TRUE(heard->entry.surely_not_sent);
  EXPECT_TRUE(heard->entry.refused);
  EXPECT_EQ(heard->entry.result, sent.entry.result);
  EXPECT_EQ(heard->entry.payload, R"({"id":7})");
}

TEST(PairMessages, MarkHasNoEntry) {
  const auto heard = messages::announcement_from(messages::announcement({"b", 7}));
  ASSERT_TRUE(heard);
  EXPECT_EQ(heard->mark, 7U);
}

TEST(PairMessages, ForeignTextsAreNothing) {
  for (const char* text : {"", "{", "[]", "7", "{}", R"({"boot":7})", R"({"boot":"a b"})",
                           R"({"boot":"x","device":"UPPER","id":"1"})",
                           R"({"boot":"x","device":"press1","id":")"  // longer than an id may be
                           "0123456789012345678901234567890123456789012345678901234567890123456789"
                           R"("})"}) {
    EXPECT_FALSE(messages::announcement_from(text)) << text;
    EXPECT_FALSE(messages::status_from(text)) << text;
    EXPECT_FALSE(messages::result_from(text)) << text;
  }
  EXPECT_FALSE(messages::heartbeat_from(R"({"boot":"a b"})"));
  EXPECT_EQ(messages::heartbeat_from(R"({"boot":"x","seq":-5})")->seq, 0U);
  EXPECT_LE(messages::heartbeat_from(R"({"boot":"x","seq":18446744073709551615})")->seq,
            std::uint64_t{1} << 52);
}

TEST(PairMessages, StatusOfAGatewayThatHasEndedIsOffline) {
  const auto heard = messages::status_from(
      messages::status({.member = "a", .boot = "b1", .role = "offline", .quiet = 2s}));
  ASSERT_TRUE(heard);
  EXPECT_EQ(heard->quiet, 2s);
  EXPECT_EQ(heard->member, "a");
  EXPECT_EQ(heard->boot, "b1");
  EXPECT_EQ(heard->role, "offline");
  EXPECT_FALSE(heard->is_third);
  PairStatus third{.member = "a", .boot = "b1", .role = "standby"};
  third.is_third = true;
  EXPECT_TRUE(messages::status_from(messages::status(third))->is_third);
  EXPECT_EQ(messages::status_from(messages::status(third))->quiet, 0s);
  EXPECT_EQ(messages::status_from(
                R"({"member":"a","boot":"x","role":"active","quiet_ms":9000000000000000})")
                ->quiet,
            60s);
}

TEST(PairMessages, IdOfAResultMayBeANumber) {
  EXPECT_EQ(messages::result_from(R"({"id":"x7","op":"write","status":"SUCCEEDED"})")->id, "x7");
  EXPECT_EQ(messages::result_from(R"({"id":7,"op":"write","status":"FAILED"})")->id, "7");
  EXPECT_FALSE(messages::result_from(R"({"id":null,"status":"REJECTED"})"));
}

TEST(PairMessages, OnlyTopicsOfThePairHaveAPlace) {
  const std::string base = "fx/p/edge7";
  EXPECT_EQ(messages::place_of(base + "/pair/a", base)->member, "a");
  EXPECT_EQ(messages::place_of(base + "/pair/a/heartbeat", base)->leaf, "heartbeat");
  EXPECT_EQ(messages::place_of(base + "/pair/a/journal", base)->leaf, "journal");
  for (const char* other : {"/pair", "/pair/", "/pair/a/", "/pair/a/b", "/pair/A", "x/pair/a"})
    EXPECT_FALSE(messages::place_of(base + other, base)) << other;
  EXPECT_FALSE(messages::place_of("other/pair/a", base));
}

}  // namespace
}  // namespace fxagent
