// Converts the tags of a config to CSV and back, for editing in a spreadsheet.
#pragma once

#include <string>
#include <string_view>

namespace fxagent {

/// Writes one row for each tag of `text`, which must be a valid config: the device, then a column
/// for each key. Everything else follows as JSON in rows that start with #, so that
/// import_tag_csv() restores the same config. Tags of templates, and of devices that share a name,
/// stay in those JSON rows.
std::string export_csv(std::string_view text);

}  // namespace fxagent
