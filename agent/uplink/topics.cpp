#include "agent/uplink/topics.h"

#include "agent/text/text.h"

namespace fxagent {
namespace {

constexpr std::size_t kMaxTopicBytes = 65535;  // MQTT 5, section 1.5.4

bool starts_with(std::string_view text, std::string_view a, std::string_view b) {
  return text.starts_with(a) && text.substr(a.size()).starts_with(b);
}

}  // namespace

bool is_publishable(std::string_view topic) {
  constexpr std::string_view forbidden("+#\0", 3);
  return !topic.empty() && topic.size() <= kMaxTopicBytes && topic.front() != '$' &&
         topic.find_first_of(forbidden) == std::string_view::npos && is_utf8(topic);
}

std::optional<std::string_view> device_of(std::string_view topic, std::string_view base,
                                          std::string_view leaf) {
  if (!starts_with(topic, base, "/")) return std::nullopt;
  topic.remove_prefix(base.size() + 1);
  const std::size_t slash = topic.find('/');
  if (slash == std::string_view::npos || slash == 0 || topic.substr(slash + 1) != leaf)
    return std::nullopt;
  return topic.substr(0, slash);
}

std::optional<DataTopic> data_topic_of(std::string_view topic, std::string_view base) {
  if (!starts_with(topic, base, "/")) return std::nullopt;
  topic.remove_prefix(base.size() + 1);
  const std::size_t slash = topic.find('/');
  if (slash == std::string_view::npos || !topic.substr(slash).starts_with("/data/"))
    return std::nullopt;
  DataTopic found{topic.substr(0, slash), topic.substr(slash + 6), false};
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
