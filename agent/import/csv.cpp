#include "agent/import/csv.h"

#include <csv.h>

#include <algorithm>
#include <array>
#include <utility>

#include "agent/text/text.h"
#include "protocol/letter_case.h"

namespace fxagent {
namespace {

/// Wraps libcsv's parser and collects the rows.
class RowReader {
 public:
  enum class Quotes : unsigned char { anywhere = 0, around_cells = CSV_STRICT | CSV_STRICT_FINI };

  RowReader(char delimiter, Quotes quotes) {
    // Nothing between unquoted delimiters reads as nullopt.
    csv_init(&parser_, static_cast<unsigned char>(quotes) | CSV_EMPTY_IS_NULL);
    csv_set_delim(&parser_, static_cast<unsigned char>(delimiter));
  }
  RowReader(const RowReader&) = delete;
  RowReader& operator=(const RowReader&) = delete;
  ~RowReader() { csv_free(&parser_); }

  /// Parses one line including its end. Returns false if it is malformed.
  bool take(std::string_view line) {
    ++line_;
    if (row_.cells.empty()) first_line_ = line_;
    return csv_parse(&parser_, line.data(), line.size(), on_cell, on_row, this) == line.size();
  }
  bool end() { return csv_fini(&parser_, on_cell, on_row, this) == 0; }
  int line() const { return line_; }
  std::vector<CsvRow> rows() { return std::move(rows_); }

 private:
  static void on_cell(void* text, std::size_t size, void* self) {
    auto& reader = *static_cast<RowReader*>(self);
    auto& cells = reader.row_.cells;
    if (cells.empty()) reader.row_.line = reader.first_line_;
    if (text == nullptr)
      cells.emplace_back();
    else
      cells.emplace_back(std::string(static_cast<const char*>(text), size));
  }
  static void on_row(int, void* self) {
    auto& reader = *static_cast<RowReader*>(self);
    const bool is_blank = std::ranges::all_of(
        reader.row_.cells, [](const auto& cell) { return !cell || trimmed(*cell).empty(); });
    if (!is_blank) reader.rows_.push_back(std::move(reader.row_));
    reader.row_ = {};
  }

  csv_parser parser_{};
  int line_ = 0;
  int first_line_ = 1;  ///< of the row in progress
  CsvRow row_;
  std::vector<CsvRow> rows_;
};

/// Reads all rows, or the fault that stops it.
tl::expected<std::vector<CsvRow>, ImportFault> rows_of(std::string_view text, char delimiter,
                                                       RowReader::Quotes quotes) {
  RowReader reader(delimiter, quotes);
  while (!text.empty()) {
    const std::size_t end = text.find('\n');
    const std::string_view line = text.substr(0, end == text.npos ? end : end + 1);
    if (!reader.take(line))
      return tl::unexpected(ImportFault{reader.line(), "a quote inside a cell"});
    text.remove_prefix(line.size());
  }
  if (!reader.end())
    return tl::unexpected(ImportFault{reader.line(), "the file ends inside quotes"});
  return reader.rows();
}

/// Returns the number of rows that the delimiter divides, and of their cells.
std::pair<std::size_t, std::size_t> divided(std::string_view text, char delimiter) {
  std::pair<std::size_t, std::size_t> sum;
  const auto rows = rows_of(text, delimiter, RowReader::Quotes::anywhere);
  for (const CsvRow& row : rows.value())
    if (row.cells.size() > 1) sum = {sum.first + 1, sum.second + row.cells.size()};
  return sum;
}

}  // namespace

std::string_view CsvRow::at(std::size_t column) const {
  return column < cells.size() && cells[column] ? trimmed(*cells[column]) : std::string_view();
}

tl::expected<std::vector<CsvRow>, ImportFault> read_csv(std::string_view text) {
  // The header contains only the real delimiter, so that one divides more rows than a character
  // that only comments contain.
  const char delimiter = std::ranges::max(std::array{',', '\t', ';'}, {},
                                          [text](char each) { return divided(text, each); });
  return rows_of(text, delimiter, RowReader::Quotes::around_cells);
}

std::string csv_cell(const std::optional<std::string>& value) {
  if (!value) return {};
  if (!value->empty() && value->find_first_of(",;\t\"\r\n") == std::string::npos &&
      trimmed(*value).size() == value->size())
    return *value;
  std::string out = "\"";
  for (const char c : *value) {
    if (c == '"') out += '"';
    out += c;
  }
  return out + "\"";
}

std::size_t csv_column(const CsvRow& head, std::string_view name) {
  for (std::size_t i = 0; i < head.cells.size(); ++i)
    if (equal_but_for_case(head.at(i), name)) return i;
  return std::string::npos;
}

bool has_columns(const std::vector<CsvRow>& rows, std::initializer_list<std::string_view> names) {
  return !rows.empty() && std::ranges::all_of(names, [&](std::string_view name) {
    return csv_column(rows.front(), name) != std::string::npos;
  });
}

}  // namespace fxagent
