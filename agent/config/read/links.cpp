#include "agent/config/read/sections.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdint>
#include <string>
#include <string_view>

#include "agent/config/keys.h"
#include "agent/config/read/devices/templates.h"
#include "agent/config/read/host.h"

namespace fxagent {
namespace {

using std::string_view_literals::operator""sv;

constexpr int kEightBits = 8;

/// Channels in use, with the node of their first use: two links cannot share a channel.
using Channels = std::map<std::string, const ConfigNode*, std::less<>>;

Rs485 read_rs485(ConfigReader& reader, const ConfigNode& node) {
  Rs485 direction;
  direction.rts_on_send = reader.boolean(node, "links[].serial.rs485.rts_on_send");
  reader.set_integer(direction.delay_before, node, "links[].serial.rs485.delay_before_ms");
  reader.set_integer(direction.delay_after, node, "links[].serial.rs485.delay_after_ms");
  return direction;
}

/// Warns if another link goes to the same host and port.
void warn_of_second(ConfigReader& reader, const ConfigNode& link, const ConfigNode& node,
                    const std::string& place, Channels& channels) {
  const auto [first, fresh] = channels.emplace(place, &link);
  if (fresh) return;
  const auto called = [](const ConfigNode& each) {
    const ConfigNode* name = each.find("name");
    return name != nullptr ? "\"" + std::string(name->text) + "\"" : std::string("a link");
  };
  reader.warn(node, called(link) + " has the same host and port as " + called(*first->second) +
                        " at " + reader.place_of(*first->second) +
                        "; many devices and serial servers accept only one connection: put the "
                        "devices of both on one link");
}

/// Reads `host` and `port` of the `tcp` or `udp` at `node`.
template <class Settings>
void read_place(ConfigReader& reader, const ConfigNode& link, const ConfigNode& node, KeyRef host,
                KeyRef port, std::string_view kind, Channels& channels, Settings& settings) {
  settings.host = reader.text(node, host).value_or("");
  if (!settings.host.empty()) {
    // "meter.local:502" has a port; an IPv6 address has more than one colon.
    const std::size_t colon = settings.host.find(':');
    const bool has_scheme = settings.host.find("://") != std::string::npos;
    const bool has_port = (colon != std::string::npos && colon == settings.host.rfind(':')) ||
                          settings.host.find("]:") != std::string::npos;
    if (has_port || settings.host.find_first_of(" /@[]") != std::string::npos)
      reader.error(*node.find("host"),
                   "must be only a host name or an address, found \"" + shown(settings.host) +
                       "\"" +
                       (has_scheme ? "; remove the scheme with its ://"
                        : has_port ? "; the number after the colon belongs in \"port\""
                        : settings.host.starts_with('[') ? "; remove the brackets"
                                                         : ""));
    else if (const auto fault = host_fault(settings.host); !fault.empty())
      reader.error(*node.find("host"), "\"" + shown(settings.host) + "\" " + std::string(fault));
  }
  const auto number = reader.integer(node, port);
  settings.port = static_cast<std::uint16_t>(number.value_or(0));
  if (!settings.host.empty() && number)
    warn_of_second(reader, link, node,
                   std::string(kind) + " " + settings.host + ":" + std::to_string(settings.port),
                   channels);
}

void read_serial(ConfigReader& reader, const ConfigNode& link, const ConfigNode& node,
                 Channels& channels, LinkConfig& config) {
  SerialSettings settings;
  settings.path = reader.text(node, "links[].serial.path").value_or("");
  if (const ConfigNode* rs485 = reader.object(node, "links[].serial.rs485"))
    settings.rs485 = read_rs485(reader, *rs485);
  if (!settings.path.empty()) {
    const ConfigNode& path = *node.find("path");
    const auto [first, fresh] = channels.emplace(settings.path, &path);
    if (!fresh)
      reader.error(path, "this port is already used at " + reader.place_of(*first->second));
  }
  for (const auto key : {"data_bits"sv, "parity"sv, "stop_bits"sv, "line_baud"sv})
    if (const ConfigNode* stray = link.find(key))
      reader.error_at_key(*stray, key == "line_baud" ? "is for tcp links; use serial/baud here"
                                                     : "belongs inside \"serial\" here");
  config.channel = settings;
}

void read_tcp(ConfigReader& reader, const ConfigNode& link, const ConfigNode& node,
              Channels& channels, LinkConfig& config) {
  TcpSettings settings;
  read_place(reader, link, node, "links[].tcp.host", "links[].tcp.port", "tcp", channels, settings);
  if (link.find("line_baud") == nullptr)
    for (const auto key : {"data_bits"sv, "parity"sv, "stop_bits"sv})
      if (const ConfigNode* stray = link.find(key))
        reader.error_at_key(*stray, "has a meaning only together with line_baud");
  config.channel = settings;
}

void read_udp(ConfigReader& reader, const ConfigNode& link, const ConfigNode& node,
              Channels& channels, LinkConfig& config) {
  UdpSettings settings;
  read_place(reader, link, node, "links[].udp.host", "links[].udp.port", "udp", channels, settings);
  if (const auto own = reader.integer(node, "links[].udp.local_port")) {
    settings.local_port = static_cast<std::uint16_t>(*own);
    const ConfigNode& at = *node.find("local_port");
    const auto [first, fresh] = channels.emplace("own " + std::to_string(*own), &at);
    if (!fresh) reader.error(at, "this port is already used at " + reader.place_of(*first->second));
  }
  for (const auto key : {"line_baud"sv, "data_bits"sv, "parity"sv, "stop_bits"sv})
    if (const ConfigNode* stray = link.find(key))
      reader.error_at_key(*stray, "is for serial and tcp links; a udp link has no serial line");
  config.channel = settings;
}

/// Reads the speed and character format at `node`. The protocol supplies missing values.
void read_line(ConfigReader& reader, const ConfigNode& node, KeyRef baud,
               const LineDefaults& defaults, SerialSettings& line) {
  line.baud = static_cast<int>(reader.integer(node, baud).value_or(defaults.baud));
  line.data_bits = static_cast<int>(
      reader.integer(node, "links[].serial.data_bits").value_or(defaults.data_bits));
  const auto parity = reader.choice(node, "links[].serial.parity");
  line.parity = parity ? static_cast<Parity>(*parity) : defaults.parity;
  line.stop_bits = static_cast<int>(
      reader.integer(node, "links[].serial.stop_bits").value_or(defaults.stop_bits));
}

/// Reports an error if the file sets fewer data bits than the protocol or an option of one of the
/// devices needs. A protocol needs its default unless the catalogue has least_data_bits. More bits
/// than needed are allowed.
void check_data_bits(ConfigReader& reader, const ConfigNode& line, std::size_t index, int given,
                     const ProtocolInfo& protocol, const SharedList<DeviceConfig>& devices) {
  const ConfigNode* at = line.find("data_bits");
  if (at == nullptr) return;
  const int least =
      protocol.least_data_bits != 0 ? protocol.least_data_bits : protocol.line.data_bits;
  if (given < least)
    return reader.error(
        *at, std::string(protocol.name) + " needs " + std::to_string(least) + " data bits");
  const bool may_be_binary = std::ranges::any_of(
      protocol.options, [](const OptionSpec& spec) { return spec.binary_from.has_value(); });
  if (given >= kEightBits || !may_be_binary) return;
  for (const DeviceConfig& device : devices) {
    if (device.link != index || device.options == nullptr) continue;
    const OptionSpec* binary = binary_option(protocol, *device.options);
    if (binary == nullptr) continue;  // from here on the option has an integer
    const std::string key = "\"" + std::string(binary->key) + "\" ";
    std::string text = key + std::to_string(*option<std::int64_t>(*device.options, binary->key));
    text.append(" of ").append(device.name);
    text.append(" is binary and needs 8 data bits: set 8 here and in the PLC, or ").append(key);
    return reader.error(*at, text.append("below ").append(std::to_string(*binary->binary_from)));
  }
}

constexpr std::array kChannels{"serial"sv, "tcp"sv, "udp"sv};

/// `channel` is one of kChannels. If it is empty, the link's own error is already reported.
bool runs_on(const ProtocolInfo& protocol, std::string_view channel) {
  return channel == "serial" ? protocol.on_serial : channel != "udp" || protocol.on_udp;
}

/// Returns the error text for a protocol that does not run over the channel of its link.
std::string why_not_on(const ProtocolInfo& protocol, std::string_view channel) {
  std::string needed;
  for (const std::string_view each : kChannels)
    if (runs_on(protocol, each))
      needed.append(needed.empty() ? "\"" : " or \"").append(each).append("\"");
  std::string others;
  for (const ProtocolInfo& other : catalog())
    if (channel == "udp" && other.on_udp)
      others.append(others.empty() ? "; over udp run " : ", ").append(other.name);
  return std::string(protocol.name) + " does not run over a " + std::string(channel) +
         " link; it needs one with " + needed + others;
}

}  // namespace

Links read_links(ConfigReader& reader, const ConfigNode& array, Config& config) {
  Links links;
  Channels ports;
  Channels hosts;
  config.links.reserve(array.children.size());
  for (const ConfigNode& node : array.children) {
    if (!reader.has_room(node, {.links = 1})) break;
    LinkConfig& link = config.links.emplace_back();
    LinkFacts& facts = links.facts.emplace_back();
    if (!reader.check_object(node, "links[]")) {
      links.names.add_unnamed();
      continue;
    }
    link.name = links.names.read(reader, node, "links[].name",
                                 static_cast<std::uint32_t>(config.links.size() - 1));
    const ConfigNode* serial = reader.object(node, "links[].serial");
    const ConfigNode* tcp = reader.object(node, "links[].tcp");
    const ConfigNode* udp = reader.object(node, "links[].udp");
    const auto is_given = [&](std::string_view channel) { return node.find(channel) != nullptr; };
    if (const auto given = std::ranges::count_if(kChannels, is_given); given != 1) {
      reader.error(node, given == 0 ? "needs \"serial\", \"tcp\" or \"udp\""
                                    : "has more than one of \"serial\", \"tcp\" and \"udp\": keep "
                                      "one of them");
      continue;
    }
    facts.channel = *std::ranges::find_if(kChannels, is_given);
    facts.line = serial != nullptr ? serial : tcp != nullptr ? &node : nullptr;
    if (serial != nullptr) read_serial(reader, node, *serial, ports, link);
    if (tcp != nullptr) read_tcp(reader, node, *tcp, hosts, link);
    if (udp != nullptr) read_udp(reader, node, *udp, hosts, link);
    if (const auto percent = reader.integer(node, "links[].poll_share_percent"))
      link.poll_share = static_cast<double>(*percent) / 100;
    link.allow_yield = reader.boolean(node, "links[].allow_yield");
  }
  return links;
}

void join_link(ConfigReader& reader, const DeviceEntry& entry, Links& links, DeviceConfig& device) {
  const ConfigNode& node = entry.members();
  const auto name = reader.name(node, "devices[].link");
  if (!name) return;
  const ConfigNode& given = *node.find("link");
  const auto index = links.names.find(*name);
  if (!index)
    return links.names.report_unknown(reader, given, "there is no link", *name,
                                      "; the config has no links");
  device.link = *index;
  LinkFacts& link = links.facts[*index];
  const ConfigNode* before = link.first_device;
  if (before == nullptr) link.first_device = &entry.node();
  if (device.protocol == nullptr) return;
  const ProtocolInfo& protocol = *device.protocol;
  if (!runs_on(protocol, link.channel)) reader.error(given, why_not_on(protocol, link.channel));
  if (link.protocol == nullptr) {
    link.protocol = &protocol;
  } else if (link.protocol != &protocol) {
    reader.error(*node.find("protocol"), "all devices of a link use one protocol, and " +
                                             reader.place_of(*before) + " has " +
                                             std::string(link.protocol->name) +
                                             " here; put this device on another link");
  } else if (!protocol.multidrop) {
    reader.warn(given, "the same PLC answers for this device and for " + reader.place_of(*before) +
                           ": " + std::string(protocol.name) + " has no station numbers");
  }
}

void finish_links(ConfigReader& reader, const ConfigNode& array, const Links& links,
                  Config& config) {
  std::vector<SerialSettings> lines(config.links.size(), {.path = {}, .baud = 0});
  for (std::size_t i = 0; i < config.links.size(); ++i) {
    LinkConfig& link = config.links[i];
    const LinkFacts& facts = links.facts[i];
    if (facts.first_device == nullptr) reader.warn(array.children[i], "no device uses this link");
    if (link.allow_yield && !link.is_vacant() &&
        contains(config.devices, link.name, &DeviceConfig::name))
      reader.error(*array.children[i].find("allow_yield"),
                   "needs another name for the link: device " + link.name +
                       " has the same one, and so the same topic for commands");
    if (facts.line == nullptr) continue;
    LineDefaults defaults = facts.protocol != nullptr ? facts.protocol->line : LineDefaults{};
    SerialSettings& line = lines[i];
    if (auto* serial = std::get_if<SerialSettings>(&link.channel)) {
      read_line(reader, *facts.line, "links[].serial.baud", defaults, *serial);
      line = *serial;
    } else {
      defaults.baud = 0;  // unknown
      read_line(reader, *facts.line, "links[].line_baud", defaults, line);
      std::get<TcpSettings>(link.channel).line_baud = line.baud;
    }
    if (facts.protocol != nullptr)
      check_data_bits(reader, *facts.line, i, line.data_bits, *facts.protocol, config.devices);
    if (line.baud != 0) link.char_time = char_time_of(line);
  }
  warn_of_lines(reader, array, lines, config);
}

void set_silences(Config& config) {
  for (DeviceConfig& device : config.devices) {
    if (device.codec == nullptr || device.link >= config.links.size()) continue;
    LinkConfig& link = config.links[device.link];
    const Recovery recovery = device.codec->after_silence();
    // A late reply does no harm if it carries a number, or if it goes to an earlier connection or
    // port.
    const auto* udp = std::get_if<UdpSettings>(&link.channel);
    if (udp != nullptr && recovery != Recovery::none)
      device.gap = std::max(device.gap, kQuietBetweenDatagrams);
    const bool is_another_port = udp != nullptr && udp->local_port == 0;
    if (recovery == Recovery::none || is_another_port) continue;
    if (udp == nullptr && recovery == Recovery::reconnect) continue;
    auto& listening = link.listening;
    listening = std::max(listening, std::min(2 * device.timeout, kLongestListening));
  }
}

}  // namespace fxagent
