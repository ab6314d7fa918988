// Interposes the calls by which Paho resolves a host, connects, does the TLS handshake and reads.
//
// Records why a connect fails. Paho reduces all reasons to one number, which does not distinguish a
// closed port from an unknown name or an untrusted certificate.
//
// Rejects packets that no broker should send: Paho 1.3 reads the length of a packet and then all of
// it into memory, up to 250 MB several times over, before it calls back. The limits are in
// incoming_packets.h. Also bounds what OpenSSL reads in one call, and reports which socket is the
// broker's, which Paho hides.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>

namespace fxagent {

/// Limit in bytes. Far more than the longest handshake: OpenSSL accepts 100 KiB of certificates.
inline constexpr std::uint64_t kMaxHandshake = 256 << 10;

/// Results recorded on this thread for a connection to a server. Paho calls back on the thread that
/// made the last of these calls.
struct ConnectFaults {
  int lookup = 0;                  ///< of getaddrinfo(); 0: the host was found, or not looked up
  int socket = 0;                  ///< errno of the TCP connect; 0: no error
  bool handshake_cut = false;      ///< the server ended the TLS handshake, or does not use TLS
  bool handshake_endless = false;  ///< the server sent more than kMaxHandshake bytes
  long certificate = 0;            ///< X509_V_... why the certificate is not trusted; 0: it is
  bool is_encrypted = false;       ///< the TLS handshake is complete
  bool other_host = false;         ///< the certificate is not valid for the requested host
  bool was_reset = false;          ///< without TLS: the server reset the connection
  bool speaks_tls = false;         ///< without TLS: the server answered with a TLS alert
};

/// Returns the results recorded since `begin`; ignores older ones.
ConnectFaults connect_faults(std::chrono::steady_clock::time_point begin) noexcept;

/// True while a Paho thread resolves a host name. The system's resolver may take any time, and the
/// thread holds a lock for which Paho's other threads wait. Any thread.
bool paho_looks_up_host() noexcept;

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

/// Returns when a peer last closed a plain connection that this thread read; the epoch: never.
std::chrono::steady_clock::time_point last_closed_by_peer() noexcept;

}  // namespace fxagent
