// Interposes getaddrinfo(), getsockopt() and SSL_connect(). The dynamic linker searches the program
// before its libraries, so these definitions replace the libraries' own.
#include "agent/uplink/paho/connect_faults.h"

#include <dlfcn.h>
#include <netdb.h>
#include <openssl/err.h>
#include <openssl/ssl.h>
#include <openssl/x509v3.h>
#include <sys/socket.h>

#include <atomic>
#include <cerrno>

#include "agent/uplink/paho/packet_guard.h"
#include "agent/uplink/paho/reading_thread.h"

namespace fxagent {
namespace {

using Clock = std::chrono::steady_clock;

// First byte of a TLS alert record. No packet that a broker sends begins with it.
constexpr int kTlsAlert = 0x15;

thread_local ConnectFaults faults;
thread_local Clock::time_point noted_at{};
std::atomic<int> paho_lookups = 0;  // calls of getaddrinfo() in progress

/// Resets the record, so that nothing of an earlier attempt remains.
void begin_anew() noexcept {
  faults = {};
  noted_at = Clock::now();
}

/// True if the certificate is not valid for the requested host. Paho checks this itself after the
/// handshake, but does not report the result.
bool is_for_another_host(SSL* connection) noexcept {
  const char* const host = SSL_get_servername(connection, TLSEXT_NAMETYPE_host_name);
  X509* const certificate = SSL_get1_peer_certificate(connection);
  const bool is_other = host != nullptr && certificate != nullptr &&
                        X509_check_host(certificate, host, 0, 0, nullptr) != 1 &&
                        X509_check_ip_asc(certificate, host, 0) != 1;
  X509_free(certificate);
  return is_other;
}

void note_handshake(SSL* connection, int outcome) noexcept {
  if (outcome == 1) {
    faults.is_encrypted = true;
    faults.other_host = is_for_another_host(connection);
    return;
  }
  const int fault = SSL_get_error(connection, outcome);
  if (fault == SSL_ERROR_WANT_READ || fault == SSL_ERROR_WANT_WRITE) return;
  faults.certificate = SSL_get_verify_result(connection);
  const unsigned long code = ERR_peek_error();
  const int reason = ERR_GET_LIB(code) == ERR_LIB_SSL ? ERR_GET_REASON(code) : 0;
  faults.handshake_cut = fault == SSL_ERROR_SYSCALL ||
                         reason == SSL_R_UNEXPECTED_EOF_WHILE_READING ||
                         reason == SSL_R_WRONG_VERSION_NUMBER;
}

}  // namespace

ConnectFaults connect_faults(Clock::time_point begin) noexcept {
  return noted_at < begin ? ConnectFaults{} : faults;
}

bool paho_looks_up_host() noexcept { return paho_lookups > 0; }

void note_received(int first_byte, int error) noexcept {
  if (error == ECONNRESET) faults.was_reset = true;
  if (first_byte == kTlsAlert) faults.speaks_tls = true;
}

}  // namespace fxagent

extern "C" {

int getaddrinfo(const char* host, const char* service, const addrinfo* hints, addrinfo** found) {
  using LookUp = int (*)(const char*, const char*, const addrinfo*, addrinfo**);
  static const auto look_up = reinterpret_cast<LookUp>(dlsym(RTLD_NEXT, "getaddrinfo"));
  const bool counts = fxagent::is_paho_thread();
  if (counts) ++fxagent::paho_lookups;
  const int fault = look_up(host, service, hints, found);
  if (counts) --fxagent::paho_lookups;
  fxagent::begin_anew();
  fxagent::faults.lookup = fault;
  return fault;
}

// Defined by the name of the symbol: on a 32-bit processor with a 64-bit time_t the header's
// `getsockopt` is a different function, which Paho does not call.
int getsockopt_of_paho(int fd, int level, int name, void* value, socklen_t* size) noexcept
    __asm__("getsockopt");

int getsockopt_of_paho(int fd, int level, int name, void* value, socklen_t* size) noexcept {
  using Ask = int (*)(int, int, int, void*, socklen_t*);
  static const auto ask = reinterpret_cast<Ask>(dlsym(RTLD_NEXT, "getsockopt"));
  const int outcome = ask(fd, level, name, value, size);
  if (level == SOL_SOCKET && name == SO_ERROR && outcome == 0) {
    fxagent::begin_anew();
    fxagent::faults.socket = *static_cast<const int*>(value);
    if (fxagent::is_paho_thread()) {
      fxagent::note_connect_outcome(fd);
      fxagent::follow_packets(fd);
    }
  }
  return outcome;
}

int SSL_connect(SSL* connection) {
  using Connect = int (*)(SSL*);
  static const auto openssl_connect = reinterpret_cast<Connect>(dlsym(RTLD_NEXT, "SSL_connect"));
  const fxagent::TlsReadBound bound(connection, fxagent::TlsReadBound::Counts::from_the_beginning);
  const int outcome = openssl_connect(connection);
  fxagent::faults.handshake_endless = bound.was_reached();
  fxagent::note_handshake(connection, outcome);
  return outcome;
}

}  // extern "C"
