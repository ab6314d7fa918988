// Reads typed values out of a config tree and collects what is wrong with them.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "agent/config/config.h"
#include "agent/config/config_limits.h"
#include "agent/config/findings.h"
#include "agent/config/keys.h"
#include "agent/config/tree.h"

namespace fxagent {

/// The words that `word` means ("rw": "read_write", "E": "even"), else those nearest by edit
/// distance: one, or a few that are equally near; none where more than half of the letters differ.
/// A word that is the beginning of others means those ("password": "password_file",
/// "password_env").
std::vector<std::string_view> nearest_words(std::string_view word,
                                            std::span<const std::string_view> words);

/// "; did you mean `a` or `b`?", to stand behind what is wrong; empty where none is near.
std::string did_you_mean(std::string_view word, std::span<const std::string_view> words);

/// "a, b or c"
std::string one_of(std::span<const std::string_view> words);

/// Of the form that topics and commands use: [a-z0-9_-]{1,64}.
bool is_name(std::string_view text);

/// Whether `{n}` stands in the text: what a device's key `n` replaces. Behind a `$` it is the
/// environment variable `n`.
bool has_place_of_n(std::string_view text);
/// `text` with every such `{n}` replaced.
std::string with_n(std::string_view text, std::string_view n);
/// The number that `n` is, "07" being 7; nullopt where it is none.
std::optional<std::int64_t> number_of_n(std::string_view n);

/// Getters return nullopt (or nullptr) where the key is absent, and where its value is wrong: then
/// they have reported it, as they report that a required key is absent. Ranges, words and defaults
/// are those of the key. So a caller reads on and finds the other errors of the file too. Error
/// texts show strings as they stand in the file, never what the environment put into them.
class ConfigReader {
 public:
  /// `tree` must outlive the reader.
  ConfigReader(const ConfigTree& tree, Environment environment, const ReadBounds& bounds = {});

  /// What is read from here on belongs to one of the devices that an entry or a template stands
  /// for: its `{n}` is replaced, before any `${NAME}` is, and errors name both places. Null: to
  /// none. It must stay where it is until the next call.
  void set_origin(const DeviceOrigin* origin);

  void error(const ConfigNode& at, std::string text);
  /// The same, in the line of the member's key.
  void error_at_key(const ConfigNode& at, std::string text);
  void warn(const ConfigNode& at, std::string text);

  bool failed() const { return !errors_.empty(); }
  /// Whether an error at this byte may have a did_you_mean(), which compares its word with all that
  /// are right: 20 of a text may.
  bool may_suggest(std::uint32_t offset);

  /// Counts what is to be built at `at`. False, and an error: the config is too large.
  bool has_room(const ConfigNode& at, const ConfigSize& more);
  const ConfigRoom& room() const { return room_; }
  /// Nothing is to be built any more: the config is too large, or nobody waits for it.
  bool is_over() const { return room_.is_full() || bounds_.is_stopped(); }
  /// In the order of the file.
  std::vector<ConfigError> errors() const;
  std::vector<std::string> warnings() const;

  /// A string with `{n}` and `${NAME}` replaced; empty where it is none or has a fault, which is
  /// not reported.
  std::string replaced(const ConfigNode& node) const;

  /// "/links/0 (line 12)"
  std::string place_of(const ConfigNode& node) const;

  /// False (and an error) where the node is no object, true otherwise; members that are not among
  /// `keys` or `more` are errors, as are members given twice. What is wrong with a member of the
  /// name of one of `left_to_caller` the caller can say better.
  bool check_object(const ConfigNode& node, std::span<const ConfigKey> keys,
                    std::span<const std::string_view> more = {},
                    std::span<const std::string_view> left_to_caller = {});

  const ConfigNode* object(const ConfigNode& parent, const ConfigKey& key);
  const ConfigNode* array(const ConfigNode& parent, const ConfigKey& key);
  /// The items of an array that the tree has folded; none where the key is absent or wrong. They
  /// must outlive what is kept of them.
  std::vector<ConfigNode> items(const ConfigNode& parent, const ConfigKey& key);

  std::optional<std::int64_t> integer(const ConfigNode& parent, const ConfigKey& key);
  /// The default where there is no right value.
  template <class T>
  T integer_as(const ConfigNode& parent, const ConfigKey& key) {
    return static_cast<T>(integer(parent, key).value_or(key.number()));
  }
  std::optional<double> number(const ConfigNode& parent, const ConfigKey& key);
  /// The default where there is no right value.
  bool boolean(const ConfigNode& parent, const ConfigKey& key);
  /// A string that is not empty, `${NAME}` replaced.
  std::optional<std::string> text(const ConfigNode& parent, const ConfigKey& key);
  /// The same for an item of an array.
  std::optional<std::string> text(const ConfigNode& node);
  /// A string that no error may quote.
  struct Secret {
    std::string value;
    bool in_clear = false;  ///< it stands in the file, and not just the variable that holds it
  };
  std::optional<Secret> secret(const ConfigNode& parent, const ConfigKey& key);
  /// A string of the form that topics and commands use: [a-z0-9_-]{1,64}.
  std::optional<std::string> name(const ConfigNode& parent, const ConfigKey& key);
  /// Which of the key's words the string is.
  std::optional<std::size_t> choice(const ConfigNode& parent, const ConfigKey& key);
  std::size_t choice_or_default(const ConfigNode& parent, const ConfigKey& key) {
    return choice(parent, key).value_or(key.index());
  }

 private:
  std::string place_of(const std::string& pointer, std::uint32_t offset) const;
  const ConfigNode* member(const ConfigNode& parent, const ConfigKey& key);
  void wrong_kind(const ConfigNode& node, std::string_view wanted);
  /// `text` with every `${NAME}` replaced and `$${` turned into `${`. Faults go to `fault`, which
  /// may be null.
  std::optional<std::string> expand(std::string_view text, std::string* fault) const;
  std::string without_secrets(const ConfigNode& at, std::string text) const;
  /// A string as it stands in the file, but for `{n}`.
  std::string spelled(const ConfigNode& node) const;
  /// The node's number: `{n}` alone is one where `n` is.
  std::optional<double> number_in(const ConfigNode& node) const;

  const ConfigTree& tree_;
  Environment environment_;
  const ReadBounds bounds_;
  ConfigRoom room_;
  int suggestions_ = 0;  ///< that may_suggest() has let pass
  Findings errors_;
  Findings warnings_;
  const DeviceOrigin* origin_ = nullptr;
  std::uint32_t device_ = 0;  ///< calls of set_origin()
};

}  // namespace fxagent
