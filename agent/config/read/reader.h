// Reads typed values from a config tree and collects errors and warnings.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <tl/expected.hpp>
#include <vector>

#include "agent/config/json/tree.h"
#include "agent/config/keys.h"
#include "agent/config/model.h"
#include "agent/config/read/config_limits.h"
#include "agent/config/read/findings.h"
#include "agent/config/source.h"

namespace fxagent {

/// True if the text contains `{n}`, which a device's key `n` replaces. After a `$` it is the
/// environment variable `n` instead.
bool has_place_of_n(std::string_view text);
/// Returns `text` with every such `{n}` replaced.
std::string with_n(std::string_view text, std::string_view n);

/// A key of the config, by its path in the table, such as "mqtt.keep_alive_s": an unknown path does
/// not compile. A key that the catalogue makes for a protocol must outlive it.
class KeyRef final {
 public:
  consteval KeyRef(const char* path) : key_(&config_key(path)) {}
  KeyRef(const ConfigKey& key) : key_(&key) {}
  const ConfigKey* operator->() const { return key_; }

 private:
  const ConfigKey* key_;
};

/// Getters return nullopt or nullptr if the key is absent or its value is wrong. They report a
/// wrong value, and an absent key that is required, so that the caller reads on and finds the other
/// errors of the file too. Ranges, words and defaults are those of the ConfigKey. Error texts quote
/// strings as they stand in the file, never with the values of environment variables.
class ConfigReader {
 public:
  /// `tree` must outlive the reader.
  ConfigReader(const ConfigTree& tree, Environment environment, const ReadBounds& bounds = {});

  /// Sets the device that later reads belong to, if it has a template or an `n`; nullptr ends that.
  /// Reads replace `{n}` before `${NAME}`, and errors name both places. `origin` must stay valid
  /// until the next call.
  void set_origin(const DeviceOrigin* origin);

  void error(const ConfigNode& at, std::string text);
  /// Same, with the line of the member's key.
  void error_at_key(const ConfigNode& at, std::string text);
  void warn(const ConfigNode& at, std::string text);

  /// True if the error text at this byte may use did_you_mean(), which compares a word with all
  /// valid ones. Limits a text to 20 calls.
  bool may_suggest(std::uint32_t offset);

  /// Counts the objects that the caller is about to build. If the config becomes too large, reports
  /// an error at `at` and returns false.
  bool has_room(const ConfigNode& at, const ConfigSize& more);
  const ConfigRoom& room() const { return room_; }
  /// True if the caller must stop building: the config is too large, or reading was stopped.
  bool is_over() const { return room_.is_full() || bounds_.is_stopped(); }
  /// Both are in the order of the file.
  ConfigErrors errors() const { return errors_.in_order(tree_); }
  std::vector<std::string> warnings() const;

  /// Returns the string with `{n}` and `${NAME}` replaced. Returns an empty string, without a
  /// report, if the node is not a string or a replacement fails.
  std::string replaced(const ConfigNode& node) const;

  /// Returns "/links/0 (line 12)".
  std::string place_of(const ConfigNode& node) const { return tree_.place_of(node); }

  /// Reports members that are not keys of `section` or among `more`, and duplicate members. Leaves
  /// members named in `left_to_caller` to the caller, which has a better error text. If the table
  /// has no such section, its members are the caller's. If the node is not an object, reports that
  /// and returns false.
  bool check_object(const ConfigNode& node, std::string_view section,
                    std::span<const std::string_view> more = {},
                    std::span<const std::string_view> left_to_caller = {});

  /// Returns the object, whose members it has checked with check_object().
  const ConfigNode* object(const ConfigNode& parent, KeyRef key);
  const ConfigNode* array(const ConfigNode& parent, KeyRef key);
  /// Returns the items of an array that the tree may have folded; empty if the key is absent or
  /// wrong. The caller owns the nodes and must keep them as long as it uses pointers to them.
  std::vector<ConfigNode> items(const ConfigNode& parent, KeyRef key);

