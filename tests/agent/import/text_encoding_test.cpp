#include "agent/import/formats.h"

#include <gtest/gtest.h>

#include "tests/support/says.h"

namespace fxagent {
namespace {

using std::string_literals::operator""s;

std::string utf8(const std::string& bytes, const char* legacy = "CP932") {
  const auto text = to_utf8(bytes, legacy);
  EXPECT_TRUE(text) << (text ? "" : text.error());
  return text.value_or("");
}

TEST(TextEncoding, Utf8StaysAndLosesItsMark) {
  EXPECT_EQ(utf8("a°C"), "a°C");
  EXPECT_EQ(utf8("\xEF\xBB\xBF"
                 "a"),
            "a");
  EXPECT_EQ(utf8(""), "");
}

TEST(TextEncoding, Utf16WithAndWithoutAMark) {
  EXPECT_EQ(utf8("\xFF\xFEX\0001\000\xB0\000"s), "X1°");
  EXPECT_EQ(utf8("\xFE\xFF\000X\0001"s), "X1");
  EXPECT_EQ(utf8("X\0001\000\t\000A\000"s), "X1\tA");
  EXPECT_EQ(utf8("\000X\0001\000\t\000A"s), "X1\tA");
  EXPECT_EQ(utf8("\xFF\xFE\x29\x6E\xA6\x5E"s), "温度");
}

TEST(TextEncoding, ShiftJisAndLatin) {
  EXPECT_EQ(utf8("\x89\xB7\x93\x78"), "温度");
  EXPECT_EQ(utf8("\xB0"
                 "C",
                 "WINDOWS-1252"),
            "°C");
}

TEST(TextEncoding, AMarkIsNoTextInALegacyEncoding) {
  EXPECT_EQ(utf8("\xEF\xBB\xBF"
                 "20 \xB0"
                 "C",
                 "WINDOWS-1252"),
            "20 °C");
}

TEST(TextEncoding, OnlyUnicodeIsCertain) {
  EXPECT_TRUE(is_unicode("\xC3\x96l"));
  EXPECT_TRUE(is_unicode("X\0001\000\t\000A\000"s));
  EXPECT_FALSE(is_unicode("\xD6l Druck"));
}

TEST(TextEncoding, WhatIsNoneOfThemIsTold) {
  test::expect_says(test::error_of(to_utf8("\xFF\xFE\x29"s, "CP932")), "UTF-16LE");
  const auto noise = to_utf8("\x81\xFF\xFF", "CP932");
  ASSERT_FALSE(noise);
  test::expect_says(test::error_of(to_utf8("\xB0", "NO-SUCH-SET")), "convert the file to UTF-8");
}

}  // namespace
}  // namespace fxagent
