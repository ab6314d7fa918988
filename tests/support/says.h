// Expectations about texts.
#pragma once

#include <gtest/gtest.h>

#include <source_location>
#include <string_view>

namespace fxagent::test {

/// Expects that `part` occurs in `text`.
inline void expect_says(std::string_view text, std::string_view part,
                        std::source_location at = std::source_location::current()) {
  const testing::ScopedTrace caller(at.file_name(), static_cast<int>(at.line()), "expected here");
  EXPECT_NE(text.find(part), std::string_view::npos) << "no \"" << part << "\" in: " << text;
}

}  // namespace fxagent::test
