#include "agent/config/json/syntax_fault.h"

#include <algorithm>
#include <utility>

#include "agent/text/text.h"

namespace fxagent {
namespace {

bool is_letter(char c) { return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '_'; }
bool is_digit(char c) { return c >= '0' && c <= '9'; }
bool is_sign(char c) { return c == '-' || c == '+' || c == '.'; }

bool is_comment(std::string_view rest) { return rest.starts_with("//") || rest.starts_with("/*"); }

/// True if the character at `at` is a quote without a backslash that escapes it.
bool is_quote(std::string_view text, std::size_t at) {
  const std::size_t backslashes = at - (text.substr(0, at).find_last_not_of('\\') + 1);
  return text[at] == '"' && backslashes % 2 == 0;
}

}  // namespace

std::size_t next_token(std::string_view text, std::size_t at, Comments comments) {
  while (true) {
    at = std::min(text.find_first_not_of(" \t\r\n", at), text.size());
    if (comments == Comments::refused || !is_comment(text.substr(at))) return at;
    const bool is_line = text[at + 1] == '/';
    const std::size_t end = is_line ? text.find_first_of("\r\n", at) : text.find("*/", at + 2);
    if (end == text.npos) return is_line ? text.size() : at;
    at = is_line ? end : end + 2;
  }
}

SyntaxFault syntax_fault(std::string_view text, const AcceptedText& accepted, std::size_t read,
                         Comments comments, std::string words) {
  constexpr std::string_view kByteOrderMark = "\xEF\xBB\xBF";
  const std::size_t end =
      accepted.end == 0 && text.starts_with(kByteOrderMark) ? kByteOrderMark.size() : accepted.end;
  const char last = end == 0 ? '\0' : text[end - 1];
  const char bracket = accepted.open.empty() ? '\0' : text[accepted.open.back()];
  const bool is_key = accepted.is_key;
  const bool is_value = accepted.end > 0 && !is_key && last != '{' && last != '[';

  // The parser accepted one comma or colon behind `end`, or none, and rejected the token at `at`.
  std::size_t at = next_token(text, end, comments);
  const char mark = is_key ? ':' : is_value && bracket != '\0' ? ',' : '\0';
  const bool has_mark = at < text.size() && text[at] == mark;
  if (has_mark) at = next_token(text, at + 1, comments);
  SyntaxFault other{read, std::move(words)};
  if (at >= text.size() && bracket != '\0') other.unclosed = accepted.open.back();
  if (at >= text.size() && accepted.end == 0)
    other.text = "there is no value: the text is empty or has only comments";
  if (at >= text.size() || at > read) return other;
  if (first_foreign(text.substr(at)) <= read - at)
    other.text = "the text is not UTF-8 here; its encoding must be UTF-8";

  const char c = text[at];
  const bool is_close = c == '}' || c == ']';
  if (c == '#' || is_comment(text.substr(at)))
    return {at, comments == Comments::refused
                    ? "a comment, which only a config file may have: remove it"
                : c == '#' ? "a comment begins with // and not with #"
                           : "the comment that begins here has no closing */"};
  if (c == '\'') return {at, "a single quote: JSON allows only double quotes (\")"};
  const bool is_end = read + 1 == text.size() && (read == at || !is_quote(text, read));
  if (c == '"' && (is_end || text[read] == '\n' || text[read] == '\r'))
    return {at, "the string that begins here has no closing \" on its line"};
  if (c == '"' && static_cast<unsigned char>(text[read]) < ' ')
    return {read, text[read] == '\t' ? "a tab in a string: write \\t"
                                     : "a control character in a string: remove it, or write it as "
                                       "\\u and four hexadecimal digits"};
  if (is_close && bracket != '\0' && bracket != (c == '}' ? '{' : '['))
    return {at, c == '}' ? "a ] is missing before this }" : "a } is missing before this ]",
            accepted.open.back()};
  if (is_key && !has_mark)
    return {end, is_close || c == ',' ? "a colon and a value are missing here"
                                      : "a colon is missing here, after the key"};
  if (is_value && bracket == '\0') return {at, "more text after the end of the outermost brackets"};
  if (is_value && !has_mark) {
    const bool is_glued = at == end && (is_letter(last) || is_digit(last));  // such as 0x1F
    const bool begins = c == '"' || c == '{' || c == '[' || c == '-' || is_letter(c) || is_digit(c);
    if (begins && !is_glued) return {end, "a comma is missing here"};
    return other;
  }
  // A key or a value was expected here.
  if (c == ',' && bracket != '\0')
    return {at, is_key ? "a value is missing before this comma"
                       : "there is nothing before this comma: remove it"};
  if (is_close && has_mark)
    return {at, is_key ? std::string("a value is missing before this ") + c
                       : std::string("there is a comma before this ") + c + ": remove the comma"};
  if (bracket == '{' && !is_key) {
    if (is_letter(c)) return {at, "the key has no quotes: write \"key\""};
    if (is_digit(c) || is_sign(c))
      return {at, "a key needs double quotes (\"); a number has a decimal point, not a comma"};
  } else if (is_letter(c)) {
    return {at,
            "an unknown word. JSON has only true, false and null: a text needs double quotes (\")"};
  }
  return other;
}

}  // namespace fxagent
