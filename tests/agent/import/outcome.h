// The result of an import, for the tests of all formats.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <source_location>
#include <stdexcept>

#include "agent/config/loader.h"
#include "agent/import/formats.h"

namespace fxagent::test {

struct Made {
  nlohmann::json config;           ///< null if nothing could be carried over
  std::vector<std::string> notes;  ///< "3: left out: …"
  std::size_t changed = 0;
  std::size_t left_out = 0;
};

/// Imports a text. The text must be of the format, and the result must pass check.
inline Made outcome_of(std::string_view text,
                       ImportResult (*read)(std::string_view, const ImportOptions&),
                       const ImportOptions& options = {}) {
  auto imported = read(text, options);
  if (!imported) {
    ADD_FAILURE() << imported.error().line << ": " << imported.error().text;
    return {};
  }
  const ImportOutcome outcome = finish(*std::move(imported));
  Made made;
  made.changed = outcome.changed;
  made.left_out = outcome.left_out;
  for (const ImportNote& note : outcome.notes)
    made.notes.push_back(std::to_string(note.line) + ": " + note.text);
  if (outcome.config.empty()) return made;
  const auto config = parse_config(outcome.config);
  if (!config) ADD_FAILURE() << to_string(config.error().front(), "made") << outcome.config;
  made.config = nlohmann::json::parse(outcome.config);
  return made;
}

inline std::string all_of(const std::vector<std::string>& notes) {
  std::string text;
  for (const std::string& note : notes) text += note + "\n";
  return text;
}

/// Imports a text of which something can be carried over; otherwise the test ends here.
inline Made made_of(std::string_view text,
                    ImportResult (*read)(std::string_view, const ImportOptions&),
                    const ImportOptions& options = {}) {
  Made made = outcome_of(text, read, options);
  if (made.config.is_null()) throw std::runtime_error("nothing:\n" + all_of(made.notes));
  return made;
}

/// Expects so many notes that contain all the words.
inline void expect_notes(int count, const Made& made, const std::vector<std::string>& words,
                         std::source_location at = std::source_location::current()) {
  const testing::ScopedTrace caller(at.file_name(), static_cast<int>(at.line()), "expected here");
  const auto has_all = [&](const std::string& note) {
    return std::ranges::all_of(
        words, [&](const std::string& word) { return note.find(word) != std::string::npos; });
  };
  EXPECT_EQ(std::ranges::count_if(made.notes, has_all), count) << all_of(made.notes);
}
inline void expect_note(const Made& made, const std::vector<std::string>& words,
                        std::source_location at = std::source_location::current()) {
  expect_notes(1, made, words, at);
}

}  // namespace fxagent::test
