#include "agent/uplink/topics.h"

#include <utility>

#include "agent/text/text.h"

namespace fxagent {
namespace {

constexpr std::size_t kMaxTopicBytes = 65535;  // MQTT 5, section 1.5.4

/// Splits "{base}/{device}/{rest}". Both are empty for every other form.
std::pair<std::string_view, std::string_view> below(std::string_view base, std::string_view topic) {
  if (!topic.starts_with(base) || !topic.substr(base.size()).starts_with('/')) return {};
  topic.remove_prefix(base.size() + 1);
  const std::size_t slash = topic.find('/');
  if (slash == topic.npos) return {};
  return {topic.substr(0, slash), topic.substr(slash + 1)};
}

}  // namespace

bool is_publishable(std::string_view topic) {
  constexpr std::string_view forbidden("+#\0", 3);
  return !topic.empty() && topic.size() <= kMaxTopicBytes && topic.front() != '$' &&
         topic.find_first_of(forbidden) == std::string_view::npos && is_utf8(topic);
}

std::optional<std::string_view> device_of(std::string_view topic, std::string_view base,
                                          std::string_view leaf) {
  const auto [device, rest] = below(base, topic);
  return !device.empty() && rest == leaf ? std::optional(device) : std::nullopt;
}

std::optional<DataTopic> data_topic_of(std::string_view topic, std::string_view base) {
  const auto [device, rest] = below(base, topic);
  if (!rest.starts_with("data/")) return std::nullopt;
  DataTopic found{device, rest.substr(5), false};
  if (found.group.ends_with("/history")) {
    found.group.remove_suffix(8);
    found.is_history = true;
  }
  if (found.device.empty() || found.group.empty() || found.group.find('/') != found.group.npos)
    return std::nullopt;
  return found;
}

std::string response_topic_fault(std::string_view topic, std::string_view base,
                                 std::string_view device) {
  if (!is_publishable(topic)) return "not a topic that can be published to";
  if (topic.ends_with("/command")) return "ends in /command";
  const std::string own = std::string(base) + "/" + std::string(device) + "/result/";
  if (topic.starts_with(own) && topic.size() > own.size()) return {};
  return "not below " + own;
}

}  // namespace fxagent
