#include "agent/config/model.h"

#include <algorithm>
#include <string_view>
#include <tuple>
#include <variant>

namespace fxagent {

const std::shared_ptr<const TagUnits>& no_units() {
  static const auto none = std::make_shared<const TagUnits>();
  return none;
}

bool operator==(const TagConfig& a, const TagConfig& b) {
  return a.name == b.name && a.point == b.point && a.group == b.group && a.writable == b.writable &&
         (a.units == b.units || *a.units == *b.units);
}

bool operator==(const DeviceConfig& a, const DeviceConfig& b) {
  const auto settings = [](const DeviceConfig& device) {
    return std::tie(device.name, device.link, device.protocol, device.timeout, device.retries,
                    device.gap, device.turnaround, device.echo, device.max_block_bytes,
                    device.enquire, device.groups, device.commands, device.tags);
  };
  const bool same_codec =
      a.options == b.options || (a.options && b.options && *a.options == *b.options);
  return settings(a) == settings(b) && same_codec;
}

std::chrono::nanoseconds char_time_of(const SerialSettings& line) {
  const int bits = 1 + line.data_bits + (line.parity == Parity::none ? 0 : 1) + line.stop_bits;
  return std::chrono::nanoseconds((bits * std::int64_t{1'000'000'000} + line.baud / 2) / line.baud);
}

std::string endpoint_of(const LinkConfig& link) {
  const auto text = [](const auto& channel) -> std::string {
    if constexpr (requires { channel.path; })
      return channel.path;
    else
      return channel.host + ":" + std::to_string(channel.port);
  };
  return std::visit(text, link.channel);
}

std::string channel_text(const LinkConfig& link) {
  if (const auto* serial = std::get_if<SerialSettings>(&link.channel)) {
    constexpr std::string_view kParities = "NEO";  // as in Parity
    return "serial " + serial->path + " " + std::to_string(serial->baud) + " " +
           std::to_string(serial->data_bits) + kParities[static_cast<std::size_t>(serial->parity)] +
           std::to_string(serial->stop_bits);
  }
  return (std::holds_alternative<UdpSettings>(link.channel) ? "udp " : "tcp ") + endpoint_of(link);
}

const BrokerConfig* broker_named(const Config& config, const std::string& name) {
  const auto found = std::ranges::find(config.brokers, name, &BrokerConfig::name);
  return found == config.brokers.end() ? nullptr : &*found;
}

const MqttConfig& broker_of(const Config& config, const std::string& name) {
  const BrokerConfig* broker = broker_named(config, name);
  return broker == nullptr ? config.mqtt : broker->mqtt;
}

std::vector<std::pair<std::string, const MqttConfig*>> brokers_of(const Config& config) {
  std::vector<std::pair<std::string, const MqttConfig*>> brokers{{"/mqtt", &config.mqtt}};
  for (std::size_t i = 0; i < config.brokers.size(); ++i)
    brokers.emplace_back("/brokers/" + std::to_string(i), &config.brokers[i].mqtt);
  return brokers;
}

std::string_view kind_of(const ProfileConfig& profile) {
  if (profile.kind == ProfileConfig::Kind::sparkplug_commands) return "sparkplug-commands";
  return config_keys::kProfiles.at(static_cast<std::size_t>(profile.kind));
}

std::string name_of(const ProfileConfig& profile) {
  const std::string kind(kind_of(profile));
  return profile.broker.empty() ? kind : kind + "@" + profile.broker;
}

std::size_t ring_bytes(const RecorderConfig& recorder, std::size_t links) {
  if (recorder.link_bytes) return static_cast<std::size_t>(*recorder.link_bytes);
  constexpr std::size_t kMost = std::size_t{256} << 10;
  constexpr std::size_t kLeast = 4096;
  constexpr std::size_t kOfAllLinks = std::size_t{16} << 20;
  return std::clamp(kOfAllLinks / std::max<std::size_t>(links, 1), kLeast, kMost);
}

}  // namespace fxagent
