// Converts files of other programs to UTF-8.
#pragma once

#include <string>
#include <string_view>
#include <tl/expected.hpp>

namespace fxagent {

/// Converts `bytes` to UTF-8 without a byte order mark. Detects UTF-8, and UTF-16 by its mark or
/// its zero bytes. Treats anything else as `legacy`, an iconv encoding such as "CP932" (Shift-JIS)
/// or "WINDOWS-1252". The error names the encoding that the bytes violate.
tl::expected<std::string, std::string> to_utf8(std::string_view bytes, const char* legacy);

}  // namespace fxagent
