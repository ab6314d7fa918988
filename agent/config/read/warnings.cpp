#include "agent/config/read/sections.h"

#include <algorithm>
#include <chrono>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "agent/config/read/devices/templates.h"
#include "agent/text/text.h"
#include "protocol/address_space.h"
#include "protocol/plc.h"
#include "protocol/value/point.h"
#include "protocol/value/span.h"
#include "protocol/value/value.h"

namespace fxagent {

using std::string_view_literals::operator""sv;

namespace {

bool knows(const ProtocolInfo& protocol, int speed) {
  return protocol.speeds.empty() || contains(protocol.speeds, speed);
}

/// `at` is the node of the speed, or `link` if there is none.
void warn_of_protocol(ConfigReader& reader, const ConfigNode& link, const ConfigNode& at,
                      const SerialSettings& line, const ProtocolInfo& protocol) {
  if (!knows(protocol, line.baud)) {
    std::string speeds;
    for (const int speed : protocol.speeds)
      speeds += (speeds.empty() ? "" : ", ") + std::to_string(speed);
    reader.warn(at, std::to_string(line.baud) + " baud is not a known speed of " +
                        std::string(protocol.name) + "; its speeds are " + speeds);
  }
  const LineDefaults& only = protocol.line;
  const bool differs = line.data_bits != only.data_bits || line.parity != only.parity ||
                       line.stop_bits != only.stop_bits;
  if (protocol.one_line && differs)
    reader.warn(
        link,
        "a line of " + std::string(protocol.name) +
            " has 7 data bits, even parity and 1 stop bit; no FX is known to use other settings");
}

}  // namespace

void warn_of_limits(ConfigReader& reader, const ConfigNode& node, const TagConfig& tag) {
  const auto range = value_range(tag.point);
  const ConfigNode* min = tag.units->limits.min ? node.find("min") : nullptr;
  const ConfigNode* max = tag.units->limits.max ? node.find("max") : nullptr;
  if (!range) return;
  const auto values = [&] {
    return "go from " + spelled(range->least) + " to " + spelled(range->greatest);
  };
  if (tag.units->limits.deadband.value_or(0) > range->greatest - range->least)
    reader.warn(*node.find("deadband"),
                "no change is this large: the values of this tag " + values());
  if (min == nullptr && max == nullptr) return;
  const auto within = values_within(tag.point, tag.units->limits.min, tag.units->limits.max);
  if (within && *within < 2) {
    reader.warn(min != nullptr ? *min : *max,
                std::string(*within == 0 ? "no value" : "only one value") +
                    " of this tag is within its limits: its values " + values() + " in steps of " +
                    spelled(range->step));
    return;
  }
  const std::string text = "has no effect: the values of this tag " + values();
  if (min != nullptr && *tag.units->limits.min < range->least) reader.warn(*min, text);
  if (max != nullptr && *tag.units->limits.max > range->greatest) reader.warn(*max, text);
}

void warn_of_unchecked_limits(ConfigReader& reader, const ConfigNode& allow,
                              const DeviceConfig& device) {
  const std::vector<Span>& ranges = device.commands.allow;
  std::string first;
  std::size_t count = 0;
  for (const TagConfig& tag : device.tags) {
    const auto span = span_of(tag.point);
    if (!span || !tag.writable || (!tag.units->limits.min && !tag.units->limits.max)) continue;
    const auto range = std::ranges::partition_point(ranges, [&](const Span& each) {
      return each.space < span->space ||
             (each.space == span->space && each.end_bit() <= span->first_bit);
    });
    if (range == ranges.end() || !overlap(*range, *span) || ++count > 1) continue;
    first = names_of(device.codec->addresses(), *range) + " covers the tag " +
            std::string(tag.name) + " at " + std::string(tag.point.address.text);
  }
  if (count == 0) return;
  const std::string others =
      count == 1 ? "" : ". So it is with " + counted(count - 1, "other tag") + " of this device";
  reader.warn(allow, first +
                         ": a command that names the address writes raw values, and neither min "
                         "nor max of the tag applies to it. Leave the place out, and let commands "
                         "name the tag" +
                         others);
}

void warn_of_silence(ConfigReader& reader, const ConfigNode& node, const GroupConfig& group) {
  if (group.max_silent >= group.interval) return;
  if (const ConfigNode* given = node.find("max_silent_s"))
    reader.warn(*given, "is shorter than interval_ms: every poll is published");
  else if (group.on_change)
    reader.warn(*node.find("publish"),
                "has no effect: max_silent_s (by default " +
                    std::to_string(group.max_silent.count()) +
                    ") is shorter than interval_ms, so every poll is published");
}

void warn_of_lines(ConfigReader& reader, const ConfigNode& links,
                   std::span<const SerialSettings> lines, const Config& config) {
  std::vector<bool> judged(lines.size());
  for (const DeviceConfig& device : config.devices) {
    if (device.link >= lines.size() || device.protocol == nullptr || device.codec == nullptr)
      continue;
    const ConfigNode& link = links.children[device.link];
    const std::string model = model_of(*device.codec);
    const bool is_module = model == "Q" || model == "L";  // E71 modules answer any port
    const auto* udp = std::get_if<UdpSettings>(&config.links[device.link].channel);
    if (udp != nullptr && udp->local_port == 0 && device.protocol->name == "mc-1e" && !is_module &&
        !judged[device.link]) {
      judged[device.link] = true;
      reader.warn(*link.find("udp"),
                  "has no local_port: an FX3 answers over UDP only the port that "
                  "its entry in the Open Setting names; set local_port to that");
    }
    const SerialSettings& line = lines[device.link];
    if (line.baud == 0) continue;
    const ConfigNode* serial = link.find("serial");
    const ConfigNode* speed = serial != nullptr ? serial->find("baud") : link.find("line_baud");
    const ConfigNode& at = speed != nullptr ? *speed : link;
    const ProtocolInfo& protocol = *device.protocol;
    if (!judged[device.link]) warn_of_protocol(reader, link, at, line, protocol);
    judged[device.link] = true;
    const bool is_fast =
        model.empty() || protocol.most_speed == 0 || contains(protocol.fast_models, model);
    if (!is_fast && line.baud > protocol.most_speed && knows(protocol, line.baud))
      reader.warn(at, device.name + " is an " + model + ", whose highest speed is " +
                          std::to_string(protocol.most_speed) + " baud");
  }
}

void warn_of_station(ConfigReader& reader, const DeviceEntry& entry, const DeviceConfig& device,
                     FirstStations& stations) {
  if (device.options == nullptr) return;
  for (const auto key : {"station"sv, "unit"sv}) {
    const auto* number = option<std::int64_t>(*device.options, key);
    if (number == nullptr) continue;
    const auto [first, fresh] = stations.emplace(std::pair(device.link, *number), &entry.node());
    if (fresh) continue;
    const ConfigNode* given = entry.in_file(key);
    reader.warn(given != nullptr ? *given : entry.node(),
                std::string(key) + " " + std::to_string(*number) + " is that of " +
                    reader.place_of(*first->second) + " on the same link: the same device " +
                    "answers for both");
  }
}

}  // namespace fxagent
