#include "agent/http/listening_socket.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <cerrno>
#include <system_error>

namespace fxagent {
namespace {

// Connections that wait to be accepted.
constexpr int kBacklog = 64;

/// Casts an address to the type that the socket calls take.
template <class Address>
sockaddr* as_any(Address& address) {
  return reinterpret_cast<sockaddr*>(&address);
}

int new_socket(int family) {
  return ::socket(family, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
}

/// True if a program still accepts connections there. A file left by a dead one refuses them.
bool is_served(sockaddr_un& address) {
  const FileHandle probe(new_socket(AF_UNIX));
  return probe < 0 || ::connect(probe, as_any(address), sizeof address) == 0 ||
         errno != ECONNREFUSED;
}

bool is_socket(const std::string& path) {
  struct stat file {};
  return ::lstat(path.c_str(), &file) == 0 && S_ISSOCK(file.st_mode);
}

std::string cure_of(int error) {
  switch (error) {
    case EADDRINUSE:
      return "; another program uses this address: end it, or set another address in `listen`";
    case EADDRNOTAVAIL:
      return "; this machine does not have this address now: set one of its own in `listen`";
    case EACCES:
    case EPERM:
      return "; the agent's user may not use it: set a port from 1024, or a directory that the "
             "agent may write to";
    case ENOENT:
      return "; create the directory, or let systemd create it (RuntimeDirectory=fxagent)";
    default:
      return {};
  }
}

tl::unexpected<Error> refused(const std::string& address, int error) {
  return fail(ErrorCode::link_down,
              address + ": " + std::generic_category().message(error) + cure_of(error));
}

}  // namespace

Result<ListeningSocket> ListeningSocket::open(const HttpConfig& config) {
  return config.unix_path.empty() ? open_tcp(config) : open_unix(config.unix_path);
}

Result<ListeningSocket> ListeningSocket::open_unix(const std::string& path) {
  const std::string name = "unix:" + path;
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  path.copy(address.sun_path, sizeof address.sun_path - 1);
  ListeningSocket made(new_socket(AF_UNIX));
  if (made.file_ < 0) return refused(name, errno);
  int error = ::bind(made.file_, as_any(address), sizeof address) == 0 ? 0 : errno;
  if (error == EADDRINUSE && is_socket(path) && !is_served(address)) {
    ::unlink(path.c_str());
    error = ::bind(made.file_, as_any(address), sizeof address) == 0 ? 0 : errno;
  }
  if (error != 0) return refused(name, error);
  made.path_ = path;
  // Only the agent's user and group may connect.
  if (::chmod(path.c_str(), S_IRUSR | S_IWUSR | S_IRGRP | S_IWGRP) != 0 ||
      ::listen(made.file_, kBacklog) != 0)
    return refused(name, errno);
  made.address_ = name;
  return made;
}

Result<ListeningSocket> ListeningSocket::open_tcp(const HttpConfig& config) {
  const bool is_ipv6 = config.address.find(':') != config.address.npos;
  const std::string host = is_ipv6 ? "[" + config.address + "]" : config.address;
  const auto named = [&](in_port_t port) { return host + ":" + std::to_string(ntohs(port)); };
  sockaddr_in ipv4{};
  sockaddr_in6 ipv6{};
  ipv4.sin_family = AF_INET;
  ipv6.sin6_family = AF_INET6;
  in_port_t& port = is_ipv6 ? ipv6.sin6_port : ipv4.sin_port;
  port = htons(config.port);
  if (is_ipv6)
    ::inet_pton(AF_INET6, config.address.c_str(), &ipv6.sin6_addr);
  else
    ::inet_pton(AF_INET, config.address.c_str(), &ipv4.sin_addr);
  sockaddr* const address = is_ipv6 ? as_any(ipv6) : as_any(ipv4);
  socklen_t size = is_ipv6 ? sizeof ipv6 : sizeof ipv4;

  ListeningSocket made(new_socket(is_ipv6 ? AF_INET6 : AF_INET));
  if (made.file_ < 0) return refused(host, errno);
  const int on = 1;
  // Connections of the previous process may still be closing after a restart.
  ::setsockopt(made.file_, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
  if (is_ipv6) ::setsockopt(made.file_, IPPROTO_IPV6, IPV6_V6ONLY, &on, sizeof on);
  if (::bind(made.file_, address, size) != 0 || ::listen(made.file_, kBacklog) != 0 ||
      ::getsockname(made.file_, address, &size) != 0) {
    const int error = errno;
    return refused(named(port), error);
  }
  made.address_ = named(port);
  return made;
}

void ListeningSocket::remove_path() {
  if (!path_.empty()) ::unlink(path_.c_str());
  path_.clear();
}

}  // namespace fxagent
