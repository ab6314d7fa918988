#include "agent/text/text.h"

#include <gtest/gtest.h>

#include "agent/text/json.h"

namespace fxagent {
namespace {

// RFC 3629, section 4.
TEST(Text, Utf8IsWhatTheStandardSays) {
  for (const char* good : {"", "a", "\x7F", "\xC2\x80", "\xDF\xBF", "\xE0\xA0\x80", "\xED\x9F\xBF",
                           "\xEE\x80\x80", "\xEF\xBF\xBF", "\xF0\x90\x80\x80", "\xF4\x8F\xBF\xBF"})
    EXPECT_TRUE(is_utf8(good)) << good;
  for (const char* bad : {"\x80", "\xBF", "\xC0\x80", "\xC1\xBF", "\xC2", "\xC3(", "\xE0\x9F\xBF",
                          "\xE1\x80", "\xED\xA0\x80", "\xED\xBF\xBF", "\xF0\x8F\xBF\xBF",
                          "\xF0\x9F\x98", "\xF4\x90\x80\x80", "\xF5\x80\x80\x80", "\xFE", "\xFF"})
    EXPECT_FALSE(is_utf8(bad)) << bad;
}

TEST(Text, EachPlaceEscapesWhatItMust) {
  const std::string text =
      "a\"\\\n\t\x01\x7F\xC2\x9B"
      "°\xF0\x9F\x98\x80\xED\xA0\x80\xFF";
  EXPECT_EQ(escaped(text, Escape::json),
            "a\\\"\\\\\\n\\u0009\\u0001\x7F\xC2\x9B"
            "°\xF0\x9F\x98\x80\xEF\xBF\xBD\xEF\xBF\xBD\xEF\xBF\xBD\xEF\xBF\xBD");
  EXPECT_EQ(
      escaped(text, Escape::terminal),
      "a\\\"\\\\\\n\\t\\u0001\\u007f\\u009b\\u00b0\\ud83d\\ude00\\ufffd\\ufffd\\ufffd\\ufffd");
  EXPECT_EQ(escaped(text, Escape::log),
            "a\\\"\\\\\\x0a\\x09\\x01\\x7f\\xc2\\x9b°\xF0\x9F\x98\x80\\xed\\xa0\\x80\\xff");
  EXPECT_EQ(escaped(text, Escape::message),
            "a\"\\\\x0A\\x09\\x01\\x7F\\xC2\\x9B°\xF0\x9F\x98\x80\\xED\\xA0\\x80\\xFF");
  EXPECT_EQ(escaped(text, Escape::record),
            "a\"\\\n\t\x01\x7F\xC2\x9B"
            "°\xF0\x9F\x98\x80\\xed\\xa0\\x80\\xff");
}

TEST(Text, NumberThatAParserReadsAs0IsFound) {
  for (const char* json : {"0", "-0.0", "0e-400", "[0,0.00]", "5e-324", "1e-300", "1e300", "10",
                           R"("1e-400")", R"({"a\"1e-400":"\\"})", ""})
    EXPECT_EQ(vanishing_number(json), "") << json;
  EXPECT_EQ(vanishing_number("1e-400"), "1e-400");
  EXPECT_EQ(vanishing_number(R"({"1e-500":"\\","b":[7,-2.0E-400]})"), "-2.0E-400");
  EXPECT_EQ(vanishing_number("0." + std::string(400, '0') + "1 ").size(), 403U);
}

TEST(Text, WhatIsTooLongEndsWithDotsBehindAWholeCharacter) {
  EXPECT_EQ(escaped("abc", Escape::message, 3), "abc");
  EXPECT_EQ(escaped("abcd", Escape::message, 3), "abc...");
  EXPECT_EQ(escaped("ab°", Escape::message, 3), "ab...");
  std::string out = "before ";
  append_escaped(out, "abcd", Escape::message, 3);
  EXPECT_EQ(out, "before abc...");
}

TEST(Text, TrimmedLosesWhatSurroundsIt) {
  EXPECT_EQ(trimmed(" \ta b\r\n"), "a b");
  EXPECT_EQ(trimmed("a"), "a");
  EXPECT_EQ(trimmed(" \t\r\n"), "");
  EXPECT_EQ(trimmed(""), "");
}

}  // namespace
}  // namespace fxagent
