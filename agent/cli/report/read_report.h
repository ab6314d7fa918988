// Output of `fxagent read`: names, values, units, labels, word orders.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>

#include "agent/config/model.h"
#include "protocol/value/point.h"
#include "protocol/value/value.h"
#include "protocol/value/word_order.h"

namespace fxagent {

/// Outcome for one tag or address.
struct ReadReport {
  std::string name;     ///< as given by the user
  std::string address;  ///< empty: unknown
  std::shared_ptr<const TagUnits> units = no_units();
  std::optional<Point> point{};  ///< interprets `image`; nullopt: the words have no order to
                                 ///< compare
  std::span<const ByteOrder> orders = kByteOrders;  ///< that word_order may name
  Bytes image{};
  std::optional<Value> value{};
  std::string reason{};  ///< set if there is no value
  std::string detail{};
};

inline constexpr std::uint32_t kWordBits = 16;

/// True if the values of the point depend on the word order: numbers of two or four words.
bool has_word_order(const Point& point);

/// Returns the value of the point in another order. `image` begins at its first bit.
Result<Value> in_order(Point point, ByteView image, ByteOrder order);

/// Returns a text like "23.4 °C", "3 (run)" or "[1, 2] A".
std::string value_text(const Value& value, const TagUnits& units);

/// Returns a hint if another word order gives a plausible number; else empty.
std::string hint_of(const ReadReport& report);

enum class ShowOrders : std::uint8_t { no, yes };
/// Returns a line for each report, then the hints. With `orders`, shows the values in each word
/// order in columns and marks the configured one with `*`.
std::string read_table(std::span<const ReadReport> reports, ShowOrders orders);

/// Returns one JSON object. "ok" is true if every report has a value.
std::string read_json(const std::string& device, std::span<const ReadReport> reports,
                      ShowOrders orders, double ms);

}  // namespace fxagent
