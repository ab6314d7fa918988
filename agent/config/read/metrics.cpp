#include "agent/config/read/metrics.h"

#include <arpa/inet.h>
#include <sys/un.h>

#include <array>
#include <charconv>
#include <string>
#include <string_view>
#include <tl/expected.hpp>

#include "agent/config/keys.h"

namespace fxagent {
namespace {

constexpr std::string_view kListenForms =
    "must be an address and a port, as in 127.0.0.1:9464 or [::1]:9464, or a path, as in "
    "unix:/run/fxagent/metrics";

bool is_address(int family, const std::string& text) {
  std::array<unsigned char, sizeof(in6_addr)> bytes{};
  return ::inet_pton(family, text.c_str(), bytes.data()) == 1;
}

std::optional<std::uint16_t> port_of(std::string_view text) {
  std::uint16_t port = 0;
  const auto [end, fault] = std::from_chars(text.data(), text.data() + text.size(), port);
  if (fault != std::errc() || end != text.data() + text.size()) return std::nullopt;
  return port;
}

tl::expected<MetricsConfig, std::string> unix_listen(std::string_view path) {
  if (!path.starts_with('/'))
    return tl::unexpected(std::string("needs the whole path, as in unix:/run/fxagent/metrics"));
  if (path.size() >= sizeof(sockaddr_un::sun_path))
    return tl::unexpected("has a path of " + std::to_string(path.size()) +
                          " bytes; the path of a socket may have at most " +
                          std::to_string(sizeof(sockaddr_un::sun_path) - 1));
  MetricsConfig config;
  config.unix_path = path;
  return config;
}

tl::expected<MetricsConfig, std::string> listen_of(std::string_view text) {
  constexpr std::string_view scheme = "unix:";
  if (text.starts_with(scheme)) return unix_listen(text.substr(scheme.size()));
  const std::size_t colon = text.rfind(':');
  const bool in_brackets = text.starts_with('[');
  if (colon == text.npos || (in_brackets && (colon < 3 || text[colon - 1] != ']')))
    return tl::unexpected(std::string(kListenForms));
  MetricsConfig config;
  config.address = in_brackets ? text.substr(1, colon - 2) : text.substr(0, colon);
  const auto port = port_of(text.substr(colon + 1));
  if (!port) return tl::unexpected(std::string("needs a port from 0 to 65535 after the address"));
  config.port = *port;
  if (config.address.empty())
    return tl::unexpected(
        std::string("needs an address before the port: 127.0.0.1 for this machine only, 0.0.0.0 "
                    "for every network"));
  if (config.address == "localhost") config.address = "127.0.0.1";
  if (!is_address(in_brackets ? AF_INET6 : AF_INET, config.address))
    return tl::unexpected(std::string(kListenForms) + "; a host name is not possible here");
  return config;
}

bool is_loopback(const MetricsConfig& config) {
  return !config.unix_path.empty() || config.address.starts_with("127.") || config.address == "::1";
}

}  // namespace

std::optional<MetricsConfig> read_metrics(ConfigReader& reader, const ConfigNode& node) {
  reader.check_object(node, config_section("metrics"));
  const auto text = reader.text(node, config_key("metrics.listen"));
  if (!text) return std::nullopt;
  const ConfigNode& at = *node.find("listen");
  const auto config = listen_of(*text);
  if (!config) {
    reader.error(at, config.error());
    return std::nullopt;
  }
  if (!is_loopback(*config))
    reader.warn(at,
                "other machines can reach this address, and metrics have neither a password nor "
                "TLS: 127.0.0.1 limits them to this machine");
  return *config;
}

}  // namespace fxagent
