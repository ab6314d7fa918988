// Expectations about texts and errors.
#pragma once

#include <gtest/gtest.h>

#include <source_location>

namespace fxagent::test {

/// Expects that `part` occurs in `text`.
inline void expect_says(std::string_view text, std::string_view part,
                        std::source_location at = std::source_location::current()) {
  const testing::ScopedTrace caller(at.file_name(), static_cast<int>(at.line()), "expected here");
  EXPECT_NE(text.find(part), std::string_view::npos) << "no \"" << part << "\" in: " << text;
}

/// Returns the error of a call that must fail; an empty one, and a failure, if it did not.
template <class Outcome>
typename Outcome::error_type error_of(const Outcome& outcome,
                                      std::source_location at = std::source_location::current()) {
  if (!outcome) return outcome.error();
  ADD_FAILURE_AT(at.file_name(), static_cast<int>(at.line())) << "an error was expected";
  return {};
}

}  // namespace fxagent::test
