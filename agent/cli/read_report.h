// What `fxagent read` shows of tags and addresses: names, values, units, labels, word orders.
#pragma once

#include <chrono>
#include <optional>
#include <span>
#include <string>

#include "agent/config/config.h"

namespace fxagent {

/// What became of one tag or address.
struct ReadReport {
  std::string name;     ///< as it was asked for
  std::string address;  ///< empty: it could not be told
  std::shared_ptr<const TagUnits> units = no_units();
  std::optional<Point> point{};  ///< of `image`; nullopt: its words have no order to compare
  Bytes image{};
  std::optional<Value> value{};
  std::string reason{};  ///< where there is no value
  std::string detail{};
};

/// Whether values of the point change with the word order: numbers of two or four words.
bool has_word_order(const Point& point);

/// Returns "23.4 °C", "3 (run)" or "[1, 2] A".
std::string value_text(const Value& value, const TagUnits& units);

/// Returns the hint that another word order makes a plain number of the value; empty: none.
std::string hint_of(const ReadReport& report);

enum class ShowOrders : std::uint8_t { no, yes };
/// Returns a line for each report, then the hints. With `orders` the values of each word order
/// stand side by side, and the configured one has a `*`.
std::string read_table(std::span<const ReadReport> reports, ShowOrders orders);

/// Returns one JSON object. "ok" is true where every report has a value.
std::string read_json(const std::string& device, std::span<const ReadReport> reports,
                      ShowOrders orders, double ms);

}  // namespace fxagent
