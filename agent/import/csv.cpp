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
  explicit RowReader(char delimiter) {
    // Quotes must enclose a whole cell. Nothing between unquoted delimiters reads as nullopt.
    csv_init(&parser_, CSV_STRICT | CSV_STRICT_FINI | CSV_EMPTY_IS_NULL);
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

}  // namespace

std::string_view CsvRow::at(std::size_t column) const {
  return column < cells.size() && cells[column] ? trimmed(*cells[column]) : std::string_view();
}

tl::expected<std::vector<CsvRow>, ImportFault> read_csv(std::string_view text, char delimiter) {
  RowReader reader(delimiter);
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

char csv_delimiter(std::string_view text) {
  constexpr std::size_t kMostLines = 200;
  struct Count {
    char delimiter;
    std::size_t lines = 0;
    std::size_t cells = 0;
    std::size_t in_line = 0;
  };
  std::array<Count, 3> counts{{{','}, {'\t'}, {';'}}};
  bool in_quotes = false;
  bool begins_cell = true;
  std::size_t closed = text.npos;  // position of the last closing quote
  std::size_t lines = 0;
  for (std::size_t i = 0; i < text.size() && lines < kMostLines; ++i) {
    const char c = text[i];
    // A doubled quote in a quoted cell closes and reopens it.
    if (c == '"' && (in_quotes || begins_cell || closed + 1 == i)) {
      if (in_quotes) closed = i;
      in_quotes = !in_quotes;
    }
    if (in_quotes) continue;
    const auto count = std::ranges::find(counts, c, &Count::delimiter);
    if (count != counts.end()) ++count->in_line;
    begins_cell = count != counts.end() || c == '\n' || (begins_cell && c == ' ');
    if (c != '\n' && i + 1 < text.size()) continue;
    ++lines;
    for (Count& each : counts) {
      each.lines += each.in_line > 0 ? 1 : 0;
      each.cells += std::exchange(each.in_line, 0);
    }
  }
  // The header contains only the real delimiter, so that delimiter occurs in more lines than a
  // character that only comments contain.
  return std::ranges::max(counts, {},
                          [](const Count& each) { return std::pair(each.lines, each.cells); })
      .delimiter;
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
