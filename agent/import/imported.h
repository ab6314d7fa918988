// Result of importing another program's file: links, devices and tags as they will appear in a
// config, with their source lines, and notes about everything that could not be converted.
#pragma once

#include <cstddef>
#include <cstdint>
#include <initializer_list>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <tl/expected.hpp>
#include <utility>
#include <vector>

#include "agent/config/json/tree.h"

namespace fxagent {

/// A value of a config, most often an object. Keeps the order of its members.
using JsonObject = nlohmann::ordered_json;

/// Returns foreign text so that a config takes it literally: `${` in it does not start a variable.
std::string literal(std::string_view text);

/// Note about an element of the file that the config does not contain, or not completely.
struct ImportNote {
  int line = 0;  ///< 1-based; 0: the file as a whole
  std::string text;
};

struct ImportedTag {
  int line = 0;
  JsonObject keys;
  bool is_changed = false;  ///< a note says what was changed
};

/// Copies the file's description of the tag, unless it is empty.
void describe(ImportedTag& tag, std::string_view text);

struct ImportedDevice {
  JsonObject keys;  ///< without groups and tags
  std::vector<JsonObject> groups{};
  std::vector<ImportedTag> tags{};
  bool may_be_empty = false;  ///< the config keeps the device even without tags
};

struct Imported {
  /// Members of the config other than links and devices. Missing ones become placeholders.
  JsonObject sections;
  std::vector<JsonObject> links;
  std::vector<ImportedDevice> devices;
  std::vector<ImportNote> notes;
  std::size_t left_out = 0;    ///< tags of the file that no device contains
  bool has_raw_names = false;  ///< finish() makes valid, unique names of the tags' names

  void note(int line, std::string text) { notes.push_back({line, std::move(text)}); }
  /// Records a tag of the file that was not converted, with the reason.
  void leave_out(int line, const std::string& why) {
    note(line, "left out: " + why);
    ++left_out;
  }
};

/// Values from the caller for what the file does not contain.
struct ImportOptions {
  std::string device;    ///< device name if the file has none
  std::string protocol;  ///< empty: derived from the addresses
  std::string model;     ///< empty: auto
  std::string port;      ///< "/dev/ttyUSB0" or "host:port"; empty: a placeholder
};

/// Error: the file is not of this format at all.
struct ImportFault {
  int line = 0;
  std::string text;
};
using ImportResult = tl::expected<Imported, ImportFault>;

// Functions that read JSON files of other programs, with line numbers for the notes. A missing
// value, or one of another type, reads as empty.

/// Parses the whole text. Error: why it is not JSON.
tl::expected<ConfigTree, ImportFault> json_source(std::string_view text);

std::string_view text_at(const ConfigNode& node, std::string_view key);
std::optional<double> number_at(const ConfigNode& node, std::string_view key);
std::optional<std::int64_t> integer_at(const ConfigNode& node, std::string_view key);
/// Returns the members or items of `key`; empty if there is no such key.
const std::vector<ConfigNode>& children_at(const ConfigNode& node, std::string_view key);

/// Notes the keys of an object that are not in `known`, so that none is dropped silently. Skips
/// empty values (null, "", an empty list). `what` names the object.
void note_other_keys(Imported& out, const ConfigTree& tree, const ConfigNode& node,
                     const std::string& what, std::initializer_list<std::string_view> known);

/// Makes valid, unique config names of foreign ones: lower case, "_" for invalid characters.
class NameMaker {
 public:
  /// `name`: every change except capitals is noted. `text`: the tag keeps the text elsewhere, so
  /// only lost letters and added numbers are noted.
  enum class Source : std::uint8_t { name, text };
  explicit NameMaker(Source source = Source::text) : source_(source) {}

  /// Returns `fallback` if no character of `wanted` is valid in a name. Adds a note if a name is
  /// too long or differs from `wanted` as `Source` says.
  std::string make(std::string_view wanted, std::string_view fallback, int line,
                   std::vector<ImportNote>& notes);
  /// Keeps a valid name from use by make(). Returns false if it is already used.
  bool reserve(const std::string& name) { return taken_.insert(name).second; }

 private:
  Source source_;
  std::set<std::string, std::less<>> taken_;
  std::map<std::string, int, std::less<>> next_;  ///< the number to try next
};

/// Groups of one device, one for each poll interval.
class IntervalGroups {
 public:
  explicit IntervalGroups(ImportedDevice& device) : device_(device) {}
  /// Returns the name of the group with that poll interval, which must be in the range of a group.
  std::string at(std::int64_t interval_ms);
  /// Makes all groups created afterwards publish only changes, and all values at least every
  /// `silent` seconds; nullopt: the config's default.
  void publish_on_change(std::optional<std::int64_t> silent) {
    on_change_ = true;
    silent_ = silent;
  }

 private:
  ImportedDevice& device_;
  bool on_change_ = false;
  std::optional<std::int64_t> silent_;
  std::set<std::int64_t> known_;
};

/// Links by target: one serial port, or one host, port and protocol, is one link.
class LinkTable {
 public:
  explicit LinkTable(Imported& imported) : imported_(imported) {}
  /// Returns the name of the link to "/dev/ttyUSB0" or "host:port". `settings` are members for
  /// `serial`. For any other `port` adds a note and returns the link to the placeholder.
  std::string to(const std::string& port, std::string_view protocol, int line = 0,
                 const JsonObject& settings = {});
  /// Returns the link to the placeholder for `protocol`, and adds a note that begins with `why`.
  std::string to_placeholder(std::string_view protocol, int line, const std::string& why = {});
  /// True if `port` is a serial port; nullopt if it is neither that nor host and port.
  static std::optional<bool> is_serial(std::string_view port);

 private:
  Imported& imported_;
  std::map<std::string, std::string, std::less<>> names_;
};

/// Returns a device with the keys that every device has.
ImportedDevice new_device(std::string_view name, std::string_view link, std::string_view protocol);
/// Adds a device from the caller's options to `out`, for a file that has neither link nor protocol.
ImportedDevice& add_device(Imported& out, LinkTable& links, const ImportOptions& options,
                           std::string_view name, std::string_view usual_protocol);

/// Returns an address like "hr:100" for a table (co di ir hr) and a number counted from 0; empty if
/// there is no table or number like that.
std::string modbus_address(std::string_view table, std::int64_t number);
/// True for the two tables of bits.
inline bool is_table_of_bits(std::string_view table) { return table == "co" || table == "di"; }

/// Converts "D0700.12" to "D700.C": other programs count the bits of a word from 0 to 15, a config
/// uses one hexadecimal digit. Returns any other text unchanged.
std::string melsec_bit_address(std::string_view text);

/// Returns "192.0.2.1:502" for a TCP-only protocol, else "/dev/ttyUSB0".
std::string placeholder_port(std::string_view protocol);
/// Returns the note about a link to placeholder_port().
std::string placeholder_note(std::string_view protocol);

struct ImportOutcome {
  /// Passes `check` in a file of its owner alone; empty if nothing could be converted.
  std::string config;
  std::size_t tags = 0;
  std::size_t changed = 0;  ///< number of these tags that were changed
  std::size_t left_out = 0;
  std::vector<ImportNote> notes;  ///< in the order of the file
};

/// Builds the config. Leaves out, with a note, tags that a config does not accept, and devices that
/// then have no tags. Also leaves out invalid serial settings and times, and a device with any
/// other invalid key, unless `sections` is set: then the file was a complete config.
ImportOutcome finish(Imported imported);

}  // namespace fxagent
