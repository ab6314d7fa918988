// Paho asks for the rest of a packet in one call, recv() or SSL_read(), with its whole length. Both
// names are defined here and win over the libraries' own, since the program comes first when a
// shared library looks for a function. Nothing else in the program reads so much at once.
#include "agent/uplink/packet_guard.h"

#include <dlfcn.h>
#include <openssl/ssl.h>
#include <sys/socket.h>

#include <cerrno>
#include <utility>

#include "agent/uplink/connect_faults.h"

namespace fxagent {
namespace {

thread_local std::size_t refused_bytes = 0;
thread_local int last_socket = -1;
thread_local std::chrono::steady_clock::time_point closed_at{};

bool is_refused(std::size_t bytes) noexcept {
  if (bytes <= kMaxPacketIn) return false;
  refused_bytes = bytes;
  errno = EMSGSIZE;
  return true;
}

}  // namespace

std::size_t take_refused_packet() noexcept { return std::exchange(refused_bytes, 0); }

int last_socket_read() noexcept { return last_socket; }

std::chrono::steady_clock::time_point last_closed_by_peer() noexcept { return closed_at; }

}  // namespace fxagent

extern "C" {

ssize_t recv(int fd, void* buffer, std::size_t size, int flags) {
  fxagent::last_socket = fd;
  if (fxagent::is_refused(size)) return -1;
  const ssize_t got = recvfrom(fd, buffer, size, flags, nullptr, nullptr);
  fxagent::note_received(got > 0 ? *static_cast<const unsigned char*>(buffer) : -1,
                         got < 0 ? errno : 0);
  if ((got == 0 && size != 0) || (got < 0 && errno == ECONNRESET))
    fxagent::closed_at = std::chrono::steady_clock::now();
  return got;
}

int SSL_read(SSL* connection, void* buffer, int size) {
  using Read = int (*)(SSL*, void*, int);
  static const auto openssl_read = reinterpret_cast<Read>(dlsym(RTLD_NEXT, "SSL_read"));
  fxagent::last_socket = SSL_get_fd(connection);
  if (size > 0 && fxagent::is_refused(static_cast<std::size_t>(size))) return -1;
  return openssl_read(connection, buffer, size);
}

}  // extern "C"
