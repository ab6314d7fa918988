// A small plant for the uplink's tests: press1 as in the examples of docs/interface.md, and press2.
#pragma once

#include <memory>
#include <string>

#include "agent/config/model.h"
#include "agent/handover/command_message.h"
#include "agent/handover/field_health.h"
#include "agent/handover/telemetry.h"
#include "agent/uplink/broker.h"
#include "protocol/fx/programming_port.h"

namespace fxagent::test {

enum PressTag : std::uint32_t { temp, running, pressure, setpoint, level, label };

inline std::shared_ptr<const Codec> codec() {
  static const auto made = std::make_shared<const fx::ProgrammingPort>(
      fx::ProgrammingPort::Settings{.model = fx::Model::fx3u});
  return made;
}

inline TagConfig tag(std::string name, std::string address, DataType type,
                     std::uint32_t group = 0) {
  TagConfig made;
  made.name = std::move(name);
  made.point.address = *codec()->addresses().parse_address(address, type);
  made.point.type = type;
  made.point.order = codec()->addresses().default_order();
  made.group = group;
  return made;
}

inline DeviceConfig press(std::string name) {
  DeviceConfig device;
  device.name = std::move(name);
  device.codec = codec();
  device.groups = {{.name = "fast"}, {.name = "slow"}};
  TagConfig temperature = tag("temp", "D100", DataType::int16);
  temperature.point.scale = 0.1;
  temperature.units =
      std::make_shared<const TagUnits>(TagUnits{.unit = "°C", .limits = {.deadband = 0.5}});
  TagConfig set = tag("setpoint", "D200", DataType::int16, 1);
  set.writable = true;
  set.units = std::make_shared<const TagUnits>(TagUnits{.limits = {.min = 0, .max = 1000}});
  device.tags = {temperature,
                 tag("running", "M0", DataType::boolean),
                 tag("pressure", "D101", DataType::int16),
                 set,
                 tag("level", "D300", DataType::float32),
                 tag("label", "D400", DataType::string)};
  device.tags[label].point.length = 8;
  return device;
}

inline Config plant() {
  Config config;
  config.id = "edge7";
  config.root = "fx/plant-a";
  config.mqtt.servers = {"mqtt://one:1883", "mqtt://two:1883"};
  config.mqtt.client_id = "fx-edge7";
  config.links = {{.name = "line1", .channel = SerialSettings{}}};
  config.devices = {press("press1"), press("press2")};
  return config;
}

inline TagReading good(std::uint32_t index, Value value) {
  TagReading reading;
  reading.tag = index;
  reading.value = std::move(value);
  return reading;
}

inline Telemetry sample(std::uint64_t seq, std::uint32_t device = 0, std::uint32_t group = 0) {
  Telemetry message;
  message.device = device;
  message.group = group;
  message.seq = seq;
  message.ts_ms = 1790000000000 + static_cast<std::int64_t>(seq);
  message.readings = {good(temp, Value(23.4))};
  return message;
}

inline Message message_on(std::string topic, std::string payload, bool retained = false) {
  Message message;
  message.topic = std::move(topic);
  message.payload = std::move(payload);
  message.retained = retained;
  return message;
}

/// A status with this state and nothing else.
inline DeviceStatus status_of(std::uint32_t device, DeviceStatus::State state) {
  DeviceStatus status;
  status.device = device;
  status.state = state;
  return status;
}

/// A device that has answered every read so far.
inline DeviceStatus online(std::uint32_t device) {
  DeviceStatus status = status_of(device, DeviceStatus::State::online);
  status.since_ms = 7;
  status.model = "FX3U";
  status.run = true;
  return status;
}

inline DeviceStatus offline(std::uint32_t device, std::string reason, std::int64_t since_ms = 7) {
  DeviceStatus status = status_of(device, DeviceStatus::State::offline);
  status.reason = std::move(reason);
  status.since_ms = since_ms;
  return status;
}

/// The field's counters, all on the first device.
inline FieldHealth counted(std::uint64_t collected, std::uint64_t suppressed) {
  FieldHealth health;
  health.devices.resize(2);
  health.devices[0].polls = 9;
  health.devices[0].collected = collected;
  health.devices[0].suppressed = suppressed;
  return health;
}

inline CommandResult succeeded(std::string id) {
  CommandResult result;
  result.id = std::move(id);
  result.status = CommandStatus::succeeded;
  result.plc = PlcAnswer::ack;
  result.op = "write";
  TargetResult target;
  target.tag = "setpoint";
  target.address = "D200";
  target.value = Value(std::int64_t{50});
  target.status = CommandStatus::succeeded;
  result.targets = {target};
  result.attempts = 1;
  return result;
}

}  // namespace fxagent::test
