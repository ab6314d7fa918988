#include "agent/sha256.h"

#include <openssl/evp.h>

#include <stdexcept>

namespace fxagent {

Digest sha256(std::string_view text) {
  Digest digest{};
  unsigned int size = 0;
  if (EVP_Digest(text.data(), text.size(), digest.data(), &size, EVP_sha256(), nullptr) != 1 ||
      size != digest.size())
    throw std::runtime_error("libcrypto has no SHA-256");
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

}  // namespace fxagent
