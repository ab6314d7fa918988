// Layout of what a subcommand prints: numbers, columns, and JSON for people.
#pragma once

#include <chrono>
#include <cmath>
#include <cstddef>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

namespace fxagent {

/// Rounds to one decimal.
inline double tenth(double value) { return std::round(value * 10) / 10; }
/// Returns ms, rounded to the resolution that a serial line allows.
inline double rounded_ms(std::chrono::nanoseconds duration) {
  return tenth(std::chrono::duration<double, std::milli>(duration).count());
}

using Row = std::vector<std::string>;

/// Aligns the first `word_columns` columns to the left and the others to the right; by default all
/// to the left. Every row has as many cells as the first.
std::string table_text(const std::vector<Row>& rows, std::size_t word_columns = std::string::npos);

/// Returns the text of `value` with a newline at its end. An object or array that fits into 120
/// characters is on one line.
std::string json_page(const nlohmann::ordered_json& value);

}  // namespace fxagent
