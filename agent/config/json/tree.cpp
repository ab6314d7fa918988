#include "agent/config/json/tree.h"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <utility>

#include "agent/config/json/syntax_fault.h"
#include "agent/text/text.h"

namespace fxagent {
namespace {

using Json = nlohmann::json;
using Kind = ConfigNode::Kind;

// Most bytes shown of an error text of the JSON library.
constexpr std::size_t kMaxFault = 240;
// No array is nested this deep, so none is folded.
constexpr std::size_t kUnfolded = ConfigTree::max_depth;

/// Iterates over the text and counts the bytes that the lexer has taken. SAX events get their
/// position from this count; the library does not report one.
class TracedIterator {
 public:
  using value_type = char;
  using difference_type = std::ptrdiff_t;

  TracedIterator(const char* at, std::size_t* taken) : at_(at), taken_(taken) {}
  const char& operator*() const { return *at_; }
  TracedIterator& operator++() {
    ++at_;
    ++*taken_;
    return *this;
  }
  TracedIterator operator++(int) {
    TracedIterator before = *this;
    ++*this;
    return before;
  }
  friend bool operator==(const TracedIterator&, const TracedIterator&) = default;

 private:
  const char* at_;
  std::size_t* taken_;  // outlives the parse
};

/// Builds the tree from the library's SAX events. Folds arrays inside of `folded_depth` brackets.
class TreeBuilder {
 public:
  TreeBuilder(ConfigNode& root, std::string_view text, const std::size_t& taken,
              std::size_t folded_depth, const TreeBounds& bounds)
      : root_(root), text_(text), taken_(taken), folded_depth_(folded_depth), bounds_(bounds) {}

  bool null() { return leaf({}); }
  bool boolean(bool value) { return leaf({.kind = Kind::boolean, .boolean = value}); }
  bool number_integer(std::int64_t value) {
    return leaf({.kind = Kind::integer, .integer = value, .number = static_cast<double>(value)});
  }
  bool number_unsigned(std::uint64_t value) {
    if (std::in_range<std::int64_t>(value)) return number_integer(static_cast<std::int64_t>(value));
    return number_float(static_cast<double>(value), std::to_string(value));
  }
  bool number_float(double value, const std::string& spelled) {
    return leaf({.kind = Kind::number, .number = value, .text = spelled});
  }
  bool string(std::string& value) { return leaf({.kind = Kind::string, .text = std::move(value)}); }
  bool binary(Json::binary_t&) { return false; }  // not in a JSON text
  bool key(std::string& value) {
    accepted_.end = taken_;
    accepted_.is_key = true;
    if (is_folding()) return true;
    key_ = std::move(value);
    key_offset_ = place();
    return true;
  }
  bool start_object(std::size_t) { return open(Kind::object); }
  bool start_array(std::size_t) { return open(Kind::array); }
  bool end_object() { return close(); }
  bool end_array() { return close(); }
  bool parse_error(std::size_t, const std::string&, const Json::exception& fault) {
    // "[json.exception.parse_error.101] parse error at line 1, column 2: syntax error while …": the
    // caller works out the position, so keep only the words after it, or after the bracket.
    const std::string_view what = fault.what();
    std::size_t end = what.find(": ");
    if (end == what.npos) end = what.find("] ");
    fault_ = end == what.npos ? what : what.substr(end + 2);
    // The last token may be a password.
    fault_.resize(std::min(fault_.size(), fault_.find("; last read: ")));
    return false;
  }

  const std::string& fault() const { return fault_; }
  const AcceptedText& accepted() const { return accepted_; }
  /// Returns the reason if a limit or `stop` ended parsing; empty otherwise.
  const std::string& end() const { return end_; }

 private:
  bool leaf(ConfigNode value) {
    if (is_over()) return false;
    if (value.kind == Kind::integer || value.kind == Kind::number) end_number();
    if (!is_folding()) add(std::move(value));
    return true;
  }
  /// Returns the last byte of the token, or for a number the byte after it, which the lexer had to
  /// read. Both are on the line of the token, since no token spans two lines; the byte after a
  /// number may be the newline that ends the line.
  std::uint32_t place() const { return static_cast<std::uint32_t>(taken_ - 1); }

