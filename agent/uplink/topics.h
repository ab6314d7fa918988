// Topic names: which may be published to, and what an incoming one says. Pure text. Any thread.
#pragma once

#include <optional>
#include <string>
#include <string_view>

namespace fxagent {

/// Whether a broker takes a publish to this topic. A wildcard, a NUL, a leading '$', bad UTF-8 or
/// more than 65535 bytes make brokers drop the whole connection, so nothing goes out unchecked.
bool is_publishable(std::string_view topic);

/// "{base}/{device}/{leaf}" → device; nullopt for every other shape.
std::optional<std::string_view> device_of(std::string_view topic, std::string_view base,
                                          std::string_view leaf);

/// Whether a device can have that name: 1 to 64 characters of a-z, 0-9, _ and -.
bool may_be_a_device(std::string_view name);

/// What a topic of samples says: "{base}/{device}/data/{group}", or that with "/history" behind it.
struct DataTopic {
  std::string_view device;
  std::string_view group;
  bool is_history = false;
};
/// Nullopt for every other shape. The views are of `topic`.
std::optional<DataTopic> data_topic_of(std::string_view topic, std::string_view base);

/// Empty where a result may go to this response topic; otherwise why not. Whoever may send a
/// command must not make the agent write elsewhere in the broker: a result goes below
/// {base}/{device}/result/ alone, and to no topic that ends in /command.
std::string response_topic_fault(std::string_view topic, std::string_view base,
                                 std::string_view device);

}  // namespace fxagent
