// Suggests what a user may have meant by an invalid word, or by the name of a PLC model. Pure.
#pragma once

#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace fxagent {

struct ProtocolInfo;

/// Returns the names of the items, which must outlive the result.
template <class List>
std::vector<std::string_view> names_in(const List& list) {
  std::vector<std::string_view> names;
  names.reserve(list.size());
  for (const auto& item : list) names.push_back(item.name);
  return names;
}

/// Returns the words that `word` stands for ("rw": "read_write", "E": "even"). Otherwise returns
/// the words that begin with it ("password": "password_file", "password_env"). Otherwise returns
/// the nearest words by edit distance: at most 2, none if more than half of the letters differ.
std::vector<std::string_view> nearest_words(std::string_view word,
                                            std::span<const std::string_view> words);

/// Returns "; did you mean a or b?" to append to an error text; empty if no word is near.
std::string did_you_mean(std::string_view word, std::span<const std::string_view> words);

/// Returns what to append to an error text about an unknown `word`: "; did you mean line1?"; or if
/// no word is near "; there are line1, line2", with at most 8 words. Empty if there are no words.
std::string in_place_of(std::string_view word, std::span<const std::string_view> words);

/// Returns the words with `separator` between them.
std::string joined(std::span<const std::string_view> words, std::string_view separator);

/// Returns "a, b or c".
std::string one_of(std::span<const std::string_view> words);

/// Returns advice about a config key that `section` does not have, to append to the error text:
/// where it belongs, or what it is called. Empty if there is none. `known` are the valid keys of
/// the section.
std::string cure_of_key(std::string_view key, std::string_view section,
                        std::span<const std::string_view> known);

/// Returns the model of the catalogue that a name means, ignoring case: FX3U for "fx3u-32MT", Q for
/// "Q03UDE". Empty if the name matches none.
std::string_view model_meant(std::string_view said);

/// Returns the error text for a model that `own` does not support; it names the protocols that do.
std::string model_is_not_reached(const ProtocolInfo& own, std::string_view model);

}  // namespace fxagent