  std::optional<std::int64_t> integer(const ConfigNode& parent, KeyRef key);
  /// Sets `field`, a number or a duration in the unit of the key, to the integer, or to the default
  /// if the key is absent or wrong.
  template <class T>
  void set_integer(T& field, const ConfigNode& parent, KeyRef key) {
    field = static_cast<T>(integer(parent, key).value_or(key->number()));
  }
  std::optional<double> number(const ConfigNode& parent, KeyRef key);
  /// Returns the default if the key is absent or wrong.
  bool boolean(const ConfigNode& parent, KeyRef key);
  /// Returns a string with `${NAME}` replaced. An empty string is an error.
  std::optional<std::string> text(const ConfigNode& parent, KeyRef key);
  /// Same for an item of an array.
  std::optional<std::string> text(const ConfigNode& node);
  /// String that error texts must not quote.
  struct Secret {
    std::string value;
    bool in_clear = false;  ///< the file has the secret itself, not just the name of a variable
  };
  std::optional<Secret> secret(const ConfigNode& parent, KeyRef key);
  /// Returns a string of the form that topics and commands use: [a-z0-9_-]{1,64}.
  std::optional<std::string> name(const ConfigNode& parent, KeyRef key);
  /// Returns the index of the string among the key's words.
  std::optional<std::size_t> choice(const ConfigNode& parent, KeyRef key);
  std::size_t choice_or_default(const ConfigNode& parent, KeyRef key) {
    return choice(parent, key).value_or(key->index());
  }

 private:
  const ConfigNode* member(const ConfigNode& parent, KeyRef key);
  void wrong_kind(const ConfigNode& node, std::string_view wanted);
  /// Returns `text` with every `${NAME}` replaced and `$${` turned into `${`, or else an error
  /// text.
  tl::expected<std::string, std::string> expand(std::string_view text) const;
  std::string without_secrets(const ConfigNode& at, std::string text) const;
  /// Returns a string as it stands in the file, except that `{n}` is replaced.
  std::string spelled(const ConfigNode& node) const;
  /// Returns the node's number; the string "{n}" counts as a number if `n` is one.
  std::optional<double> number_in(const ConfigNode& node) const;

  const ConfigTree& tree_;
  Environment environment_;
  const ReadBounds bounds_;
  ConfigRoom room_;
  int suggestions_ = 0;  ///< calls of may_suggest() for a new error
  Findings errors_;
  Findings warnings_;
  const DeviceOrigin* origin_ = nullptr;
  std::uint32_t device_ = 0;  ///< number of set_origin() calls
};

/// Names that must be unique among siblings: those of links, of devices, and of the groups or tags
/// of one device. Remembers where each name stands.
class NameTable {
 public:
  /// Adds a name. If it is taken, reports an error at `node` that names the other place too.
  void add(ConfigReader& reader, const std::string& name, const ConfigNode& node,
           std::uint32_t index);
  /// Reads the name of `item` from its member `key` and adds it. Returns an empty string if it is
  /// wrong or absent, which is reported.
  std::string read(ConfigReader& reader, const ConfigNode& item, KeyRef key, std::uint32_t index);
  /// Records an item of the list that has no readable name.
  void add_unnamed() { has_unnamed_ = true; }
  std::optional<std::uint32_t> find(std::string_view name) const;
  /// Reports the unknown `name` at `at`, as in "there is no link "x"; there are a, b". `what`
  /// begins the text; `none` ends it if the table is empty. No report if an item has no readable
  /// name: that item may be the one meant.
  void report_unknown(ConfigReader& reader, const ConfigNode& at, std::string_view what,
                      std::string_view name, std::string_view none) const;

 private:
  struct Entry {
    std::uint32_t index = 0;
    const ConfigNode* node = nullptr;
    bool is_guess = false;  ///< the file has a wrong name, which probably means this one
  };
  std::map<std::string, Entry, std::less<>> entries_;
  bool has_unnamed_ = false;
};

}  // namespace fxagent
