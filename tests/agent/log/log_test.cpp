#include "agent/log/log.h"

#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <chrono>
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
  // U+009B starts a terminal command, as ESC [ does.
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
  // Never splits a character.
  EXPECT_EQ(log::excerpt(std::string(127, 'x') + "°°"), std::string(127, 'x') + "… (131 bytes)");
  EXPECT_EQ(log::excerpt(std::string(200, '\x80')).substr(0, 125), std::string(125, '\x80'));
}

TEST(Log, NoValueMakesALineOfAnyLength) {
  const std::string line = log::format_line("x", {{"v", std::string(1 << 20, 'y')}});
  EXPECT_LT(line.size(), 1100U);
  EXPECT_TRUE(line.ends_with("… (1048576 bytes)\"")) << line.substr(1000);
}

// The suffix DeathTest is gtest's convention for tests of a process that ends.
TEST(LogDeathTest, LinesBeforeATerminateAreWritten) {
  const auto end = [] {
    const log::InBackground background;
    for (int i = 0; i < 100; ++i) log::error("last_words", {{"n", std::to_string(i)}});
    std::terminate();
  };
  EXPECT_DEATH(end(), "error last_words n=99");
}

/// Runs `what` in a child that then ends with status 7, for tests of its stderr.
template <class What>
void in_background_and_end(What what) {
  {
    const log::InBackground background;
    what();
  }
  std::_Exit(7);
}

TEST(LogDeathTest, EqualLinesAreCountedAndTheCountIsToldAtTheEnd) {
  const auto end = [] {
    in_background_and_end([] {
      for (int i = 0; i < 100; ++i) log::warn("link", {{"state", "down"}});
    });
  };
  EXPECT_EXIT(end(), ::testing::ExitedWithCode(7),
              "warning repeated count=95 line=\"link state=down\"");
}

TEST(LogDeathTest, LinesInJsonAreObjectsWithEscapedStrings) {
  const auto end = [] {
    log::set_format(log::Format::json);
    in_background_and_end([] {
      log::warn("link", {{"link", "line1"}, {"reason", "a \"b\"\nc \xFF \xC2\xB0"}});
      log::say(log::Level::error, "config", "agent.json:3: \"x\"");
    });
  };
  EXPECT_EXIT(end(), ::testing::ExitedWithCode(7),
              R"re(^\{"ts":"20[0-9-]+T[0-9:.]+Z","level":"warning","event":"link","fields":)re"
              R"re(\{"link":"line1","reason":"a \\"b\\"\\nc � °"\}\}
\{"ts":"[^"]+","level":"error","event":"config","fields":\{"note":"agent.json:3: \\"x\\""\}\}
$)re");
}

TEST(LogDeathTest, EqualLinesInJsonAreCountedInJson) {
  const auto end = [] {
    log::set_format(log::Format::json);
    in_background_and_end([] {
      for (int i = 0; i < 7; ++i) log::info("link", {{"state", "up"}});
    });
  };
  EXPECT_EXIT(end(), ::testing::ExitedWithCode(7),
              R"re("event":"repeated","fields":\{"count":"2","line":)re"
              R"re(\{"event":"link","fields":\{"state":"up"\}\}\}\})re");
}

TEST(LogDeathTest, InTheJournalEachLineHasItsPriorityAndElsewhereNone) {
  const auto end = [](bool is_journal) {
    struct stat file {};
    ::fstat(STDERR_FILENO, &file);
    const std::string inode = std::to_string(file.st_ino + (is_journal ? 0 : 1));
    ::setenv("JOURNAL_STREAM", (std::to_string(file.st_dev) + ":" + inode).c_str(), 1);
    log::set_level(log::Level::debug);
    in_background_and_end([] {
      log::debug("a");
      log::info("b");
      log::warn("c");
      log::error("d");
      log::say(log::Level::error, "e", "cannot begin");
      log::trace(std::chrono::system_clock::time_point(), 10, [] {
        return log::body("f", {{"x", "1"}});
      });
    });
  };
  EXPECT_EXIT(end(true), ::testing::ExitedWithCode(7),
              "^<7>2.*Z debug a\n<6>2.*Z info b\n<4>2.*Z warning c\n<3>2.*Z error d\n"
              "<3>cannot begin\n<7>1970-01-01T00:00:00.000Z trace f x=1\n$");
  EXPECT_EXIT(end(false), ::testing::ExitedWithCode(7),
              "^2.*Z debug a\n2.*Z info b\n2.*Z warning c\n2.*Z error d\n"
              "cannot begin\n1970-01-01T00:00:00.000Z trace f x=1\n$");
}

TEST(LogDeathTest, WhatIsBelowTheLevelIsNotWrittenAndTracesAre) {
  const auto end = [] {
    log::set_level(log::Level::error);
    in_background_and_end([] {
      log::warn("no");
      for (int i = 0; i < 20; ++i)
        log::trace(std::chrono::system_clock::now(), 10, [] { return log::body("frame", {}); });
      log::error("yes");
    });
  };
  EXPECT_EXIT(end(), ::testing::ExitedWithCode(7),
              "^([^\n]* trace frame\n){20}[^\n]* error yes\n$");
}

TEST(Log, WordsOfLevelsAndFormats) {
  EXPECT_EQ(log::level_from("warn"), log::Level::warn);
  EXPECT_EQ(log::level_from("loud"), std::nullopt);
  EXPECT_EQ(log::format_from("json"), log::Format::json);
  EXPECT_EQ(log::format_from("xml"), std::nullopt);
}

}  // namespace
}  // namespace fxagent
