// The plant of command_path_test: its config, and the layout of values in the words of its devices.
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

/// Each on a separate line: programming port, computer link, Modbus TCP and Modbus RTU.
inline constexpr int kPathDevices = 4;
/// The first register with min 0.34, max 99.97 and a scale of 0.1: raw values 4 … 999 are allowed.
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

/// A place that a command reads or writes, with its type.
struct Place {
  std::string tag;  ///< empty: addressed directly
  Kind kind = Kind::word;
  unsigned number = 0;
  unsigned count = 0;   ///< elements of an array; 0: not an array
  unsigned length = 0;  ///< characters of a text
};

/// A text of odd length without a tag.
inline const Place kOddText{"", Kind::text, 1510, 0, 5};

/// A word, half a word or a bit, with its value; `mask` selects the relevant bits.
struct Part {
  Deed deed;
  std::uint32_t mask = 0xFFFF;
  friend bool operator==(const Part&, const Part&) = default;
};
/// The elements of an array or the words of a text.
using Elements = std::vector<std::vector<Part>>;

/// The config of the plant, with its writable tags.
std::string plant_of_the_path();
std::vector<Place> places_of(const LedgerDevice& device);
const Place& place_of(const std::vector<Place>& places, std::string_view tag);

/// Prepares the texts before the first write: there are characters after their ends, and the unused
/// halves of words belong to another client.
void prepare(LedgerDevice& device, Fate& fate);

/// Returns the layout of `value` in the device; nullopt if the place can never have it.
std::optional<Elements> elements_of(const Place& place, const nlohmann::json& value,
                                    const LedgerDevice& device);
/// Returns what a sample would show for the place now.
nlohmann::json shown(const Place& place, const LedgerDevice& device);
/// True if each part of the place showed `value` at some time in `when`.
bool was_shown(const Place& place, const nlohmann::json& value, const LedgerDevice& device,
               TimeSpan when);
/// Returns the double with the same decimal notation as the number.
double widened(float number);
/// Converts a Latin-1 character to UTF-8.
std::string utf8(unsigned character);

}  // namespace fxagent::test
