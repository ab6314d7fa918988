// The `serial`, `tcp` or `udp` of a link of the config file.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <string>

#include "agent/config/config.h"
#include "agent/config/reader.h"

namespace fxagent {

/// How characters travel on a line; what the file leaves open comes from the protocol on the link.
struct LineKeys {
  std::optional<std::int64_t> baud;
  std::optional<std::int64_t> data_bits;
  std::optional<Parity> parity;
  std::optional<std::int64_t> stop_bits;
};

/// Two links cannot hold one channel; the first one's place is remembered for the text.
using Channels = std::map<std::string, const ConfigNode*, std::less<>>;

/// Each reads what stands at `node`, in the link at `link`, into `config.channel`, and the keys of
/// its line into `line`. What is wrong goes to the reader.
void read_serial(ConfigReader& reader, const ConfigNode& link, const ConfigNode& node,
                 Channels& channels, LinkConfig& config, LineKeys& line);
void read_tcp(ConfigReader& reader, const ConfigNode& link, const ConfigNode& node,
              Channels& channels, LinkConfig& config, LineKeys& line);
void read_udp(ConfigReader& reader, const ConfigNode& link, const ConfigNode& node,
              Channels& channels, LinkConfig& config);

}  // namespace fxagent