  bool is_folding() const { return in_folded_ > 0; }

  /// The lexer had to read the byte behind a number, except at the end of the text.
  void end_number() {
    const char last = text_[taken_ - 1];
    if (last < '0' || last > '9') --accepted_.end;
  }

  /// Records and counts a node. True if parsing must end: too many nodes, or `stop` is set.
  bool is_over() {
    accepted_.end = taken_;
    accepted_.is_key = false;
    std::size_t& nodes = is_folding() ? nodes_in_folded_ : nodes_;
    if (++nodes > bounds_.nodes)
      end_ = "holds more than " + std::to_string(bounds_.nodes) + " JSON values";
    else if (bounds_.stop != nullptr && *bounds_.stop)
      end_ = "could not be read completely";
    return !end_.empty();
  }

  ConfigNode* add(ConfigNode value) {
    value.offset = place();
    if (open_.empty()) return &(root_ = std::move(value));
    std::vector<ConfigNode>& siblings = open_.back()->children;
    if (open_.back()->kind == Kind::object) {
      value.key = std::move(key_);
      value.key_offset = key_offset_;
    } else {
      value.index = static_cast<std::uint32_t>(siblings.size());
    }
    // An open node is always the last of its siblings, so growing this vector moves no open node.
    return &siblings.emplace_back(std::move(value));
  }
  bool open(Kind kind) {
    if (is_over()) return false;
    if (accepted_.open.size() == ConfigTree::max_depth) {
      fault_ = "more than " + std::to_string(ConfigTree::max_depth) + " levels of brackets";
      return false;
    }
    accepted_.open.push_back(place());
    if (is_folding()) {
      ++in_folded_;
      return true;
    }
    ConfigNode* const node = add({.kind = kind});
    if (kind == Kind::array && open_.size() == folded_depth_) {
      folded_ = node;
      in_folded_ = 1;
      nodes_in_folded_ = 0;
      return true;
    }
    open_.push_back(node);
    return true;
  }
  bool close() {
    accepted_.end = taken_;
    accepted_.is_key = false;
    accepted_.open.pop_back();
    if (!is_folding()) {
      open_.pop_back();
    } else if (--in_folded_ == 0) {
      folded_->end = static_cast<std::uint32_t>(taken_);
    }
    return true;
  }

