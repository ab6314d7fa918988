// What an importer makes of a file of another program: links, devices and tags as they will stand
// in a config, with the lines they come from, and notes of all that could not be carried over.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <tl/expected.hpp>
#include <utility>
#include <vector>

namespace fxagent {

/// A JSON object in the making: its members in their order, each as JSON text.
class JsonObject {
 public:
  void text(std::string_view key, std::string_view value);
  /// A text of others, which stands for itself: `${` in it begins no variable.
  void literal(std::string_view key, std::string_view value);
  void integer(std::string_view key, std::int64_t value);
  /// The shortest text that reads back as the same number; null where it is infinite or none, which
  /// a config does not take.
  void number(std::string_view key, double value);
  /// `json` must be JSON.
  void raw(std::string_view key, std::string json);
  bool has(std::string_view key) const;
  void erase(std::string_view key);
  /// The member's JSON text; empty where there is none.
  std::string_view json_of(std::string_view key) const;
  bool empty() const { return members_.empty(); }
  std::string dump() const;

 private:
  std::vector<std::pair<std::string, std::string>> members_;
};

/// Something of the file that is not, or not wholly, in the config.
struct ImportNote {
  int line = 0;  ///< 1-based; 0: of the file as a whole
  std::string text;
};

struct ImportedTag {
  int line = 0;
  JsonObject keys;
  bool is_changed = false;  ///< a note says what of it is not as it was
};

/// Takes over what the file says of the tag in words; nothing where that is empty.
void describe(ImportedTag& tag, std::string_view text);

struct ImportedDevice {
  std::string name;
  JsonObject keys;  ///< without groups and tags
  std::vector<JsonObject> groups{};
  std::vector<ImportedTag> tags{};
  bool may_be_empty = false;  ///< it stays in the config without a tag, too
};

struct Imported {
  /// Members of the config beside links and devices; where one is missing a placeholder stands.
  JsonObject sections;
  std::vector<JsonObject> links;
  std::vector<ImportedDevice> devices;
  std::vector<ImportNote> notes;
  std::size_t left_out = 0;  ///< tags of the file that are not among the devices'

  void note(int line, std::string text) { notes.push_back({line, std::move(text)}); }
  /// One tag of the file that is not carried over, and why.
  void leave_out(int line, const std::string& why) {
    note(line, "left out: " + why);
    ++left_out;
  }
};

/// What the caller says of things that the file does not.
struct ImportOptions {
  std::string device;    ///< name of the device, where the file names none
  std::string protocol;  ///< empty: by the addresses
  std::string model;     ///< empty: auto
  std::string port;      ///< "/dev/ttyUSB0" or "host:port"; empty: a placeholder
};

/// The file is not of this format at all.
struct ImportFault {
  int line = 0;
  std::string text;
};
using ImportResult = tl::expected<Imported, ImportFault>;

/// Names for a config out of those of others: lower case, "_" for what a name cannot have, and each
/// one once.
class NameMaker {
 public:
  /// `fallback` where nothing of `wanted` can stand in a name, which `notes` says, as it says where
  /// letters are lost or a number was added.
  std::string make(std::string_view wanted, std::string_view fallback, int line,
                   std::vector<ImportNote>& notes);

 private:
  std::set<std::string, std::less<>> taken_;
  std::map<std::string, int, std::less<>> next_;  ///< the number that is tried next
};

/// The groups of one device, one for each interval.
class IntervalGroups {
 public:
  explicit IntervalGroups(ImportedDevice& device) : device_(device) {}
  /// Name of the group with that poll interval, which is within what a group may have.
  std::string at(std::int64_t interval_ms);
  /// Every group made from here on publishes changes only, and all values after at most `silent`
  /// seconds; nullopt: after what a config has where it names none.
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

/// Links by what they connect to: one serial port or one host and port is one link.
class LinkTable {
 public:
  explicit LinkTable(Imported& imported) : imported_(imported) {}
  /// Name of the link to "/dev/ttyUSB0" or to "host:port". `settings` are members for its `serial`.
  std::string to(const std::string& port, const JsonObject& settings = {});
  /// Whether `port` is a serial one; nullopt: neither is it host and port.
  static std::optional<bool> is_serial(std::string_view port);

 private:
  Imported& imported_;
  std::map<std::string, std::string, std::less<>> names_;
};

/// "hr:100" from the first digit that Modbus addresses have by custom (0 1 3 4) and the number
/// counted from 0; empty where there is no such table or number.
std::string modbus_address(char table, std::int64_t number);

/// "D700.C" for "D0700.12": a bit of a word as others count it, from 0 to 15, is a hexadecimal
/// digit here. Anything else is as it was.
std::string melsec_bit_address(std::string_view text);

/// "192.0.2.1:502" for a protocol that runs over TCP only, else "/dev/ttyUSB0".
std::string placeholder_port(std::string_view protocol);

struct ImportOutcome {
  std::string config;  ///< passes check; empty where nothing could be carried over
  std::size_t tags = 0;
  std::size_t changed = 0;  ///< of these
  std::size_t left_out = 0;
  std::vector<ImportNote> notes;  ///< in the order of the file
};

/// Makes the config. Tags that the config does not take are left out, with a note; a device that
/// has none then, too. So are settings of a serial line, times and, with any other key that is
/// wrong, devices, but not where `sections` came with them: that was a whole config.
ImportOutcome finish(Imported imported);

}  // namespace fxagent
