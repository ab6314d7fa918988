// The formats that can be imported, one file each.
#pragma once

#include <span>
#include <string_view>

#include "agent/import/imported.h"

namespace fxagent {

struct ImportFormat {
  std::string_view name;     ///< on the command line
  std::string_view meaning;  ///< one line for --help
  const char* legacy;        ///< the encoding of files that are not Unicode, by its name in iconv
  /// Whether the text, which is UTF-8, is surely of this format.
  bool (*is_it)(std::string_view text);
  ImportResult (*read)(std::string_view text, const ImportOptions& options);
};

/// gx · kepware · neuron · thingsboard · telegraf · csv
std::span<const ImportFormat> import_formats();

// Each reads a text of UTF-8 and never throws.

/// Device comments of GX Developer, GX Works2 and GX Works3, with commas or tabs: a tag for each
/// device that has a comment.
bool is_gx_comments(std::string_view text);
ImportResult import_gx_comments(std::string_view text, const ImportOptions& options);

/// Tags of one device of KEPServerEX or another server by Kepware.
bool is_kepware(std::string_view text);
ImportResult import_kepware(std::string_view text, const ImportOptions& options);

/// JSON of Neuron: nodes with their groups and tags, or one template; or its sheet of tags as CSV.
bool is_neuron(std::string_view text);
ImportResult import_neuron(std::string_view text, const ImportOptions& options);

/// modbus.json of the ThingsBoard gateway: `master`, or what a page of its exports around that.
bool is_thingsboard(std::string_view text);
ImportResult import_thingsboard(std::string_view text, const ImportOptions& options);

/// Telegraf's TOML: `inputs.modbus`, in both styles.
bool is_telegraf(std::string_view text);
ImportResult import_telegraf(std::string_view text, const ImportOptions& options);

/// What export_csv() writes, or tags alone.
bool is_tag_csv(std::string_view text);
ImportResult import_tag_csv(std::string_view text, const ImportOptions& options);

}  // namespace fxagent
