// A JSON text as a tree that remembers where everything stood, so that an error can name the line.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <tl/expected.hpp>
#include <vector>

namespace fxagent {

/// One value of the text. `children` are the members of an object or the items of an array, in the
/// order of the text; duplicate keys are kept. A folded array (ConfigTree) has none.
struct ConfigNode {
  enum class Kind : std::uint8_t { null, boolean, integer, number, string, array, object };
  Kind kind = Kind::null;
  bool boolean = false;
  std::uint32_t offset = 0;      ///< byte of the text where the value was known to have its kind
  std::uint32_t key_offset = 0;  ///< object members only: the same for the key
  std::uint32_t index = 0;       ///< array items only: which of them it is
  std::uint32_t end = 0;         ///< folded arrays only: the byte behind it; 0: not folded
  std::int64_t integer = 0;      ///< integer only
  double number = 0;             ///< integer and number
  std::string key;               ///< object members only
  std::string text;  ///< strings as they stand; numbers that are not integers, as spelled
  const ConfigNode* parent = nullptr;
  std::vector<ConfigNode> children;

  /// The first member of that name; nullptr where there is none or this is no object.
  const ConfigNode* find(std::string_view name) const;
};

/// RFC 6901: "/devices/0/tags/3"; empty for the root.
std::string pointer_to(const ConfigNode& node);

/// How far a text is read.
struct TreeBounds {
  /// Far beyond any plant: 270 MB of nodes.
  static constexpr std::size_t most_nodes = 2'000'000;

  std::size_t nodes = most_nodes;  ///< beside folded arrays, and in each of those
  /// Set by any thread, it ends the reading with an error. Null: nobody does.
  const std::atomic<bool>* stop = nullptr;
};

/// A whole text. Linear in its size, whatever it holds; never throws. A device's tags are nearly
/// all of a large file, and as nodes they take ten times their text. So arrays at the depth of
/// /devices/0/tags are folded: the tree has no children of theirs, and items_of() reads them again
/// for as long as they are wanted.
class ConfigTree {
 public:
  struct SyntaxError {
    int line = 0;
    std::string text;  ///< with line and column in words
  };

  /// Far beyond any plant.
  static constexpr std::size_t max_bytes = std::size_t{64} << 20;
  static constexpr std::size_t max_depth = 32;
  /// Brackets around a folded array.
  static constexpr std::size_t folded_depth = 3;

  enum class Folding : std::uint8_t { tags, none };

  /// A text over the limits is an error too. The text must outlive the tree.
  static tl::expected<ConfigTree, SyntaxError> parse(std::string_view text,
                                                     Folding folding = Folding::tags,
                                                     const TreeBounds& bounds = {});

  const ConfigNode& root() const { return *root_; }
  /// The items of a folded array of this tree, which is their parent.
  std::vector<ConfigNode> items_of(const ConfigNode& folded) const;
  /// 1-based line of a byte of the text.
  int line_of(std::size_t offset) const;

 private:
  explicit ConfigTree(std::string_view text) : text_(text) {}

  std::string_view text_;
  // Children point at their parents, so the root must stay where it is when the tree moves.
  std::unique_ptr<ConfigNode> root_;
  std::vector<std::uint32_t> newlines_;
};

/// `text` for an error message: control bytes and broken UTF-8 as \xNN, cut after `most` bytes.
std::string shown(std::string_view text, std::size_t most = 80);

}  // namespace fxagent
