// IP addresses in the config, and hosts that look like one. Asks no resolver. Any thread.
#pragma once

#include <string>
#include <string_view>

namespace fxagent {

/// True if the whole text is an IPv4 address of four decimal numbers without leading zeros.
bool is_ipv4(const std::string& text);
/// True if the whole text is an IPv6 address, without brackets.
bool is_ipv6(const std::string& text);

/// Returns the fault of a host that is a number and no IPv4 address of four decimal numbers; empty
/// if there is none. The system's resolver accepts 127.1 and 0x7f000001, and reads 010 as 8.
std::string_view number_fault(const std::string& host);

}  // namespace fxagent
