// Bounds what OpenSSL reads in one call. A server may send TLS handshake data without end, and
// OpenSSL does not return while more arrives. Paho holds its locks during the call, so the agent
// could neither check a deadline nor abandon the server.
#pragma once

#include <openssl/types.h>

#include <cstdint>

namespace fxagent {

/// Limit in bytes. Far more than the longest handshake: OpenSSL accepts 100 KiB of certificates.
inline constexpr std::uint64_t kMaxHandshake = 256 << 10;

/// Limits reads on this connection during its own lifetime. After kMaxHandshake bytes, counted from
/// now or from the beginning of the connection, the connection counts as broken.
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
