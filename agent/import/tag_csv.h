// The tags of a config as CSV and back, for those who edit them in a spreadsheet.
#pragma once

#include <string>
#include <string_view>

namespace fxagent {

/// A row for each tag of `text`, which must be a right config: its device, then a column for each
/// key. What is not tags follows in rows that begin with a #, as JSON, so that import_tag_csv()
/// makes the same config of it. Tags of templates, and those of entries of one name, stand there.
std::string export_csv(std::string_view text);

}  // namespace fxagent
