// Bounds what OpenSSL reads in one call. A server may send what belongs to the TLS handshake and no
// more as fast as it likes, and OpenSSL does not come back as long as something is there. Paho
// holds its locks meanwhile, so that nobody could look at a deadline or give the server up.
#pragma once

#include <openssl/types.h>

#include <cstdint>

namespace fxagent {

/// Far more than the longest handshake: OpenSSL takes 100 KiB of certificates.
inline constexpr std::uint64_t kMaxHandshake = 256 << 10;

/// For the calls about this connection while it lives: when kMaxHandshake more bytes have come, the
/// connection counts as broken.
class TlsReadBound final {
 public:
  enum class Counts : std::uint8_t { from_now, from_the_beginning };
  TlsReadBound(SSL* connection, Counts counts) noexcept;
  ~TlsReadBound();
  TlsReadBound(const TlsReadBound&) = delete;
  TlsReadBound& operator=(const TlsReadBound&) = delete;

  bool was_reached() const noexcept { return reached_; }

 private:
  static long before_read(BIO* bio, int operation, const char*, std::size_t, int, long, int ret,
                          std::size_t*) noexcept;

  BIO* const bio_;
  const std::uint64_t limit_;
  bool reached_ = false;
};

}  // namespace fxagent
