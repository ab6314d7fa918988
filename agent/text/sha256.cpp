#include "agent/text/sha256.h"

// Uses libcrypto's old interface: the new one loads its providers first, which costs 1.5 MiB of
// memory.
#define OPENSSL_SUPPRESS_DEPRECATED
#include <openssl/sha.h>

namespace fxagent {

Digest sha256(std::string_view text) {
  Digest digest{};
  static_assert(digest.size() == SHA256_DIGEST_LENGTH);
  SHA256_CTX state;
  SHA256_Init(&state);
  SHA256_Update(&state, text.data(), text.size());
  SHA256_Final(digest.data(), &state);
  return digest;
}

std::string to_text(ByteView digest) {
  constexpr std::string_view hex = "0123456789abcdef";
  std::string out;
  for (const std::uint8_t byte : digest) {
    out += hex[byte >> 4];
    out += hex[byte & 0x0F];
  }
  return out;
}

std::string short_hash(std::string_view text) { return to_text(ByteView(sha256(text)).first(8)); }

}  // namespace fxagent
