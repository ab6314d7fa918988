// The result of an import, for the tests of all formats.
#pragma once

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <string>
#include <string_view>
#include <vector>

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
inline Made made_of(std::string_view text,
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

/// Counts the notes that contain all the words.
inline int notes_with(const Made& made, const std::vector<std::string>& words) {
  int count = 0;
  for (const std::string& note : made.notes) {
    bool all = true;
    for (const std::string& word : words) all = all && note.find(word) != std::string::npos;
    count += all ? 1 : 0;
  }
  return count;
}

inline std::string all_of(const std::vector<std::string>& notes) {
  std::string text;
  for (const std::string& note : notes) text += note + "\n";
  return text;
}

}  // namespace fxagent::test
