// Topic names: checks those to publish to, and parses incoming ones. Pure. Any thread.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <string_view>

namespace fxagent {

/// True if a broker accepts a publish to this topic. Brokers close the whole connection for a
/// wildcard, a NUL, a leading '$', invalid UTF-8 or more than 65535 bytes. So every topic is
/// checked.
bool is_publishable(std::string_view topic);

/// Returns the device of "{base}/{device}/{leaf}"; nullopt for every other form.
std::optional<std::string_view> device_of(std::string_view topic, std::string_view base,
                                          std::string_view leaf);

/// Topics below {base}/ that both gateways of a pair publish and receive. Results come before the
/// journal: a standby that had an announcement without its result would report the command as
/// interrupted.
inline constexpr std::array<std::string_view, 4> kPairTopics{"+/result", "pair/+",
                                                             "pair/+/heartbeat", "pair/+/journal"};

/// Parts of a sample topic: "{base}/{device}/data/{group}", or that followed by "/history".
struct DataTopic {
  std::string_view device;
  std::string_view group;
  bool is_history = false;
};
/// Returns nullopt for every other form. The views refer to `topic`.
std::optional<DataTopic> data_topic_of(std::string_view topic, std::string_view base);

/// Returns an empty string if a result may go to this response topic; otherwise why not. A client
/// that may send commands must not make the agent write elsewhere in the broker. So results go only
/// below {base}/{device}/result/, and to no topic that ends in /command.
std::string response_topic_fault(std::string_view topic, std::string_view base,
                                 std::string_view device);

}  // namespace fxagent
