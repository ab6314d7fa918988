// Paho requests the rest of a packet with recv() or SSL_read(), in one call with the whole length;
// nothing else in the program reads so much at once. The dynamic linker searches the program before
// its libraries, so these definitions replace the libraries' own.
#include "agent/uplink/paho/socket_calls.h"

#include <dlfcn.h>
#include <netdb.h>
#include <openssl/bio.h>
#include <openssl/err.h>
#include <openssl/ssl.h>
#include <openssl/x509v3.h>
#include <sys/socket.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <map>
#include <utility>

#include "agent/uplink/paho/incoming_packets.h"
#include "agent/uplink/paho/reading_thread.h"

namespace fxagent {
namespace {

using Clock = std::chrono::steady_clock;

// ---- faults of a connect ------------------------------------------------------------------------

// First byte of a TLS alert record. No packet that a broker sends begins with it.
constexpr unsigned char kTlsAlert = 0x15;

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

// ---- packets ------------------------------------------------------------------------------------

thread_local RefusedPacket refused_packet;
thread_local std::map<int, IncomingPackets> followed;  // by socket
thread_local int last_socket = -1;
thread_local Clock::time_point closed_at{};

IncomingPackets* packets_of(int fd) noexcept {
  const auto found = followed.find(fd);
  return found == followed.end() ? nullptr : &found->second;
}

bool is_refused(const IncomingPackets* packets, std::size_t bytes) noexcept {
  const std::size_t most = packets != nullptr ? packets->most() : kMaxPacketIn;
  if (bytes <= most) return false;
  refused_packet = {bytes, most};
  errno = EMSGSIZE;
  return true;
}

/// Starts to follow a connection that Paho has just made on this socket. Call on the thread that
/// reads it.
void follow_packets(int fd) noexcept {
  try {
    followed[fd] = {};
  } catch (...) {
    // Out of memory: only the limit of kMaxPacketIn applies.
  }
}

/// Limits reads on a TLS connection during its own lifetime: after `limit` bytes since the
/// beginning of the connection it counts as broken. A server may send TLS handshake data without
/// end, and OpenSSL does not return while more arrives. Paho holds its locks during the call, so
/// the agent could neither check a deadline nor abandon the server.
class TlsReadBound final {
 public:
  TlsReadBound(SSL* connection, std::uint64_t limit) noexcept
      : bio_(SSL_get_rbio(connection)), limit_(limit) {
    BIO_set_callback_arg(bio_, reinterpret_cast<char*>(this));
    BIO_set_callback_ex(bio_, before_read);
  }
  ~TlsReadBound() { BIO_set_callback_ex(bio_, nullptr); }
  TlsReadBound(const TlsReadBound&) = delete;
  TlsReadBound& operator=(const TlsReadBound&) = delete;

  bool was_reached() const noexcept { return reached_; }

 private:
  static long before_read(BIO* bio, int operation, const char*, std::size_t, int, long, int ret,
                          std::size_t*) noexcept {
    const auto* const bound = reinterpret_cast<const TlsReadBound*>(BIO_get_callback_arg(bio));
    if (operation != BIO_CB_READ || BIO_number_read(bio) < bound->limit_) return ret;
    bound->reached_ = true;
    BIO_clear_retry_flags(bio);
    return -1;
  }

  BIO* const bio_;
  const std::uint64_t limit_;
  mutable bool reached_ = false;  ///< set by before_read(), also of a const object
};

}  // namespace

ConnectFaults connect_faults(Clock::time_point begin) noexcept {
  return noted_at < begin ? ConnectFaults{} : faults;
}

bool paho_looks_up_host() noexcept { return paho_lookups > 0; }

RefusedPacket take_refused_packet() noexcept { return std::exchange(refused_packet, {}); }

int last_socket_read() noexcept { return last_socket; }

Clock::time_point last_closed_by_peer() noexcept { return closed_at; }

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
  const fxagent::TlsReadBound bound(connection, fxagent::kMaxHandshake);
  const int outcome = openssl_connect(connection);
  fxagent::faults.handshake_endless = bound.was_reached();
  fxagent::note_handshake(connection, outcome);
  return outcome;
}

ssize_t recv(int fd, void* buffer, std::size_t size, int flags) {
  fxagent::last_socket = fd;
  fxagent::IncomingPackets* const packets = fxagent::packets_of(fd);
  if (fxagent::is_refused(packets, size)) return -1;
  const ssize_t got = recvfrom(fd, buffer, size, flags, nullptr, nullptr);
  const bool was_reset = got < 0 && errno == ECONNRESET;
  if (was_reset) fxagent::faults.was_reset = true;
  if (got > 0 && *static_cast<const unsigned char*>(buffer) == fxagent::kTlsAlert)
    fxagent::faults.speaks_tls = true;
  if (was_reset || (got == 0 && size != 0)) fxagent::closed_at = std::chrono::steady_clock::now();
  if (got > 0 && packets != nullptr)
    packets->take(static_cast<unsigned char*>(buffer), size, static_cast<std::size_t>(got));
  return got;
}

int SSL_read(SSL* connection, void* buffer, int size) {
  using Read = int (*)(SSL*, void*, int);
  static const auto openssl_read = reinterpret_cast<Read>(dlsym(RTLD_NEXT, "SSL_read"));
  fxagent::last_socket = SSL_get_fd(connection);
  fxagent::IncomingPackets* const packets = fxagent::packets_of(fxagent::last_socket);
  const auto asked = static_cast<std::size_t>(std::max(size, 0));
  if (fxagent::is_refused(packets, asked)) return -1;
  const fxagent::TlsReadBound bound(
      connection, BIO_number_read(SSL_get_rbio(connection)) + fxagent::kMaxHandshake);
  const int got = openssl_read(connection, buffer, size);
  if (got > 0 && packets != nullptr)
    packets->take(static_cast<unsigned char*>(buffer), asked, static_cast<std::size_t>(got));
  return got;
}

}  // extern "C"
