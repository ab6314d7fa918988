// SHA-256, by OpenSSL's libcrypto. Pure, any thread.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <string_view>

#include "protocol/value/bytes.h"

namespace fxagent {

using Digest = std::array<std::uint8_t, 32>;

Digest sha256(std::string_view text);
/// Returns two lower-case hex digits a byte. libcrypto's OPENSSL_buf2hexstr_ex() has upper case.
std::string to_text(ByteView bytes);
/// First 8 bytes of the digest, by which MQTT clients compare configs, documents and metas.
std::string short_hash(std::string_view text);

}  // namespace fxagent
