// Formats that can be imported, one file each, and the encodings of their files.
#pragma once

#include <array>
#include <span>
#include <string>
#include <string_view>

#include "agent/import/imported.h"

namespace fxagent {

struct ImportFormat {
  std::string_view name;  ///< as given on the command line
  const char* legacy;     ///< iconv name of the encoding of files that are not Unicode
  /// True if the UTF-8 text is certainly of this format.
  bool (*is_it)(std::string_view text);
  ImportResult (*read)(std::string_view text, const ImportOptions& options);
};

// Each import function reads UTF-8 text and never throws.

/// Device comments of GX Developer, GX Works2 and GX Works3, separated by commas or tabs. Each
/// device with a comment becomes a tag.
bool is_gx_comments(std::string_view text);
ImportResult import_gx_comments(std::string_view text, const ImportOptions& options);

/// Tags of one device of KEPServerEX or another Kepware server.
bool is_kepware(std::string_view text);
ImportResult import_kepware(std::string_view text, const ImportOptions& options);

/// Neuron's JSON (nodes with their groups and tags, or one template), or its tag sheet as CSV.
bool is_neuron(std::string_view text);
ImportResult import_neuron(std::string_view text, const ImportOptions& options);

/// modbus.json of the ThingsBoard gateway: `master`, or the wrapper of a web page export around it.
bool is_thingsboard(std::string_view text);
ImportResult import_thingsboard(std::string_view text, const ImportOptions& options);

/// Telegraf's TOML: `inputs.modbus`, in all its styles.
bool is_telegraf(std::string_view text);
ImportResult import_telegraf(std::string_view text, const ImportOptions& options);

/// Writes one row for each tag of `text`, which must be a valid config: the device, then a column
/// for each key. Everything else follows as JSON in rows that start with #, so that
/// import_tag_csv() restores the same config. Tags of templates, and of devices that share a name,
/// stay in those JSON rows.
std::string export_csv(std::string_view text);
/// Output of export_csv(), or tags alone.
bool is_tag_csv(std::string_view text);
ImportResult import_tag_csv(std::string_view text, const ImportOptions& options);

/// True if to_utf8() detects UTF-8 or UTF-16; otherwise it assumes the legacy encoding.
bool is_unicode(std::string_view bytes);
/// Converts `bytes` to UTF-8 without a byte order mark. Detects UTF-8, and UTF-16 by its mark or
/// its zero bytes. Treats anything else as `legacy`, an iconv encoding such as "CP932" (Shift-JIS)
/// or "WINDOWS-1252". The error names the encoding that the bytes violate.
tl::expected<std::string, std::string> to_utf8(std::string_view bytes, const char* legacy);

/// Returns gx · kepware · neuron · thingsboard · telegraf · csv.
inline std::span<const ImportFormat> import_formats() {
  // Formats with an unmistakable header come first: the header word of GX also occurs in cells of
  // other formats.
  static constexpr auto kFormats = std::to_array<ImportFormat>(
      {{"kepware", "WINDOWS-1252", is_kepware, import_kepware},
       {"csv", "WINDOWS-1252", is_tag_csv, import_tag_csv},
       {"gx", "CP932", is_gx_comments, import_gx_comments},
       {"neuron", "WINDOWS-1252", is_neuron, import_neuron},
       {"thingsboard", "WINDOWS-1252", is_thingsboard, import_thingsboard},
       {"telegraf", "WINDOWS-1252", is_telegraf, import_telegraf}});
  return kFormats;
}

}  // namespace fxagent