  ConfigNode& root_;
  const std::string_view text_;
  const std::size_t& taken_;
  const std::size_t folded_depth_;
  const TreeBounds bounds_;
  std::size_t nodes_ = 0;
  std::size_t nodes_in_folded_ = 0;
  std::vector<ConfigNode*> open_;
  ConfigNode* folded_ = nullptr;  ///< the last folded array
  std::size_t in_folded_ = 0;     ///< open brackets in it, its own included
  std::string key_;
  std::uint32_t key_offset_ = 0;
  AcceptedText accepted_;
  std::string fault_;
  std::string end_;
};

void name_parents(ConfigNode& node) {
  for (ConfigNode& child : node.children) {
    child.parent = &node;
    name_parents(child);
  }
}

}  // namespace

const ConfigNode* ConfigNode::find(std::string_view name) const {
  if (kind != Kind::object) return nullptr;
  const auto found = std::ranges::find(children, name, &ConfigNode::key);
  return found == children.end() ? nullptr : &*found;
}

std::string pointer_to(const ConfigNode& node) {
  if (node.parent == nullptr) return {};
  const bool is_item = node.parent->kind == Kind::array;
  const std::string key = is_item ? std::to_string(node.index) : node.key;
  return pointer_to(*node.parent) + shown((Json::json_pointer() / key).to_string(), key.npos);
}

std::string place_text(const std::string& pointer, int line) {
  return (pointer.empty() ? "the file" : pointer) + " (line " + std::to_string(line) + ")";
}

tl::expected<ConfigTree, ConfigError> ConfigTree::parse(std::string_view text, Folding folding,
                                                        const TreeBounds& bounds,
                                                        Comments comments) {
  if (text.size() > max_bytes)
    return tl::unexpected(
        ConfigError{"", 0, "larger than " + std::to_string(max_bytes >> 20) + " MiB"});
  ConfigTree tree(text);
  tree.root_ = std::make_unique<ConfigNode>();
  for (std::size_t i = 0; i < text.size(); ++i)
    if (text[i] == '\n') tree.newlines_.push_back(static_cast<std::uint32_t>(i));

  const auto syntax_error = [&](std::size_t at, const std::string& fault) {
    const int line = tree.line_of(at);
    const std::size_t line_start =
        line == 1 ? 0 : tree.newlines_[static_cast<std::size_t>(line) - 2] + std::size_t{1};
    return tl::unexpected(ConfigError{"", line,
                                      "not JSON at line " + std::to_string(line) + ", column " +
                                          std::to_string(at - line_start + 1) + ": " + fault});
  };
  if (text.starts_with("\xFF\xFE") || text.starts_with("\xFE\xFF"))
    return syntax_error(0, "this file is UTF-16; save it as UTF-8");
  // The library treats a zero byte as the end of the text and would ignore what follows.
  if (const std::size_t zero = text.find('\0'); zero != std::string_view::npos)
    return syntax_error(zero, "a zero byte");

  std::size_t taken = 0;
  TreeBuilder builder(*tree.root_, text, taken, folding == Folding::tags ? folded_depth : kUnfolded,
                      bounds);
  const char* const begin = text.data();
  if (!Json::sax_parse(TracedIterator(begin, &taken), TracedIterator(begin + text.size(), &taken),
                       &builder, Json::input_format_t::json, true, comments == Comments::allowed)) {
    const std::size_t read = taken == 0 ? 0 : taken - 1;
    if (!builder.end().empty())
      return tl::unexpected(ConfigError{"", tree.line_of(read), builder.end()});
    SyntaxFault fault =
        syntax_fault(text, builder.accepted(), read, comments, shown(builder.fault(), kMaxFault));
    if (fault.unclosed)
      fault.text += std::string("; the ") + text[*fault.unclosed] + " in line " +
                    std::to_string(tree.line_of(*fault.unclosed)) + " is not closed";
    return syntax_error(fault.at, fault.text);
  }
  name_parents(*tree.root_);
  return tree;
}

std::vector<ConfigNode> ConfigTree::items_of(const ConfigNode& folded) const {
  if (folded.end == 0) return folded.children;
  ConfigNode array;
  std::size_t taken = folded.offset;
  TreeBuilder builder(array, text_, taken, kUnfolded, {});
  const char* const begin = text_.data();
  // A text without comments may be read with them.
  Json::sax_parse(TracedIterator(begin + folded.offset, &taken),
                  TracedIterator(begin + folded.end, &taken), &builder, Json::input_format_t::json,
                  true, true);
  for (ConfigNode& item : array.children) {
    item.parent = &folded;
    name_parents(item);
  }
  return std::move(array.children);
}

const ConfigNode& ConfigTree::nearest(std::string_view pointer) const {
  const ConfigNode* at = root_.get();
  take_until(pointer, '/');
  while (!pointer.empty()) {
    const std::string_view step = take_until(pointer, '/');
    const auto next = std::ranges::find_if(at->children, [&](const ConfigNode& child) {
      return at->kind == Kind::array ? std::to_string(child.index) == step : child.key == step;
    });
    if (next == at->children.end()) break;
    at = &*next;
  }
  return *at;
}

int ConfigTree::line_of(std::size_t offset) const {
  // A newline belongs to the line that it ends.
  return 1 + static_cast<int>(std::lower_bound(newlines_.begin(), newlines_.end(), offset) -
                              newlines_.begin());
}

std::string ConfigTree::place_of(const ConfigNode& node) const {
  return place_text(pointer_to(node), line_of(node.offset));
}

std::string shown(std::string_view text, std::size_t most) {
  return escaped(text, Escape::message, most);
}

}  // namespace fxagent
