#include "agent/config/suggestions.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <utility>

#include "agent/config/keys.h"
#include "protocol/letter_case.h"

namespace fxagent {
namespace {

/// Longer words are not misspelled keys. Comparing them would waste time.
constexpr std::size_t kLongestWord = 64;
/// No search for the nearest of more words than this, also to save time.
constexpr std::size_t kMostWords = 1000;

/// Returns the Levenshtein distance.
std::size_t edit_distance(std::string_view a, std::string_view b) {
  std::vector<std::size_t> row(b.size() + 1);
  for (std::size_t j = 0; j <= b.size(); ++j) row[j] = j;
  for (std::size_t i = 0; i < a.size(); ++i) {
    std::size_t diagonal = std::exchange(row[0], i + 1);
    for (std::size_t j = 0; j < b.size(); ++j) {
      const std::size_t replaced = diagonal + (a[i] == b[j] ? 0 : 1);
      diagonal = row[j + 1];
      row[j + 1] = std::min({replaced, row[j + 1] + 1, row[j] + 1});
    }
  }
  return row[b.size()];
}

/// Words that users write, and the word of ours that they mean. Edit distance alone would suggest
/// a different word, or none.
constexpr auto kMeanings = std::to_array<std::pair<std::string_view, std::string_view>>({
    {"rw", "read_write"},
    {"r/w", "read_write"},
    {"readwrite", "read_write"},
    {"read-write", "read_write"},
    {"write", "read_write"},
    {"w", "read_write"},
    {"ro", "read"},
    {"r", "read"},
    {"readonly", "read"},
    {"read_only", "read"},
    {"bit", "bool"},
    {"word", "uint16"},
    {"dword", "uint32"},
    {"int", "int16"},
    {"short", "int16"},
    {"ushort", "uint16"},
    {"long", "int32"},
    {"lint", "int64"},
    {"ulint", "uint64"},
    {"qword", "uint64"},
    {"lword", "uint64"},
    {"double", "float64"},
    {"lreal", "float64"},
    {"ulong", "uint32"},
    {"text", "string"},
    {"char", "string"},
    {"dint", "int32"},
    {"real", "float32"},
    {"single", "float32"},
    {"4", "3.1.1"},
    {"rtu", "modbus-rtu"},
    {"ascii", "modbus-ascii"},
    {"tcp", "modbus-tcp"},
    {"fx", "fx-programming-port"},
    {"fx", "fx-computer-link"},
    {"slmp", "mc-3e"},
    {"slmp", "mc-4e"},
    {"melsec", "mc-1e"},
    {"melsec", "mc-3e"},
    {"mc", "mc-1e"},
    {"mc", "mc-3e"},
    {"host", "servers"},
    {"port", "servers"},
    {"broker", "servers"},
    {"url", "servers"},
    {"interval", "interval_ms"},
    {"poll", "interval_ms"},
    {"poll_ms", "interval_ms"},
    {"poll_interval_ms", "interval_ms"},
    {"period_ms", "interval_ms"},
    {"scan_ms", "interval_ms"},
    {"baudrate", "baud"},
    {"baud_rate", "baud"},
    {"speed", "baud"},
    {"port", "path"},
    {"ip", "host"},
    {"slave", "unit"},
    {"slave", "station"},
    {"slave_id", "unit"},
    {"unit_id", "unit"},
    {"tag", "tags"},
    {"register", "address"},
});

/// True if `word` is `candidate` in another case, its first letter, or a synonym in kMeanings.
bool means(std::string_view word, std::string_view candidate) {
  if (word.empty() || candidate.empty()) return false;
  const bool in_table = std::ranges::any_of(
      kMeanings, [&](const auto& each) { return equal_but_for_case(word, each.first); });
  if (in_table)
    return std::ranges::any_of(kMeanings, [&](const auto& each) {
      return equal_but_for_case(word, each.first) && candidate == each.second;
    });
  if (word.size() == 1) return lower(word[0]) == lower(candidate[0]);
  return equal_but_for_case(word, candidate);
}

/// Returns "devices[]" for "devices[].tags[]".
std::string_view first_level(std::string_view section) {
  return section.substr(0, section.find('.'));
}

enum class Range : std::uint8_t { near, all };

/// Returns where a key belongs that `section` does not have, as an error text. Empty if no section
/// in that range has it, or more than 2 do.
std::string home_of(std::string_view key, std::string_view section, Range range) {
  std::vector<std::string_view> homes;
  for (const ConfigKey& known : config_keys::kWritten) {
    if (known.section == "profiles[]") continue;  // its `broker` and `host` are rarely meant
    const bool is_near = section.empty() || known.section.empty() ||
                         first_level(known.section) == first_level(section);
    if (known.name == key && (is_near || range == Range::all)) homes.push_back(known.section);
  }
  constexpr std::size_t kMost = 2;
  if (homes.empty() || homes.size() > kMost) return {};
  if (homes.front().empty()) return "belongs at the top level";
  std::string text = "belongs inside " + one_of(homes);
  if (section == "devices[].tags[]" && homes.front() == "devices[].groups[]")
    text += ", to the group that the tag names";
  return text;
}

}  // namespace

std::vector<std::string_view> nearest_words(std::string_view word,
                                            std::span<const std::string_view> words) {
  std::vector<std::string_view> nearest;
  for (const auto candidate : words)
    if (means(word, candidate)) nearest.push_back(candidate);
  if (!nearest.empty()) return nearest;
  if (word.size() >= 3)
    for (const auto candidate : words)
      if (candidate.starts_with(word)) nearest.push_back(candidate);
  if (!nearest.empty()) return nearest;
  if (word.size() > kLongestWord || words.size() > kMostWords) return {};
  std::size_t least = 0;
  for (const auto candidate : words) {
    if (candidate.size() > 2 * kLongestWord) continue;
    const std::size_t distance = edit_distance(word, candidate);
    if (distance > std::max(word.size(), candidate.size()) / 2) continue;  // a different word
    if (nearest.empty() || distance < least) {
      least = distance;
      nearest.clear();
    }
    if (distance == least && nearest.size() < 2) nearest.push_back(candidate);
  }
  return nearest;
}

std::string joined(std::span<const std::string_view> words, std::string_view separator) {
  std::string text;
  for (const std::string_view word : words) text.append(text.empty() ? "" : separator).append(word);
  return text;
}

std::string one_of(std::span<const std::string_view> words) {
  std::string text;
  for (std::size_t i = 0; i < words.size(); ++i) {
    if (i > 0) text += i + 1 == words.size() ? " or " : ", ";
    text += words[i];
  }
  return text;
}

std::string did_you_mean(std::string_view word, std::span<const std::string_view> words) {
  const auto nearest = nearest_words(word, words);
  return nearest.empty() ? std::string() : "; did you mean " + one_of(nearest) + "?";
}

std::string cure_of_key(std::string_view key, std::string_view section,
                        std::span<const std::string_view> known) {
  if (std::ranges::any_of(known, [&](std::string_view each) { return means(key, each); }))
    return did_you_mean(key, known);
  if (const std::string home = home_of(key, section, Range::near); !home.empty())
    return "; it " + home;
  if (const std::string home = home_of(key, section, Range::all); !home.empty())
    return "; it " + home;
  // The key `unit` of a tag is its engineering unit, not an address on a bus.
  constexpr std::string_view kOfTag = "unit";
  for (const Range range : {Range::near, Range::all})
    for (const auto& [said, meant] : kMeanings)
      if (equal_but_for_case(key, said) && meant != kOfTag)
        if (const std::string home = home_of(meant, section, range); !home.empty())
          return "; it is called " + std::string(meant) + " and " + home;
  return did_you_mean(key, known);
}

}  // namespace fxagent
