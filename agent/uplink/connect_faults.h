// Stands where Paho looks up a host, asks for the outcome of a connect and shakes hands by TLS, and
// keeps what it is told. Paho makes one number of all of it, so that nobody could say whether a
// port is closed, a name unknown or a certificate not trusted.
#pragma once

#include <chrono>
#include <string>

namespace fxagent {

/// What this thread was told about a connection to a server. Paho calls back on the thread that was
/// told last.
struct ConnectFaults {
  int lookup = 0;                  ///< of getaddrinfo(); 0: the host is known, or was not asked for
  int socket = 0;                  ///< errno of the TCP connection; 0: none
  bool handshake_cut = false;      ///< the server ended the TLS handshake, or spoke no TLS
  bool handshake_endless = false;  ///< the server sent more than any handshake takes
  long certificate = 0;            ///< X509_V_... why the certificate is not trusted; 0: it is
  bool is_encrypted = false;       ///< the TLS handshake is done
  bool other_host = false;         ///< with a certificate that is not for the host asked for
  bool was_reset = false;          ///< the server threw away what was sent, without TLS
  bool speaks_tls = false;         ///< it answered with a TLS alert, without TLS
};

/// Since `begin`; what is older counts as nothing.
ConnectFaults connect_faults(std::chrono::steady_clock::time_point begin) noexcept;

/// Whether a thread of Paho's waits for the name of a host now: as long as the system's resolver
/// likes, and under a lock for which Paho's other threads wait. Any thread.
bool paho_looks_up_host() noexcept;

/// Of a recv() without TLS on this thread: its first byte, or -1 and errno. For packet_guard, which
/// stands there.
void note_received(int first_byte, int error) noexcept;

}  // namespace fxagent
