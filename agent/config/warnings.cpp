#include "agent/config/warnings.h"

#include <chrono>
#include <string>
#include <string_view>
#include <utility>
#include <variant>

#include "protocol/value_range.h"

namespace fxagent {
namespace {

using std::string_view_literals::operator""sv;

}  // namespace

void warn_of_limits(ConfigReader& reader, const ConfigNode& node, const TagConfig& tag) {
  const auto range = value_range(tag.point);
  const ConfigNode* min = tag.units->limits.min ? node.find("min") : nullptr;
  const ConfigNode* max = tag.units->limits.max ? node.find("max") : nullptr;
  if (!range || (min == nullptr && max == nullptr)) return;
  const std::string values = "go from " + spelled(range->least) + " to " + spelled(range->greatest);
  const auto within = values_within(tag.point, tag.units->limits.min, tag.units->limits.max);
  if (within && *within < 2) {
    reader.warn(min != nullptr ? *min : *max,
                std::string(*within == 0 ? "no value" : "only one value") +
                    " of this tag lies within its limits: they " + values + " in steps of " +
                    spelled(range->step));
    return;
  }
  const std::string text = "has no effect: the values of this tag " + values;
  if (min != nullptr && *tag.units->limits.min < range->least) reader.warn(*min, text);
  if (max != nullptr && *tag.units->limits.max > range->greatest) reader.warn(*max, text);
}

void warn_of_silence(ConfigReader& reader, const ConfigNode& node, const GroupConfig& group) {
  if (group.max_silent >= group.interval) return;
  if (const ConfigNode* given = node.find("max_silent_s"))
    reader.warn(*given, "shorter than interval_ms: every poll is published");
  else if (group.on_change)
    reader.warn(*node.find("publish"),
                "has no effect: max_silent_s, which is " +
                    std::to_string(group.max_silent.count()) +
                    " where it is not given, is shorter than interval_ms; every poll is published");
}

void StationTable::add(ConfigReader& reader, const DeviceEntry& entry, const DeviceConfig& device) {
  if (device.options == nullptr) return;
  for (const auto key : {"station"sv, "unit"sv}) {
    const auto option = device.options->find(key);
    if (option == device.options->end()) continue;
    const auto number = std::get<std::int64_t>(option->second);
    const auto [first, fresh] = first_.emplace(std::pair(device.link, number), &entry.node());
    if (fresh) continue;
    const ConfigNode* given = entry.in_file(key);
    reader.warn(given != nullptr ? *given : entry.node(),
                std::string(key) + " " + std::to_string(number) + " is that of " +
                    reader.place_of(*first->second) + " on the same link: one and the same " +
                    "answers for both");
  }
}

}  // namespace fxagent
