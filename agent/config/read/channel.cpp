#include "agent/config/read/channel.h"

#include <chrono>
#include <cstdint>

#include "agent/config/keys.h"

namespace fxagent {
namespace {

using std::string_view_literals::operator""sv;

LineKeys read_line(ConfigReader& reader, const ConfigNode& node, const ConfigKey& baud) {
  LineKeys line;
  line.baud = reader.integer(node, baud);
  line.data_bits = reader.integer(node, config_key("links[].serial.data_bits"));
  if (const auto index = reader.choice(node, config_key("links[].serial.parity")))
    line.parity = static_cast<Parity>(*index);
  line.stop_bits = reader.integer(node, config_key("links[].serial.stop_bits"));
  return line;
}

Rs485 read_rs485(ConfigReader& reader, const ConfigNode& node) {
  Rs485 direction;
  reader.check_object(node, config_section("links[].serial.rs485"));
  direction.rts_on_send = reader.boolean(node, config_key("links[].serial.rs485.rts_on_send"));
  direction.delay_before = std::chrono::milliseconds(
      reader.integer_as<int>(node, config_key("links[].serial.rs485.delay_before_ms")));
  direction.delay_after = std::chrono::milliseconds(
      reader.integer_as<int>(node, config_key("links[].serial.rs485.delay_after_ms")));
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
  reader.warn(node, called(link) + " goes to the same host and port as " + called(*first->second) +
                        " at " + reader.place_of(*first->second) +
                        "; many devices and serial servers serve one connection only: put the "
                        "devices of both on one link");
}

/// Reads `host` and `port` of the `tcp` or `udp` at `node`.
template <class Settings>
void read_place(ConfigReader& reader, const ConfigNode& link, const ConfigNode& node,
                const ConfigKey& host, const ConfigKey& port, std::string_view kind,
                Channels& channels, Settings& settings) {
  settings.host = reader.text(node, host).value_or("");
  if (!settings.host.empty()) {
    // "meter.local:502" has a port; an IPv6 address has more than one colon.
    const std::size_t colon = settings.host.find(':');
    const bool has_port = colon != std::string::npos && colon == settings.host.rfind(':');
    if (has_port || settings.host.find_first_of(" /@") != std::string::npos)
      reader.error(*node.find("host"),
                   "must be a host name or an address alone, found \"" + shown(settings.host) +
                       "\"" +
                       (has_port ? "; the number behind the colon belongs in \"port\"" : ""));
  }
  const auto number = reader.integer(node, port);
  settings.port = static_cast<std::uint16_t>(number.value_or(0));
  if (!settings.host.empty() && number)
    warn_of_second(reader, link, node,
                   std::string(kind) + " " + settings.host + ":" + std::to_string(settings.port),
                   channels);
}

}  // namespace

void read_serial(ConfigReader& reader, const ConfigNode& link, const ConfigNode& node,
                 Channels& channels, LinkConfig& config, LineKeys& line) {
  SerialSettings settings;
  reader.check_object(node, config_section("links[].serial"));
  settings.path = reader.text(node, config_key("links[].serial.path")).value_or("");
  line = read_line(reader, node, config_key("links[].serial.baud"));
  if (const ConfigNode* rs485 = reader.object(node, config_key("links[].serial.rs485")))
    settings.rs485 = read_rs485(reader, *rs485);
  if (!settings.path.empty()) {
    const ConfigNode& path = *node.find("path");
    const auto [first, fresh] = channels.emplace(settings.path, &path);
    if (!fresh)
      reader.error(path, "this port is already used at " + reader.place_of(*first->second));
  }
  for (const auto key : {"data_bits"sv, "parity"sv, "stop_bits"sv, "line_baud"sv})
    if (const ConfigNode* stray = link.find(key))
      reader.error_at_key(*stray, key == "line_baud" ? "is for tcp links; here it is serial/baud"
                                                     : "belongs inside \"serial\" here");
  config.channel = settings;
}

void read_tcp(ConfigReader& reader, const ConfigNode& link, const ConfigNode& node,
              Channels& channels, LinkConfig& config, LineKeys& line) {
  TcpSettings settings;
  reader.check_object(node, config_section("links[].tcp"));
  read_place(reader, link, node, config_key("links[].tcp.host"), config_key("links[].tcp.port"),
             "tcp", channels, settings);
  line = read_line(reader, link, config_key("links[].line_baud"));
  settings.line_baud = static_cast<int>(line.baud.value_or(0));
  if (link.find("line_baud") == nullptr)
    for (const auto key : {"data_bits"sv, "parity"sv, "stop_bits"sv})
      if (const ConfigNode* stray = link.find(key))
        reader.error_at_key(*stray, "means something beside line_baud only");
  config.channel = settings;
}

void read_udp(ConfigReader& reader, const ConfigNode& link, const ConfigNode& node,
              Channels& channels, LinkConfig& config) {
  UdpSettings settings;
  reader.check_object(node, config_section("links[].udp"));
  read_place(reader, link, node, config_key("links[].udp.host"), config_key("links[].udp.port"),
             "udp", channels, settings);
  if (const auto own = reader.integer(node, config_key("links[].udp.local_port"))) {
    settings.local_port = static_cast<std::uint16_t>(*own);
    const ConfigNode& at = *node.find("local_port");
    const auto [first, fresh] = channels.emplace("own " + std::to_string(*own), &at);
    if (!fresh) reader.error(at, "this port is already used at " + reader.place_of(*first->second));
  }
  for (const auto key : {"line_baud"sv, "data_bits"sv, "parity"sv, "stop_bits"sv})
    if (const ConfigNode* stray = link.find(key))
      reader.error_at_key(*stray, "is for serial and tcp links; UDP has no line behind it");
  config.channel = settings;
}

}  // namespace fxagent
