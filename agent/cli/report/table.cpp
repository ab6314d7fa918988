#include "agent/cli/report/table.h"

#include <algorithm>

namespace fxagent {

std::string table_text(const std::vector<Row>& rows, std::size_t word_columns) {
  std::string text;
  if (rows.empty()) return text;
  std::vector<std::size_t> widths(rows.front().size());
  for (const Row& row : rows)
    for (std::size_t c = 0; c < row.size(); ++c) widths[c] = std::max(widths[c], row[c].size());
  for (const Row& row : rows) {
    std::string line = " ";
    for (std::size_t c = 0; c < row.size(); ++c) {
      const std::string fill(widths[c] - row[c].size(), ' ');
      line += ' ' + (c < word_columns ? row[c] + fill : fill + row[c]) + ' ';
    }
    text += line.substr(0, line.find_last_not_of(' ') + 1) + '\n';
  }
  return text;
}

}  // namespace fxagent
