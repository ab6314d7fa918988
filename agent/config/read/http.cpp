#include "agent/config/read/sections.h"

#include <sys/un.h>

#include <string>
#include <string_view>
#include <tl/expected.hpp>

#include "agent/config/keys.h"
#include "agent/config/read/host.h"
#include "agent/text/text.h"

namespace fxagent {
namespace {

constexpr std::string_view kListenForms =
    "must be an address and a port, as in 127.0.0.1:9464 or [::1]:9464, or a path, as in "
    "unix:/run/fxagent/metrics";

tl::expected<HttpConfig, std::string> unix_listen(std::string_view path) {
  if (!path.starts_with('/'))
    return tl::unexpected(std::string("needs the whole path, as in unix:/run/fxagent/metrics"));
  if (path.size() >= sizeof(sockaddr_un::sun_path))
    return tl::unexpected("has a path of " + std::to_string(path.size()) +
                          " bytes; the path of a socket may have at most " +
                          std::to_string(sizeof(sockaddr_un::sun_path) - 1));
  HttpConfig config;
  config.unix_path = path;
  return config;
}

tl::expected<HttpConfig, std::string> listen_of(std::string_view text) {
  constexpr std::string_view scheme = "unix:";
  if (text.starts_with(scheme)) return unix_listen(text.substr(scheme.size()));
  const std::size_t colon = text.rfind(':');
  const bool in_brackets = text.starts_with('[');
  if (colon == text.npos || (in_brackets && (colon < 3 || text[colon - 1] != ']')))
    return tl::unexpected(std::string(kListenForms));
  HttpConfig config;
  config.address = in_brackets ? text.substr(1, colon - 2) : text.substr(0, colon);
  const auto port = number_from<std::uint16_t>(text.substr(colon + 1));
  if (!port) return tl::unexpected(std::string("needs a port from 0 to 65535 after the address"));
  config.port = *port;
  if (config.address.empty())
    return tl::unexpected(
        std::string("needs an address before the port: 127.0.0.1 for this machine only, 0.0.0.0 "
                    "for every network"));
  if (config.address == "localhost") config.address = "127.0.0.1";
  if (!(in_brackets ? is_ipv6(config.address) : is_ipv4(config.address)))
    return tl::unexpected(std::string(kListenForms) + "; a host name is not possible here");
  return config;
}

bool is_loopback(const HttpConfig& config) {
  return !config.unix_path.empty() || config.address.starts_with("127.") || config.address == "::1";
}

/// Reads the names by which browsers may call the page.
std::vector<std::string> read_hosts(ConfigReader& reader, const ConfigNode& node) {
  std::vector<std::string> hosts;
  const ConfigNode* list = reader.array(node, "http.hosts");
  if (list == nullptr) return hosts;
  for (const ConfigNode& item : list->children) {
    const auto host = reader.text(item);
    if (!host) continue;
    if (host->empty() || host->find_first_of("/: \t") != host->npos)
      reader.error(item,
                   "must be a name alone, without scheme and port, as in edge7.plant.example");
    else
      hosts.push_back(*host);
  }
  return hosts;
}

/// Reads `listen` of the section at `node`; `key` is its key.
std::optional<HttpConfig> read_listen(ConfigReader& reader, const ConfigNode& node, KeyRef key,
                                      std::string_view open_to_all) {
  const auto text = reader.text(node, key);
  if (!text) return std::nullopt;
  const ConfigNode& at = *node.find("listen");
  const auto config = listen_of(*text);
  if (!config) {
    reader.error(at, config.error());
    return std::nullopt;
  }
  if (!is_loopback(*config))
    reader.warn(at, "other machines can reach this address, and " + std::string(open_to_all) +
                        " neither a password nor TLS: 127.0.0.1 limits them to this machine");
  return *config;
}

}  // namespace

std::optional<HttpConfig> read_http(ConfigReader& reader, const ConfigNode& top) {
  const ConfigNode* page = reader.object(top, "http");
  const ConfigNode* metrics = reader.object(top, "metrics");
  if (page == nullptr)
    return metrics == nullptr ? std::nullopt
                              : read_listen(reader, *metrics, "metrics.listen", "metrics have");
  if (metrics != nullptr)
    reader.error(*metrics,
                 "stands beside \"http\", which serves the metrics, too: remove this one");
  auto config = read_listen(reader, *page, "http.listen", "the page and the metrics have");
  const auto hosts = read_hosts(reader, *page);
  const auto token_file = reader.text(*page, "http.token_file");
  if (!config) return std::nullopt;
  if (token_file && !is_loopback(*config))
    reader.error(
        *page->find("token_file"),
        "needs a listen address that no other machine can reach, such as 127.0.0.1:8080 or "
        "a Unix socket, and a proxy with TLS before it: a token must not travel in plain "
        "text");
  config->token_file = token_file.value_or("");
  config->page = true;
  config->hosts = hosts;
  return config;
}

}  // namespace fxagent
