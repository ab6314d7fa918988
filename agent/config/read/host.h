// IP addresses in the config, and hosts that look like one. Asks no resolver. Any thread.
#pragma once

#include <string>
#include <string_view>

namespace fxagent {

/// True if the whole text is an IPv4 address of four decimal numbers without leading zeros.
bool is_ipv4(const std::string& text);
/// True if the whole text is an IPv6 address, without brackets.
bool is_ipv6(const std::string& text);

/// Returns the 16 bytes of an IP address, an IPv4 one as in `::ffff:192.0.2.10`; empty for a host
/// name. Every address of the machine itself is the same: 127.0.0.0/8, `::1`, 0.0.0.0 and `::`.
std::string address_bytes(const std::string& host);

/// Returns the fault of the host of a link; empty if there is none:
/// - A number that is no IPv4 address of four decimal numbers. The system's resolver accepts 127.1
///   and 0x7f000001, and reads 010 as 8.
/// - A multicast address, or 255.255.255.255: every machine there would obey a write.
std::string_view host_fault(const std::string& host);

}  // namespace fxagent
