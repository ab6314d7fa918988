#include "agent/config/read/host.h"

#include <arpa/inet.h>

#include <cstdint>
#include <iterator>
#include <optional>

namespace fxagent {
namespace {

/// Returns an IP address, an IPv4 one as in `::ffff:192.0.2.10`; nullopt for a host name.
std::optional<in6_addr> parsed(const std::string& host) {
  in6_addr address{};
  const std::string text = (is_ipv4(host) ? "::ffff:" : "") + host;
  if (::inet_pton(AF_INET6, text.c_str(), &address) != 1) return std::nullopt;
  return address;
}

/// True for a multicast address, with or without its interface, and for 255.255.255.255.
bool is_group(const std::string& host) {
  const auto address = parsed(host.substr(0, host.find('%')));
  if (!address) return false;
  if (!IN6_IS_ADDR_V4MAPPED(&*address)) return IN6_IS_ADDR_MULTICAST(&*address);
  return address->s6_addr[12] >> 4 == 0xE ||
         parsed("255.255.255.255")->s6_addr32[3] == address->s6_addr32[3];
}

}  // namespace

bool is_ipv4(const std::string& text) {
  in_addr ignored{};
  return ::inet_pton(AF_INET, text.c_str(), &ignored) == 1;
}

bool is_ipv6(const std::string& text) {
  in6_addr ignored{};
  return ::inet_pton(AF_INET6, text.c_str(), &ignored) == 1;
}

std::string address_bytes(const std::string& host) {
  auto address = parsed(host);
  if (!address) return {};
  const std::uint8_t first = address->s6_addr[12];  // number of an IPv4 address
  const bool is_own = IN6_IS_ADDR_LOOPBACK(&*address) || IN6_IS_ADDR_UNSPECIFIED(&*address) ||
                      (IN6_IS_ADDR_V4MAPPED(&*address) && (first == 127 || first == 0));
  if (is_own) address = in6addr_loopback;
  return {std::begin(address->s6_addr), std::end(address->s6_addr)};
}

std::string_view host_fault(const std::string& host) {
  if (is_group(host)) return "is the address of a group of machines, and not of one";
  in_addr ignored{};
  const bool is_number = !host.empty() && (host.find_first_not_of("0123456789.") == host.npos ||
                                           ::inet_aton(host.c_str(), &ignored) != 0);
  if (!is_number || is_ipv4(host)) return {};
  return "is no IPv4 address: it needs four numbers from 0 to 255 without leading zeros, as in "
         "192.0.2.10";
}

}  // namespace fxagent
