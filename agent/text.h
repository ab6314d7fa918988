// Text that comes from others, and what must be escaped of it where it is shown. What is UTF-8 (RFC
// 3629: no overlong forms, no surrogates, nothing above U+10FFFF) is utfcpp's to say. Any thread.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

namespace fxagent {

bool is_utf8(std::string_view text);

/// By where the text is shown. "Foreign": each byte that is not UTF-8.
enum class Escape : std::uint8_t {
  json,      ///< in a JSON string; U+FFFD for what is foreign
  terminal,  ///< as in a JSON string of ASCII: it must not steer what shows it
  log,       ///< between quotes: \" \\ and \xnn for what is foreign and for control characters
  message,   ///< \xNN for what is foreign and for control characters of ASCII
  record,    ///< \xnn for what is foreign
};

/// Appends `text`, escaped and without quotes. `most`: where that makes more bytes it ends with
/// "..." behind whole characters; not for Escape::terminal.
void append_escaped(std::string& out, std::string_view text, Escape how,
                    std::size_t most = std::string_view::npos);
std::string escaped(std::string_view text, Escape how, std::size_t most = std::string_view::npos);

}  // namespace fxagent
