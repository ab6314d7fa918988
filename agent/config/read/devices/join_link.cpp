#include "agent/config/read/devices/join_link.h"

#include <array>
#include <string>
#include <string_view>
#include <utility>

#include "agent/config/keys.h"
#include "protocol/catalog.h"

namespace fxagent {
namespace {

using std::string_view_literals::operator""sv;

using Channel = LinkFacts::Channel;
constexpr std::array kChannels{std::pair(Channel::serial, "serial"sv),
                               std::pair(Channel::tcp, "tcp"sv), std::pair(Channel::udp, "udp"sv)};

bool runs_on(const ProtocolInfo& protocol, Channel channel) {
  // By Channel. For `none` the link's own error is already reported.
  const std::array runs{true, protocol.on_serial, protocol.on_tcp, protocol.on_udp};
  return runs[static_cast<std::size_t>(channel)];
}

/// Returns the error text for a protocol that does not run over the channel of its link.
std::string why_not_on(const ProtocolInfo& protocol, Channel channel) {
  std::string given;
  std::string needed;
  for (const auto& [each, word] : kChannels) {
    if (each == channel) given = word;
    if (runs_on(protocol, each))
      needed.append(needed.empty() ? "\"" : " or \"").append(word).append("\"");
  }
  std::string others;
  for (const ProtocolInfo& other : catalog())
    if (channel == Channel::udp && other.on_udp)
      others.append(others.empty() ? "; over udp run " : ", ").append(other.name);
  return std::string(protocol.name) + " does not run over a " + given +
         " link; it needs one with " + needed + others;
}

}  // namespace

void join_link(ConfigReader& reader, const DeviceEntry& entry, const NameTable& links,
               std::vector<LinkFacts>& facts, DeviceConfig& device) {
  const ConfigNode& node = entry.members();
  const auto name = reader.name(node, config_key("devices[].link"));
  if (!name) return;
  const ConfigNode& given = *node.find("link");
  const auto index = links.find(*name);
  if (!index) {
    std::string text = "there is no link \"" + *name + "\"";
    if (links.empty())
      text += "; the config has no links";
    else if (reader.may_suggest(given.offset))
      text += links.in_place_of(*name);
    reader.error(given, std::move(text));
    return;
  }
  device.link = *index;
  LinkFacts& link = facts[*index];
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

}  // namespace fxagent
