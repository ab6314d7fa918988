// The plant of command_path_test: its config, and how values lie in the words of its devices.
#pragma once

#include <array>
#include <cstdint>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "tests/agent/path/fate.h"
#include "tests/agent/path/ledger_device.h"

namespace fxagent::test {

/// On a line each: programming port, computer link, Modbus TCP and Modbus RTU.
inline constexpr int kPathDevices = 4;
/// The registers with min 0.34, max 99.97 and a scale of 0.1: raw 4 … 999 may be written.
inline constexpr unsigned kFirstLimited = 980;
inline constexpr unsigned kLastLimited = 989;

enum class Kind : std::uint8_t {
  bit,
  word,
  tenths,  ///< a word with a scale of 0.1
  dword,
  real,
  text
};

/// Where a command reads or writes, and as what.
struct Place {
  std::string tag;  ///< empty: by address
  Kind kind = Kind::word;
  unsigned number = 0;
  unsigned count = 0;   ///< elements of an array; 0: it is none
  unsigned length = 0;  ///< characters of a text
};

/// A text of odd length that has no tag.
inline const Place kOddText{"", Kind::text, 1510, 0, 5};

/// A word, a half of one, or a bit, with the value that it has; `mask` says what of it counts.
struct Part {
  Deed deed;
  std::uint32_t mask = 0xFFFF;
  friend bool operator==(const Part&, const Part&) = default;
};
/// Of an array its elements, of a text its words.
using Elements = std::vector<std::vector<Part>>;

/// The config of the plant, and its tags that can be written.
std::string plant_of_the_path();
std::vector<Place> places_of(const LedgerDevice& device);
const Place& place_of(const std::vector<Place>& places, std::string_view tag);

/// Texts before anything is written: behind their ends there is something, and the halves of words
/// that are none of a text's belong to somebody else.
void prepare(LedgerDevice& device, Fate& fate);

/// How `value` lies in the device; nullopt: the place never shows it.
std::optional<Elements> elements_of(const Place& place, const nlohmann::json& value,
                                    const LedgerDevice& device);
/// What a sample would show of the place now.
nlohmann::json shown(const Place& place, const LedgerDevice& device);
/// Whether each part of the place has shown `value` at some time of `when`.
bool was_shown(const Place& place, const nlohmann::json& value, const LedgerDevice& device,
               TimeSpan when);
/// The double that is spelled like the number.
double widened(float number);
/// A character of Latin-1 in UTF-8.
std::string utf8(unsigned character);

}  // namespace fxagent::test
