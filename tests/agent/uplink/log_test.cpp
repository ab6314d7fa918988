#include "agent/log.h"

#include <gtest/gtest.h>

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
  // U+009B begins an order to a terminal as ESC [ does.
  EXPECT_EQ(log::format_line("x", {{"v",
                                    "\xC2\x9B"
                                    "31m"}}),
            "x v=\"\\xc2\\x9b31m\"");
  EXPECT_EQ(log::format_line("x", {{"v", "\xC2\xA0"}}), "x v=\xC2\xA0");
}

}  // namespace
}  // namespace fxagent
