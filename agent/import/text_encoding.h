// Files of other programs as UTF-8.
#pragma once

#include <string>
#include <string_view>
#include <tl/expected.hpp>

namespace fxagent {

/// `bytes` as UTF-8, without a byte order mark. UTF-8 and UTF-16 are told by themselves, UTF-16
/// without a mark by its zero bytes; anything else is taken for `legacy`, an encoding of iconv:
/// "CP932" (Shift-JIS), "WINDOWS-1252". The error says what the bytes are not.
tl::expected<std::string, std::string> to_utf8(std::string_view bytes, const char* legacy);

}  // namespace fxagent
