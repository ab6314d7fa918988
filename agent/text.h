// Text for display: escapes what comes from outside, and writes durations. utfcpp decides what is
// UTF-8 (RFC 3629: no overlong forms, no surrogates, nothing above U+10FFFF). Any thread.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

namespace fxagent {

bool is_utf8(std::string_view text);

/// Escaping by place of display. "Foreign" means a byte that is not part of valid UTF-8.
enum class Escape : std::uint8_t {
  json,      ///< a JSON string; foreign bytes become U+FFFD
  terminal,  ///< an ASCII-only JSON string, so that the text cannot control the terminal
  log,       ///< a quoted log value: \" \\, and \xnn for foreign bytes and control characters
  message,   ///< an error message: \xNN for foreign bytes and ASCII control characters
  record,    ///< an audit record: \xnn for foreign bytes
};

/// Appends `text`, escaped and without quotes. If the result would exceed `most` bytes, cuts it
/// after a whole character and adds "...". Escape::terminal ignores `most`.
void append_escaped(std::string& out, std::string_view text, Escape how,
                    std::size_t most = std::string_view::npos);
std::string escaped(std::string_view text, Escape how, std::size_t most = std::string_view::npos);

/// Returns the duration in milliseconds, "12.5".
std::string ms_text(std::chrono::nanoseconds duration);

}  // namespace fxagent
