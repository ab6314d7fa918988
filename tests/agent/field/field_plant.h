// The test plant of this directory: a PLC on the programming port with a few tags, as the config
// would describe it.
#pragma once

#include <gtest/gtest.h>

#include "agent/config/model.h"
#include "agent/handover/command_message.h"
#include "protocol/fx/programming_port.h"
#include "protocol/value/value.h"

namespace fxagent::test {

inline std::shared_ptr<const Codec> port_codec(fx::Model model = fx::Model::fx3u) {
  return std::make_shared<const fx::ProgrammingPort>(fx::ProgrammingPort::Settings{.model = model});
}

inline TagConfig tag(const Codec& codec, std::string name, std::string_view address,
                     std::optional<DataType> type = std::nullopt, std::uint32_t group = 0) {
  TagConfig out;
  out.name = std::move(name);
  const auto place = codec.addresses().parse_address(address, type);
  if (!place) {
    ADD_FAILURE() << address << ": " << place.error().text;
    return out;
  }
  out.point.address = *place;
  out.point.type = type.value_or(default_type(*place));
  out.point.order = codec.addresses().default_order();
  out.group = group;
  return out;
}

inline TagConfig writable(TagConfig tag) {
  tag.writable = true;
  return tag;
}

inline TagConfig array_of(TagConfig tag, std::uint16_t count) {
  tag.point.is_array = true;
  tag.point.count = count;
  return tag;
}

inline TagConfig scaled(TagConfig tag, double scale, double offset = 0.0) {
  EXPECT_TRUE(set_units(tag.point, scale, offset).has_value());
  return tag;
}

inline GroupConfig group(std::string name, std::chrono::milliseconds interval) {
  return {.name = std::move(name), .interval = interval};
}

/// A device without tags, with one group that is polled as fast as the line allows.
inline DeviceConfig device_on(std::string_view protocol, std::shared_ptr<const Codec> codec,
                              std::string name = "meter") {
  DeviceConfig device;
  device.name = std::move(name);
  device.protocol = find_protocol(protocol);
  device.codec = std::move(codec);
  device.groups.push_back(group("fast", std::chrono::milliseconds(0)));
  return device;
}

inline DeviceConfig port_device(std::string name = "press1",
                                std::shared_ptr<const Codec> codec = port_codec()) {
  return device_on("fx-programming-port", std::move(codec), std::move(name));
}

/// A codec with its protocol's default options, overridden by `more`.
inline std::shared_ptr<const Codec> codec_of(std::string_view protocol, Options more = {}) {
  const ProtocolInfo& info = *find_protocol(protocol);
  Options options = default_options(info);
  for (auto& [key, value] : more) options[key] = value;
  const auto made = info.make(options);
  EXPECT_TRUE(made.has_value()) << made.error().text;
  return *made;
}

inline Command command_of(std::string id, Op op, std::vector<CommandTarget> targets = {}) {
  Command command;
  command.id = std::move(id);
  command.op = op;
  command.op_text = to_string(op);
  command.targets = std::move(targets);
  return command;
}

inline Value number(std::int64_t value) { return Value(Scalar(value)); }
inline Value real(double value) { return Value(Scalar(value)); }
inline Value flag(bool value) { return Value(Scalar(value)); }
inline Value text(std::string value) { return Value(Scalar(std::move(value))); }
inline Value numbers(std::initializer_list<std::int64_t> values) {
  Scalars items;
  for (const std::int64_t value : values) items.emplace_back(value);
  return Value::array(std::move(items));
}

/// Returns how a command or one of its targets ended, with the words of its result: "FAILED nak".
inline std::string ending(const auto& result) {
  std::string words(to_string(result.status));
  if (result.reason != Reason::none) words.append(" ").append(to_string(result.reason));
  return words;
}

}  // namespace fxagent::test
