#include "agent/cli/report/layout.h"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "agent/text/json.h"

namespace fxagent {
namespace {

using Json = nlohmann::ordered_json;

std::string written(const Json& value, std::size_t indent) {
  constexpr std::size_t kLine = 120;
  const std::string line = dumped(value);
  if (!value.is_structured() || value.empty() || indent + line.size() <= kLine) return line;
  const std::string pad(indent + 2, ' ');
  std::string out(1, value.is_object() ? '{' : '[');
  for (const auto& [key, part] : value.items()) {
    out += (out.size() > 1 ? ",\n" : "\n") + pad;
    if (value.is_object()) out += dumped(Json(key)) + ": ";
    out += written(part, indent + 2);
  }
  return out + "\n" + std::string(indent, ' ') + (value.is_object() ? "}" : "]");
}

}  // namespace

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

std::string json_page(const Json& value) { return written(value, 0) + "\n"; }

}  // namespace fxagent
