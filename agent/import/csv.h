// Reads and writes rows of CSV text (RFC 4180) with libcsv. Pure.
#pragma once

#include <cstddef>
#include <initializer_list>
#include <optional>
#include <string>
#include <string_view>
#include <tl/expected.hpp>
#include <vector>

#include "agent/import/imported.h"

namespace fxagent {

struct CsvRow {
  int line = 0;  ///< 1-based, of the first cell
  /// nullopt: nothing between the delimiters, not even quotes.
  std::vector<std::optional<std::string>> cells;

  /// Returns a cell without surrounding blanks; empty beyond the last cell, and for npos.
  std::string_view at(std::size_t column) const;
};

/// Returns every row that is not blank. The delimiter is the comma, tab or semicolon that divides
/// the most rows.
tl::expected<std::vector<CsvRow>, ImportFault> read_csv(std::string_view text);

/// Formats a cell for a comma-separated row: empty for nullopt, quotes ("") for an empty text.
std::string csv_cell(const std::optional<std::string>& value);

/// Returns the index of the column in the header row, ignoring case and blanks; npos: not found.
std::size_t csv_column(const CsvRow& head, std::string_view name);
/// True if the first row is a header row with all these columns.
bool has_columns(const std::vector<CsvRow>& rows, std::initializer_list<std::string_view> names);

}  // namespace fxagent
