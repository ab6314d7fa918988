// Formats text in columns, for reports on a terminal.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

namespace fxagent {

using Row = std::vector<std::string>;

/// Aligns the first `word_columns` columns to the left and the others to the right. Every row has
/// as many cells as the first.
std::string table_text(const std::vector<Row>& rows, std::size_t word_columns);

}  // namespace fxagent
