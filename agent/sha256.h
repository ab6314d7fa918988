// SHA-256, by OpenSSL's libcrypto. Pure, any thread.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <string_view>

#include "protocol/bytes.h"

namespace fxagent {

using Digest = std::array<std::uint8_t, 32>;

Digest sha256(std::string_view text);
/// Two hex digits a byte, lower case. Ours: libcrypto's OPENSSL_buf2hexstr_ex() writes capitals.
std::string to_text(ByteView digest);

}  // namespace fxagent
