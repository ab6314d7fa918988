// JSON text as a tree with the position of every value, so that an error can name the line.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <tl/expected.hpp>
#include <vector>

#include "agent/config/config_error.h"

namespace fxagent {

/// One value of the text. `children` are the members of an object or the items of an array, in the
/// order of the text, duplicate keys included. A folded array has none: see ConfigTree.
struct ConfigNode {
  enum class Kind : std::uint8_t { null, boolean, integer, number, string, array, object };
  Kind kind = Kind::null;
  bool boolean = false;
  std::uint32_t offset = 0;      ///< byte of the text at which the parser recognised the value
  std::uint32_t key_offset = 0;  ///< object members only: the same for the key
  std::uint32_t index = 0;       ///< array items only
  std::uint32_t end = 0;         ///< folded arrays only: the byte after it; 0: not folded
  std::int64_t integer = 0;      ///< integer only
  double number = 0;             ///< integer and number
  std::string key{};             ///< object members only
  std::string text{};  ///< strings, JSON escapes decoded; numbers that are not integers, as spelled
  const ConfigNode* parent = nullptr;
  std::vector<ConfigNode> children{};

  /// Returns the first member with this name; nullptr if there is none or this is not an object.
  const ConfigNode* find(std::string_view name) const;
};

/// Returns the JSON pointer (RFC 6901), such as "/devices/0/tags/3"; empty for the root. Escapes
/// control characters in keys as shown() does.
std::string pointer_to(const ConfigNode& node);
/// Returns "/links/0 (line 12)".
std::string place_text(const std::string& pointer, int line);

/// Limits of parsing.
struct TreeBounds {
  /// Far beyond any plant: 270 MB of nodes.
  static constexpr std::size_t most_nodes = 2'000'000;

  std::size_t nodes = most_nodes;  ///< outside of folded arrays, and in each folded array
  /// Any thread may set it to end parsing with an error. nullptr: parsing cannot be stopped.
  const std::atomic<bool>* stop = nullptr;
};

/// Config files may have comments. Texts that arrive over MQTT must not.
enum class Comments : std::uint8_t { refused, allowed };

/// A parsed text. Parsing is linear in its size for any content and never throws. The tags of
/// devices make up most of a large file, and as nodes they take ten times their text. So arrays at
/// the depth of /devices/0/tags are folded: the tree does not keep their items, and items_of()
/// parses them again.
class ConfigTree {
 public:
  /// Largest text in bytes. Far beyond any plant.
  static constexpr std::size_t max_bytes = std::size_t{64} << 20;
  static constexpr std::size_t max_depth = 32;
  /// Number of brackets around a folded array.
  static constexpr std::size_t folded_depth = 3;

  enum class Folding : std::uint8_t { tags, none };

  /// Parses `text`, which must outlive the tree. A text beyond the limits is an error too. Comments
  /// are those of C++: // and /* */. The text of the error has line and column in words.
  static tl::expected<ConfigTree, ConfigError> parse(std::string_view text,
                                                     Folding folding = Folding::tags,
                                                     const TreeBounds& bounds = {},
                                                     Comments comments = Comments::refused);

  const ConfigNode& root() const { return *root_; }
  /// Parses the items of a folded array of this tree. Their parent is `folded`. Returns a copy of
  /// the items of any other array.
  std::vector<ConfigNode> items_of(const ConfigNode& folded) const;
  /// Returns the value at a JSON pointer, or the nearest one around it. Keys with ~ or / and items
  /// of folded arrays are not found.
  const ConfigNode& nearest(std::string_view pointer) const;
  /// Returns the 1-based line of a byte of the text.
  int line_of(std::size_t offset) const;
  std::string place_of(const ConfigNode& node) const;

 private:
  explicit ConfigTree(std::string_view text) : text_(text) {}

  std::string_view text_;
  // Children point at their parents, so the root must stay where it is when the tree moves.
  std::unique_ptr<ConfigNode> root_;
  std::vector<std::uint32_t> newlines_;
};

/// Limits for a text of any content, which may have its tags as nodes: one node a byte.
inline constexpr TreeBounds kAnyTree{.nodes = ConfigTree::max_bytes};

/// Returns `text` for an error message: control bytes and broken UTF-8 as \xNN, cut after `most`
/// bytes.
std::string shown(std::string_view text, std::size_t most = 80);

}  // namespace fxagent
