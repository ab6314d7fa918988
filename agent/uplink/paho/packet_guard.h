// Interposes Paho's reads from its sockets. Rejects packets that no broker should send: Paho 1.3
// reads the length of a packet and then all of it into memory, up to 250 MB several times over,
// before it calls back. The limits are in incoming_packets.h. Also bounds what OpenSSL reads in one
// call, and reports which socket is the broker's, which Paho hides.
#pragma once

#include <openssl/types.h>

#include <chrono>
#include <cstddef>
#include <cstdint>

namespace fxagent {

/// Starts to follow a connection that Paho has just made on this socket. Call on the thread that
/// reads it.
void follow_packets(int fd) noexcept;

/// A packet that was rejected unread.
struct RefusedPacket {
  std::size_t bytes = 0;  ///< 0: none was rejected
  std::size_t most = 0;   ///< allowed; 0: no message, because CONNACK had not arrived
};

/// Returns the packet rejected on this thread since the last call. Its connection is over: Paho
/// gets a socket error, and calls back on the same thread.
RefusedPacket take_refused_packet() noexcept;

/// Returns the socket that this thread last read from, with or without TLS; -1: none yet. In a Paho
/// callback about a packet it is the socket that received the packet, because Paho calls back on
/// the thread that has just read it.
int last_socket_read() noexcept;

/// Returns when a peer last closed a connection without TLS that this thread read from; the epoch:
/// never.
std::chrono::steady_clock::time_point last_closed_by_peer() noexcept;

/// Limit in bytes. Far more than the longest handshake: OpenSSL accepts 100 KiB of certificates.
inline constexpr std::uint64_t kMaxHandshake = 256 << 10;

/// Limits reads on a TLS connection during its own lifetime. After kMaxHandshake bytes, counted
/// from now or from the beginning of the connection, the connection counts as broken. A server may
/// send TLS handshake data without end, and OpenSSL does not return while more arrives. Paho holds
/// its locks during the call, so the agent could neither check a deadline nor abandon the server.
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
