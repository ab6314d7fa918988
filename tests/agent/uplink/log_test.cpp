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

}  // namespace
}  // namespace fxagent
