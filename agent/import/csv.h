// Rows of CSV text (RFC 4180), read by libcsv. Pure.
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <tl/expected.hpp>
#include <vector>

namespace fxagent {

struct CsvRow {
  int line = 0;  ///< 1-based, of its first cell
  /// nullopt: nothing between the delimiters, not even quotes.
  std::vector<std::optional<std::string>> cells;

  /// Without blanks at both ends; empty beyond the last cell.
  std::string_view at(std::size_t column) const;
};

struct CsvFault {
  int line = 0;
  std::string text;
};

/// Every row that is not blank. `delimiter`: a comma, a semicolon or a tab.
tl::expected<std::vector<CsvRow>, CsvFault> read_csv(std::string_view text, char delimiter);

/// The one of tab, semicolon and comma that most of the first lines have outside of quotes.
char csv_delimiter(std::string_view text);

/// A cell for a row with commas; nullopt: an empty one, "" in quotes for an empty text.
std::string csv_cell(const std::optional<std::string>& value);

/// Which of `names` the columns of a head are, whatever their case and blanks; npos: not there.
std::vector<std::size_t> csv_columns(const CsvRow& head,
                                     const std::vector<std::string_view>& names);

}  // namespace fxagent
