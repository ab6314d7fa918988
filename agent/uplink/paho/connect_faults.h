// Interposes the calls by which Paho resolves a host, reads the outcome of a connect and performs
// the TLS handshake, and records their results. Paho reduces them all to one number, which does not
// distinguish a closed port from an unknown name or an untrusted certificate.
#pragma once

#include <chrono>
#include <string>

namespace fxagent {

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

/// Records a recv() without TLS on this thread: its first byte, or -1 and errno. Called by
/// packet_guard, which interposes recv().
void note_received(int first_byte, int error) noexcept;

}  // namespace fxagent
