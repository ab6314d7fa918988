#include "agent/log/log.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <exception>

namespace fxagent {
namespace {

TEST(Log, LineIsTheEventAndItsKeysAndValues) {
  EXPECT_EQ(log::format_line("link", {{"link", "line1"}, {"reason", "no such device"}}),
            "link link=line1 reason=\"no such device\"");
  EXPECT_EQ(log::format_line("started", {}), "started");
}

TEST(Log, NoValueCanBreakTheLineOrForgeAKey) {
  EXPECT_EQ(log::format_line("x", {{"v", "a\nb\"c\\ \x1b"}}), "x v=\"a\\x0ab\\\"c\\\\ \\x1b\"");
  EXPECT_EQ(log::format_line("x", {{"v", "a=b"}}), "x v=\"a=b\"");
  EXPECT_EQ(log::format_line("x", {{"v", ""}}), "x v=\"\"");
}

TEST(Log, WhatIsNoUtf8IsEscapedAndWhatIsStays) {
  EXPECT_EQ(log::format_line("x", {{"v", "öl·°C"}}), "x v=öl·°C");
  EXPECT_EQ(log::format_line("x", {{"v", "a\xFFz"}}), "x v=\"a\\xffz\"");
  EXPECT_EQ(log::format_line("x", {{"v", "\xC3"}}), "x v=\"\\xc3\"");
  EXPECT_EQ(log::format_line("x", {{"v", "\xED\xA0\x80"}}), "x v=\"\\xed\\xa0\\x80\"");
  // U+009B begins a command to a terminal as ESC [ does.
  EXPECT_EQ(log::format_line("x", {{"v",
                                    "\xC2\x9B"
                                    "31m"}}),
            "x v=\"\\xc2\\x9b31m\"");
  EXPECT_EQ(log::format_line("x", {{"v", "\xC2\xA0"}}), "x v=\xC2\xA0");
}

TEST(Log, ForeignTextIsCutAndItsLengthTold) {
  EXPECT_EQ(log::excerpt("short"), "short");
  EXPECT_EQ(log::excerpt(std::string(128, 'x')), std::string(128, 'x'));
  EXPECT_EQ(log::excerpt(std::string(65536, 'x')), std::string(128, 'x') + "… (65536 bytes)");
  // No character is cut in two.
  EXPECT_EQ(log::excerpt(std::string(127, 'x') + "°°"), std::string(127, 'x') + "… (131 bytes)");
  EXPECT_EQ(log::excerpt(std::string(200, '\x80')).substr(0, 125), std::string(125, '\x80'));
}

TEST(Log, NoValueMakesALineOfAnyLength) {
  const std::string line = log::format_line("x", {{"v", std::string(1 << 20, 'y')}});
  EXPECT_LT(line.size(), 1100U);
  EXPECT_TRUE(line.ends_with("… (1048576 bytes)\"")) << line.substr(1000);
}

// gtest's name for tests of a process that ends.
TEST(LogDeathTest, LinesBeforeATerminateAreWritten) {
  const auto end = [] {
    const log::InBackground background;
    for (int i = 0; i < 100; ++i) log::error("last_words", {{"n", std::to_string(i)}});
    std::terminate();
  };
  EXPECT_DEATH(end(), "error last_words n=99");
}

TEST(LogDeathTest, EqualLinesAreCountedAndTheCountIsToldAtTheEnd) {
  const auto end = [] {
    {
      const log::InBackground background;
      for (int i = 0; i < 100; ++i) log::warn("link", {{"state", "down"}});
    }
    std::_Exit(7);
  };
  EXPECT_EXIT(end(), ::testing::ExitedWithCode(7),
              "warning repeated count=95 line=\"link state=down\"");
}

}  // namespace
}  // namespace fxagent
