#include "agent/config/json/syntax_fault.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <utility>
#include <vector>

namespace fxagent {
namespace {

bool is_letter(char c) { return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '_'; }
bool is_word(char c) { return is_letter(c) || (c >= '0' && c <= '9') || c == '-' || c == '.'; }
bool is_number(char c) { return (c >= '0' && c <= '9') || c == '-' || c == '+' || c == '.'; }

/// Walks through the tokens of the text without parsing their content.
class Walk {
 public:
  Walk(std::string_view text, std::size_t read)
      : text_(text), end_(std::min(read + 1, text.size())) {
    constexpr std::string_view byte_order_mark = "\xEF\xBB\xBF";
    if (text.starts_with(byte_order_mark)) at_ = byte_order_mark.size();
  }

  std::optional<SyntaxFault> first_fault() {
    while (!fault_ && skip_blanks() && token()) token_end_ = at_;
    return fault_;
  }

 private:
  /// Kind of token expected next.
  enum class Next : std::uint8_t { value, key, colon, comma, nothing };

  bool skip_blanks() {
    at_ = std::min(text_.find_first_not_of(" \t\r\n", at_), text_.size());
    return at_ < end_;
  }

  /// Reads one token. False if the walk cannot go on.
  bool token() {
    const char c = text_[at_];
    if (c == '#' || text_.substr(at_, 2) == "//" || text_.substr(at_, 2) == "/*")
      return wrong(at_, "a comment, which JSON does not allow: remove it");
    switch (c) {
      case '{':
      case '[':
        return may_begin_value() && open(c);
      case '}':
      case ']':
        return close(c);
      case ':':
        return next_ == Next::colon && pass(Next::value);
      case ',':
        return comma();
      case '\'':
        return wrong(at_, "a single quote: JSON allows only double quotes (\")");
      default:
        break;
    }
    if (c == '"') return may_begin_value() && string();
    if (is_letter(c)) return may_begin_value() && word();
    return is_number(c) && may_begin_value() && number();
  }

  /// True if a value or a key may begin here. Otherwise records the fault, such as a missing comma
  /// or colon before it.
  bool may_begin_value() {
    if (next_ == Next::comma) return wrong(token_end_, "a comma is missing here");
    if (next_ == Next::colon) return wrong(token_end_, "a colon is missing here, after the key");
    if (next_ == Next::nothing)
      return wrong(at_, "more text after the end of the outermost brackets");
    return true;
  }

  bool open(char bracket) {
    open_.push_back(bracket);
    return pass(bracket == '{' ? Next::key : Next::value);
  }

  bool close(char bracket) {
    const char opened = bracket == '}' ? '{' : '[';
    if (open_.empty() || open_.back() != opened) {
      const std::string_view needed =
          opened == '{' ? "a ] is missing before this }" : "a } is missing before this ]";
      return open_.empty() ? false : wrong(at_, std::string(needed));
    }
    if (is_behind(','))
      return wrong(at_,
                   std::string("there is a comma before this ") + bracket + ": remove the comma");
    if (is_behind(':')) return wrong(at_, std::string("a value is missing before this ") + bracket);
    if (next_ == Next::colon) return wrong(token_end_, "a colon and a value are missing here");
    open_.pop_back();
    return pass(open_.empty() ? Next::nothing : Next::comma);
  }

  bool comma() {
    if (open_.empty()) return false;
    if (is_behind(':')) return wrong(at_, "a value is missing before this comma");
    if (next_ == Next::colon) return wrong(token_end_, "a colon and a value are missing here");
    if (next_ != Next::comma) return wrong(at_, "there is nothing before this comma: remove it");
    return pass(open_.back() == '{' ? Next::key : Next::value);
  }

  bool string() {
    std::size_t close = at_ + 1;
    while (close < text_.size() && text_[close] != '"' && text_[close] != '\n')
      close += text_[close] == '\\' ? 2U : 1U;
    if (close >= text_.size() || text_[close] == '\n')
      return wrong(at_, "the string that begins here has no closing \" on its line");
    at_ = close;
    return pass_value();
  }

  /// Reads true, false or null. Any other word is a string or a key without quotes.
  bool word() {
    const auto end =
        std::find_if_not(text_.begin() + static_cast<std::ptrdiff_t>(at_), text_.end(), is_word);
    const auto size = static_cast<std::size_t>(end - text_.begin()) - at_;
    const std::string_view said = text_.substr(at_, size);
    if (next_ == Next::key) return wrong(at_, "the key has no quotes: write \"key\"");
    constexpr std::array<std::string_view, 3> known{"true", "false", "null"};
    if (std::ranges::find(known, said) == known.end())
      return wrong(
          at_,
          "an unknown word. JSON has only true, false and null: a text needs double quotes (\")");
    at_ += size - 1;
    return pass_value();
  }

  bool number() {
    if (next_ == Next::key) return wrong(at_, "a key needs double quotes (\")");
    while (at_ + 1 < text_.size() && (is_word(text_[at_ + 1]) || is_number(text_[at_ + 1]))) ++at_;
    return pass_value();
  }

  bool pass_value() {
    if (next_ == Next::key) return pass(Next::colon);
    return pass(open_.empty() ? Next::nothing : Next::comma);
  }

  bool pass(Next next) {
    next_ = next;
    ++at_;
    return true;
  }

  /// True if the last token was `token`, a comma or a colon.
  bool is_behind(char token) const {
    return (next_ == Next::key || next_ == Next::value) && token_end_ > 0 &&
           text_[token_end_ - 1] == token;
  }

  bool wrong(std::size_t at, std::string text) {
    fault_ = SyntaxFault{at, std::move(text)};
    return false;
  }

  const std::string_view text_;
  const std::size_t end_;
  std::size_t at_ = 0;
  std::size_t token_end_ = 0;  ///< byte after the last token
  Next next_ = Next::value;
  std::vector<char> open_;
  std::optional<SyntaxFault> fault_;
};

}  // namespace

std::optional<SyntaxFault> syntax_fault(std::string_view text, std::size_t read) {
  return Walk(text, read).first_fault();
}

}  // namespace fxagent
