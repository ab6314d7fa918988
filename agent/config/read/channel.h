// Reads `serial`, `tcp` or `udp` of a link of the config file.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <string>

#include "agent/config/config.h"
#include "agent/config/read/reader.h"

namespace fxagent {

/// Speed and character format of a line. The protocol on the link supplies missing values.
struct LineKeys {
  std::optional<std::int64_t> baud;
  std::optional<std::int64_t> data_bits;
  std::optional<Parity> parity;
  std::optional<std::int64_t> stop_bits;
};

/// Channels in use, with the node of their first use: two links cannot share a channel.
using Channels = std::map<std::string, const ConfigNode*, std::less<>>;

/// Each reads the channel at `node`, a member of the link at `link`, into `config.channel`, and the
/// keys of its line into `line`. Reports faults to `reader`.
void read_serial(ConfigReader& reader, const ConfigNode& link, const ConfigNode& node,
                 Channels& channels, LinkConfig& config, LineKeys& line);
void read_tcp(ConfigReader& reader, const ConfigNode& link, const ConfigNode& node,
              Channels& channels, LinkConfig& config, LineKeys& line);
void read_udp(ConfigReader& reader, const ConfigNode& link, const ConfigNode& node,
              Channels& channels, LinkConfig& config);

}  // namespace fxagent
