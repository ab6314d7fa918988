// Small functions for text: escapes what comes from outside, and writes times and counts.
// utfcpp decides what is UTF-8 (RFC 3629: no overlong forms, no surrogates, nothing above
// U+10FFFF). Any thread.
#pragma once

#include <charconv>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <system_error>

namespace fxagent {

bool is_utf8(std::string_view text);
/// Returns the place of the first byte that is not part of valid UTF-8; npos: all are.
std::size_t first_foreign(std::string_view text);
/// True for a control character of ASCII, which includes DEL.
inline bool is_control(char c) { return static_cast<unsigned char>(c) < ' ' || c == 0x7F; }
/// True if `text` can be the name of an agent, a device or the like: 1 to 64 characters a-z, 0-9,
/// _ and -.
bool is_name(std::string_view text);

/// Returns the beginning of `text`: at most `most` bytes, up to the end of a UTF-8 character.
std::string_view beginning(std::string_view text, std::size_t most);

/// Returns `text` without the blanks, tabs and line ends around it.
std::string_view trimmed(std::string_view text);

/// Removes the text before the first `separator`, and the separator. Returns that text; all of it
/// if there is no separator.
std::string_view take_until(std::string_view& text, char separator);

/// Returns the number that the whole text spells in decimal; nullopt if it does not, or if Number
/// cannot hold it.
template <class Number>
std::optional<Number> number_from(std::string_view text) {
  Number number{};
  const auto [stop, fault] = std::from_chars(text.data(), text.data() + text.size(), number);
  const bool is_whole = fault == std::errc() && stop == text.data() + text.size();
  return is_whole ? std::optional(number) : std::nullopt;
}

/// Escaping by place of display. "Foreign" means a byte that is not part of valid UTF-8.
enum class Escape : std::uint8_t {
  json,      ///< a JSON string; foreign bytes become U+FFFD
  terminal,  ///< an ASCII-only JSON string, so that the text cannot control the terminal
  log,       ///< a quoted log value: \" \\, and \xnn for foreign bytes and control characters
  message,   ///< an error message: \xNN for foreign bytes and control characters
  record,    ///< an audit record: \xnn for foreign bytes
};

/// Appends `text`, escaped and without quotes. If the result would exceed `most` bytes, cuts it
/// after a whole character and adds "...". Escape::terminal ignores `most`.
void append_escaped(std::string& out, std::string_view text, Escape how,
                    std::size_t most = std::string_view::npos);
std::string escaped(std::string_view text, Escape how, std::size_t most = std::string_view::npos);

/// Appends `text` as a JSON string, in quotes.
void append_json_string(std::string& out, std::string_view text);

/// Returns "1 tag", "0 tags", "2 tags".
inline std::string counted(std::uint64_t number, std::string_view noun) {
  return std::to_string(number) + " " + std::string(noun) + (number == 1 ? "" : "s");
}

/// Returns the duration in milliseconds, "12.5".
std::string ms_text(std::chrono::nanoseconds duration);

/// Formats a time as "2026-11-21T08:30:15.250Z". Times before the year 0 or after 32767 become
/// "-62200000000000 ms".
std::string utc_text(std::int64_t utc_ms);

/// Parses "2026-11-21", "2026-11-21T08:30" or "2026-11-21T08:30:15", each with or without a
/// trailing Z, to milliseconds UTC. Returns nullopt for any other text.
std::optional<std::int64_t> utc_ms_from(std::string_view text);

/// Returns eight random hex digits, for a client id that no other client has.
std::string random_digits();

}  // namespace fxagent
