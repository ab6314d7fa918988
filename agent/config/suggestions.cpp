#include "agent/config/suggestions.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <utility>

#include "agent/config/keys.h"
#include "protocol/catalog.h"
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

/// A word of ours, and other words that users write for it. Edit distance alone would suggest a
/// different word, or none.
struct Meaning {
  std::string_view ours;
  std::array<std::string_view, 6> said;

  bool is_said(std::string_view word) const {
    return !word.empty() && std::ranges::any_of(said, [word](std::string_view each) {
      return equal_but_for_case(word, each);
    });
  }
};
constexpr auto kMeanings = std::to_array<Meaning>({
    {"read_write", {"rw", "r/w", "readwrite", "read-write", "write", "w"}},
    {"read", {"ro", "r", "readonly", "read_only"}},
    {"bool", {"bit"}},
    {"uint16", {"word", "ushort"}},
    {"uint32", {"dword", "ulong"}},
    {"int16", {"int", "short"}},
    {"int32", {"long", "dint"}},
    {"int64", {"lint"}},
    {"uint64", {"ulint", "qword", "lword"}},
    {"float64", {"double", "lreal"}},
    {"string", {"text", "char"}},
    {"float32", {"real", "single"}},
    {"3.1.1", {"4"}},
    {"modbus-rtu", {"rtu"}},
    {"modbus-ascii", {"ascii"}},
    {"modbus-tcp", {"tcp"}},
    {"fx-programming-port", {"fx"}},
    {"fx-computer-link", {"fx"}},
    {"mc-1e", {"melsec", "mc"}},
    {"mc-3e", {"slmp", "melsec", "mc"}},
    {"mc-4e", {"slmp"}},
    {"servers", {"host", "port", "broker", "url"}},
    {"interval_ms", {"interval", "poll", "poll_ms", "poll_interval_ms", "period_ms", "scan_ms"}},
    {"baud", {"baudrate", "baud_rate", "speed"}},
    {"path", {"port"}},
    {"host", {"ip"}},
    {"unit", {"slave", "slave_id", "unit_id"}},
    {"station", {"slave"}},
    {"tags", {"tag"}},
    {"address", {"register"}},
});

/// True if `word` is `candidate` in another case, its first letter, or a synonym in kMeanings.
bool means(std::string_view word, std::string_view candidate) {
  if (word.empty() || candidate.empty()) return false;
  const auto is_meant = [&](const Meaning& each) { return each.is_said(word); };
  if (std::ranges::any_of(kMeanings, is_meant))
    return std::ranges::any_of(kMeanings, [&](const Meaning& each) {
      return candidate == each.ours && each.is_said(word);
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

/// Returns the protocols that support the model: "mc-1e over Ethernet, fx-computer-link on a serial
/// line". If `own` does not run on serial lines and other Ethernet protocols support the model,
/// returns only these.
std::string protocols_of(std::string_view model, const ProtocolInfo& own) {
  std::vector<std::string_view> serial;
  std::vector<std::string_view> ethernet;
  for (const ProtocolInfo& info : catalog())
    if (contains(model_key(info).limits.words, model))
      (info.on_serial ? serial : ethernet).push_back(info.name);
  if (ethernet.empty()) return one_of(serial);
  if (!own.on_serial || serial.empty()) return one_of(ethernet);
  return one_of(ethernet) + " over Ethernet, " + one_of(serial) + " on a serial line";
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

std::string in_place_of(std::string_view word, std::span<const std::string_view> words) {
  constexpr std::size_t kMostShown = 8;
  if (words.empty()) return {};
  if (std::string meant = did_you_mean(word, words); !meant.empty()) return meant;
  const auto first = words.first(std::min(kMostShown, words.size()));
  const std::string text =
      (words.size() == 1 ? "; there is " : "; there are ") + joined(first, ", ");
  return words.size() > kMostShown
             ? text + " and " + std::to_string(words.size() - kMostShown) + " more"
             : text;
}

std::string cure_of_key(std::string_view key, std::string_view section,
                        std::span<const std::string_view> known) {
  if (std::ranges::any_of(known, [&](std::string_view each) { return means(key, each); }))
    return did_you_mean(key, known);
  for (const Range range : {Range::near, Range::all})
    if (const std::string home = home_of(key, section, range); !home.empty()) return "; it " + home;
  // The key `unit` of a tag is its engineering unit, not an address on a bus.
  constexpr std::string_view kOfTag = "unit";
  for (const Range range : {Range::near, Range::all})
    for (const Meaning& each : kMeanings)
      if (each.is_said(key) && each.ours != kOfTag)
        if (const std::string home = home_of(each.ours, section, range); !home.empty())
          return "; it is called " + std::string(each.ours) + " and " + home;
  return did_you_mean(key, known);
}

std::string_view model_meant(std::string_view said) {
  const std::string name = upper(said);
  const bool is_modular = name.size() > 1 && name[1] >= '0' && name[1] <= '9';
  if (is_modular && name[0] == 'Q') return "Q";
  if (is_modular && name[0] == 'L') return "L";
  if (is_modular && name[0] == 'R') return "iQ-R";
  std::string_view meant;
  for (const ProtocolInfo& info : catalog())
    for (const auto* names : {&info.models, &info.kin})
      for (const std::string_view model : *names) {
        const bool is_it = name == upper(model) || name.starts_with(std::string(model) + "-");
        if (is_it) meant = model;
      }
  return meant;
}

std::string model_is_not_reached(const ProtocolInfo& own, std::string_view model) {
  std::string text = std::string(own.name) + " does not reach " + (model == "Q" ? "a " : "an ") +
                     std::string(model) + "; use " + protocols_of(model, own);
  if (model.starts_with("FX5"))
    text += ", or modbus-tcp or modbus-rtu without \"model\" if its parameters enable that";
  return text;
}

}  // namespace fxagent
