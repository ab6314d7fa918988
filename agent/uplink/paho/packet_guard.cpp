// Interposes recv() and SSL_read(). Paho requests the rest of a packet with one of them, in one
// call with the whole length; nothing else in the program reads so much at once. The dynamic linker
// searches the program before its libraries, so these definitions replace the libraries' own.
#include "agent/uplink/paho/packet_guard.h"

#include <dlfcn.h>
#include <openssl/bio.h>
#include <openssl/ssl.h>
#include <sys/socket.h>

#include <algorithm>
#include <cerrno>
#include <map>
#include <utility>

#include "agent/uplink/paho/connect_faults.h"
#include "agent/uplink/paho/incoming_packets.h"

namespace fxagent {
namespace {

thread_local RefusedPacket refused_packet;
thread_local std::map<int, IncomingPackets> followed;  // by socket
thread_local int last_socket = -1;
thread_local std::chrono::steady_clock::time_point closed_at{};

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

void note_read(IncomingPackets* packets, void* buffer, std::size_t asked,
               std::size_t got) noexcept {
  if (packets != nullptr) packets->take(static_cast<unsigned char*>(buffer), asked, got);
}

}  // namespace

void follow_packets(int fd) noexcept {
  try {
    followed[fd] = {};
  } catch (...) {
    // Out of memory: only the limit of kMaxPacketIn applies.
  }
}

RefusedPacket take_refused_packet() noexcept { return std::exchange(refused_packet, {}); }

int last_socket_read() noexcept { return last_socket; }

std::chrono::steady_clock::time_point last_closed_by_peer() noexcept { return closed_at; }

TlsReadBound::TlsReadBound(SSL* connection, Counts counts) noexcept
    : bio_(SSL_get_rbio(connection)),
      limit_((counts == Counts::from_now ? BIO_number_read(bio_) : 0) + kMaxHandshake) {
  BIO_set_callback_arg(bio_, reinterpret_cast<char*>(this));
  BIO_set_callback_ex(bio_, before_read);
}

TlsReadBound::~TlsReadBound() { BIO_set_callback_ex(bio_, nullptr); }

long TlsReadBound::before_read(BIO* bio, int operation, const char*, std::size_t, int, long,
                               int ret, std::size_t*) noexcept {
  auto* const bound = reinterpret_cast<TlsReadBound*>(BIO_get_callback_arg(bio));
  if (operation != BIO_CB_READ || BIO_number_read(bio) < bound->limit_) return ret;
  bound->reached_ = true;
  BIO_clear_retry_flags(bio);
  return -1;
}

}  // namespace fxagent

extern "C" {

ssize_t recv(int fd, void* buffer, std::size_t size, int flags) {
  fxagent::last_socket = fd;
  fxagent::IncomingPackets* const packets = fxagent::packets_of(fd);
  if (fxagent::is_refused(packets, size)) return -1;
  const ssize_t got = recvfrom(fd, buffer, size, flags, nullptr, nullptr);
  fxagent::note_received(got > 0 ? *static_cast<const unsigned char*>(buffer) : -1,
                         got < 0 ? errno : 0);
  if ((got == 0 && size != 0) || (got < 0 && errno == ECONNRESET))
    fxagent::closed_at = std::chrono::steady_clock::now();
  if (got > 0) fxagent::note_read(packets, buffer, size, static_cast<std::size_t>(got));
  return got;
}

int SSL_read(SSL* connection, void* buffer, int size) {
  using Read = int (*)(SSL*, void*, int);
  static const auto openssl_read = reinterpret_cast<Read>(dlsym(RTLD_NEXT, "SSL_read"));
  fxagent::last_socket = SSL_get_fd(connection);
  fxagent::IncomingPackets* const packets = fxagent::packets_of(fxagent::last_socket);
  const auto asked = static_cast<std::size_t>(std::max(size, 0));
  if (fxagent::is_refused(packets, asked)) return -1;
  const fxagent::TlsReadBound bound(connection, fxagent::TlsReadBound::Counts::from_now);
  const int got = openssl_read(connection, buffer, size);
  if (got > 0) fxagent::note_read(packets, buffer, asked, static_cast<std::size_t>(got));
  return got;
}

}  // extern "C"
