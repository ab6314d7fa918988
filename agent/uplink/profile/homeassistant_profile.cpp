#include "agent/uplink/profile/homeassistant_profile.h"

#include <algorithm>
#include <array>
#include <optional>
#include <span>
#include <string_view>
#include <utility>

#include "agent/log/log.h"
#include "agent/text/json.h"
#include "agent/text/json_writer.h"
#include "agent/text/text.h"
#include "protocol/codec.h"
#include "protocol/letter_case.h"
#include "protocol/value/point.h"

namespace fxagent {
namespace {

using std::string_view_literals::operator""sv;

constexpr std::uint16_t kMostElements = 64;
constexpr double kLeastStep = 0.001;    ///< Home Assistant refuses smaller ones
constexpr double kGreatest = 1e300;     ///< keeps the difference of two limits finite
constexpr std::size_t kMostText = 255;  ///< characters of a state
constexpr std::string_view kConfig = "/config";
/// First bytes of each of our messages.
constexpr std::string_view kBegin = R"({"origin":{"name":"fxagent",)";
constexpr std::array kRunStop{"run"sv, "stop"sv};

/// Returns the path as an id of Home Assistant, [a-zA-Z0-9_-]. Different paths have different ids:
/// a slash becomes _, any other character outside [a-z0-9-] becomes X and its code.
std::string id_of(std::string_view path) {
  constexpr std::string_view kDigits = "0123456789abcdef";
  std::string id;
  for (const char c : path) {
    if ((c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '-') {
      id += c;
    } else if (c == '/') {
      id += '_';
    } else {
      const auto code = static_cast<unsigned char>(c);
      id += {'X', kDigits[code >> 4U], kDigits[code & 15U]};
    }
  }
  return id;
}

/// Returns the text as a string of Jinja, which understands the escapes of JSON.
std::string jinja_text(std::string_view text) { return "\"" + escaped(text, Escape::json) + "\""; }

struct NumberRange {
  double min = 0;
  double max = 0;
  double step = kLeastStep;
};

/// Returns the values that a command may have; nullopt if there is no choice.
std::optional<NumberRange> range_of(const TagConfig& tag) {
  const auto type = value_range(tag.point);
  if (!type) return std::nullopt;
  const TagLimits& limits = tag.units->limits;
  NumberRange range;
  range.min = std::clamp(limits.min.value_or(type->least), -kGreatest, kGreatest);
  range.max = std::clamp(limits.max.value_or(type->greatest), -kGreatest, kGreatest);
  range.step = std::max(type->step, kLeastStep);
  return range.min < range.max ? std::optional(range) : std::nullopt;
}

std::string_view platform_of(const TagConfig& tag, bool writes) {
  const bool writable = writes && tag.writable && !tag.point.is_array;
  if (tag.point.type == DataType::boolean) return writable ? "switch" : "binary_sensor";
  if (!writable) return "sensor";
  if (tag.point.type == DataType::string) return "text";
  if (!tag.units->states.empty()) return "select";
  return range_of(tag) ? "number" : "sensor";
}

/// Returns the labels as options: each another one, without spaces at the ends, which Home
/// Assistant removes, and none that it reads as "no value".
TagStates options_of(const TagStates& states) {
  TagStates options;
  std::set<std::string> seen;
  for (const auto& [value, label] : states) {
    std::string option(trimmed(label));
    if (option.empty()) option = std::to_string(value);
    if (equal_but_for_case(option, "none")) option = "(" + option + ")";
    if (!seen.insert(option).second) option += " (" + std::to_string(value) + ")";
    seen.insert(option);
    options.emplace_back(value, std::move(option));
  }
  return options;
}

/// One entity of Home Assistant: a tag, or an element of an array.
struct Entity {
  const TagConfig* tag = nullptr;
  std::optional<std::uint16_t> element;
  std::string_view platform;

  std::string path() const {
    return std::string(tag->name) + (element ? "/" + std::to_string(*element) : "");
  }
  std::string key() const { return std::string(platform) + "_" + id_of(path()); }
};

template <class Visit>
void for_each_entity(const DeviceConfig& device, bool writes, Visit visit) {
  for (const TagConfig& tag : device.tags) {
    const std::string_view platform = platform_of(tag, writes);
    if (!tag.point.is_array) {
      visit(Entity{&tag, std::nullopt, platform});
      continue;
    }
    const std::uint16_t count = std::min(tag.point.count, kMostElements);
    for (std::uint16_t i = 0; i < count; ++i) visit(Entity{&tag, i, platform});
  }
}

/// Returns the ops that are buttons of the device.
std::span<const std::string_view> buttons_of(const DeviceConfig& device, bool writes) {
  const bool has_them = writes && device.commands.allow_run_stop && device.codec->plc() != nullptr;
  return std::span(kRunStop).first(has_them ? kRunStop.size() : 0);
}

/// Platform by key of all components of the device.
std::map<std::string, std::string> components_of(const DeviceConfig& device, bool writes) {
  std::map<std::string, std::string> components;
  for_each_entity(device, writes,
                  [&](const Entity& entity) { components.emplace(entity.key(), entity.platform); });
  for (const std::string_view op : buttons_of(device, writes))
    components.emplace("button_" + std::string(op), "button");
  return components;
}

/// Returns a template that renders the state from a sample. If the tag is bad, it renders None: the
/// state becomes unknown. A partial sample without the tag leaves the state as it is. `values` is a
/// method of a dict in Jinja, so the key stands in brackets.
std::string state_template(const Entity& entity, const TagStates& options) {
  const std::string name = "'" + std::string(entity.tag->name) + "'";
  std::string value = "value_json['values'][" + name + "]";
  if (entity.element) value += "[" + std::to_string(*entity.element) + "]";
  // Home Assistant ignores an empty text, except for a sensor of text and an entity `text`.
  std::string bad = "None";
  std::string missing;
  const bool is_text = entity.tag->point.type == DataType::string;
  if (entity.tag->point.type == DataType::boolean) {
    value = "'ON' if " + value + " else 'OFF'";
  } else if (!options.empty()) {
    std::string labels;
    for (const auto& [number, label] : options)
      labels += (labels.empty() ? "" : ", ") + std::to_string(number) + ": " + jinja_text(label);
    value = "{" + labels + "}.get(" + value + ", 'None')";
  }
  if (entity.platform == "sensor" && (is_text || !options.empty())) {
    missing = "{{ this.state if this.state not in ['unknown', 'unavailable'] else 'None' }}";
  } else if (entity.platform == "text") {
    missing = "{{ this.state if this.state not in ['unknown', 'unavailable'] else '' }}";
    bad = missing;  // it has no unknown state
  }
  return "{% if " + name + " in value_json['values'] %}{{ " + value + " }}{% elif " + name +
         " in value_json.bad | default({}) %}" + bad + "{% else %}" + missing + "{% endif %}";
}

/// Returns a template that renders a command, each time with another id. `rest`: its other keys.
std::string command_template(std::string_view op, const std::string& rest) {
  // Home Assistant's range() has at most 100,000 numbers.
  return R"({"id": "ha-{{ (as_timestamp(now()) * 1000) | int }}-{{ range(10000, 100000) | random }}",)"
         R"( "op": ")" +
         std::string(op) + "\", " + rest + R"("by": "homeassistant"})";
}

std::string write_template(const Entity& entity, const TagStates& options) {
  std::string value = "value";
  if (entity.platform == "text") {
    value = "value | to_json";
  } else if (entity.platform == "select") {
    std::string numbers;
    for (const auto& [number, label] : options)
      numbers += (numbers.empty() ? "" : ", ") + jinja_text(label) + ": " + std::to_string(number);
    value = "{" + numbers + "}[value]";
  }
  return command_template("write", R"("tag": ")" + std::string(entity.tag->name) +
                                       R"(", "value": {{ )" + value + " }}, ");
}

void write_command(json::Writer& out, const std::string& base, const std::string& text) {
  out.key("command_topic").string(base + "/command");
  out.key("command_template").string(text);
  out.key("qos").integer(std::int64_t{1});
}

/// Writes the keys that only this platform has.
void write_platform(json::Writer& out, const Entity& entity, const TagStates& options) {
  const Point& point = entity.tag->point;
  if (entity.platform == "switch") {
    out.key("payload_on").string("true").key("payload_off").string("false");
    out.key("state_on").string("ON").key("state_off").string("OFF");
  } else if (entity.platform == "binary_sensor") {
    out.key("payload_on").string("ON").key("payload_off").string("OFF");
  } else if (entity.platform == "text") {
    out.key("max").integer(
        static_cast<std::int64_t>(std::min(std::size_t{point.length}, kMostText)));
  } else if (!options.empty()) {
    if (entity.platform == "sensor") out.key("device_class").string("enum");
    out.key("options").begin_array();
    for (const auto& [value, label] : options) out.string(label);
    out.end_array();
  } else if (point.type != DataType::string) {
    if (!entity.tag->units->unit.empty())
      out.key("unit_of_measurement").string(entity.tag->units->unit);
    if (entity.platform == "sensor") {
      out.key("state_class").string("measurement");
    } else {
      const NumberRange range = *range_of(*entity.tag);
      out.key("min").number(range.min).key("max").number(range.max);
      out.key("step").number(range.step).key("mode").string("box");
    }
  }
}

/// `base`: {base}/{device}.
void write_entity(json::Writer& out, const DeviceConfig& device, const std::string& base,
                  const Entity& entity) {
  const TagStates options =
      entity.tag->point.type == DataType::boolean || entity.tag->point.type == DataType::string
          ? TagStates{}
          : options_of(entity.tag->units->states);
  out.key(entity.key()).begin_object().key("platform").string(entity.platform);
  out.key("unique_id").string(id_of(base + "/" + entity.path()));
  std::string name(entity.tag->name);
  if (entity.element) name += " " + std::to_string(*entity.element);
  out.key("name").string(name);
  out.key("state_topic").string(base + "/data/" + device.groups.at(entity.tag->group).name);
  out.key("value_template").string(state_template(entity, options));
  write_platform(out, entity, options);
  if (entity.platform != "sensor" && entity.platform != "binary_sensor")
    write_command(out, base, write_template(entity, options));
  out.end_object();
}

void write_availability(json::Writer& out, const std::string& topic, std::string_view text) {
  out.begin_object().key("topic").string(topic).key("value_template").string(text).end_object();
}

}  // namespace

HomeAssistantProfile::HomeAssistantProfile(const Config& config, const ProfileConfig& profile,
                                           std::string version, HearsCommands hears_commands)
    : config_(config),
      prefix_(profile.prefix),
      version_(std::move(version)),
      writes_(hears_commands == HearsCommands::yes),
      own_ids_(id_of(config.base_topic() + "/")) {
  for (std::uint32_t device = 0; device < config_.devices.size(); ++device) add(device);
}

void HomeAssistantProfile::add(std::uint32_t device) {
  const DeviceConfig& of = config_.devices[device];
  if (of.is_vacant() || components_of(of, writes_).empty()) return;
  devices_[object_id(device)] = device;
  for (const TagConfig& tag : of.tags)
    if (tag.point.is_array && tag.point.count > kMostElements)
      log::warn("homeassistant",
                {{"device", of.name},
                 {"tag", std::string(tag.name)},
                 {"elements", std::to_string(tag.point.count)},
                 {"note", "Home Assistant gets the first " + std::to_string(kMostElements)}});
}

std::string HomeAssistantProfile::object_id(std::uint32_t device) const {
  return id_of(config_.base_topic() + "/" + config_.devices.at(device).name);
}

std::string HomeAssistantProfile::topic_of(const std::string& object_id) const {
  return prefix_ + "/device/" + object_id + std::string(kConfig);
}

// With No Local the broker would hide what the agent published before its restart.
std::vector<Subscription> HomeAssistantProfile::subscriptions() const {
  return {{prefix_ + "/status", /*no_local=*/false}, {topic_of("+"), /*no_local=*/false}};
}

void HomeAssistantProfile::connection_began(const Connected&) {
  for (const auto& [id, device] : devices_) due_.insert(device);
}

void HomeAssistantProfile::hear(const Message& message) {
  if (message.topic == prefix_ + "/status") {
    if (message.payload == "online") connection_began({});
    return;
  }
  const std::string begin = prefix_ + "/device/";
  if (!message.topic.starts_with(begin) || !message.topic.ends_with(kConfig)) return;
  if (message.topic.size() < begin.size() + kConfig.size()) return;
  const std::string id =
      message.topic.substr(begin.size(), message.topic.size() - begin.size() - kConfig.size());
  // Another agent may have our base as its root.
  if (!id.starts_with(own_ids_) || id.find('_', own_ids_.size()) != id.npos) return;
  if (!message.payload.starts_with(kBegin)) return;
  const auto found = devices_.find(id);
  if (found == devices_.end()) {
    cleared_.insert(message.topic);
    return;
  }
  // Components from before the agent's restart. Our own messages come back here, too: they have
  // none that is not wanted, or have it without settings, which removes it.
  const auto heard = parsed_json(message.payload);
  const Components wanted = components_of(config_.devices[found->second], writes_);
  for (const auto& [key, component] : member(heard, "components").items()) {
    const auto& platform = member(component, "platform");
    if (wanted.contains(key) || component.size() < 2 || !platform.is_string()) continue;
    removed_[found->second].emplace(key, platform.get<std::string>());
    due_.insert(found->second);
  }
}

void HomeAssistantProfile::device_state(const DeviceStatus& status) {
  if (std::exchange(models_[status.device], status.model) == status.model) return;
  if (devices_.contains(object_id(status.device))) due_.insert(status.device);
}

void HomeAssistantProfile::change(const ConfigChange& change) {
  for (const std::uint32_t device : change.devices_end) {
    std::erase_if(devices_, [device](const auto& each) { return each.second == device; });
    models_.erase(device);
    due_.erase(device);
    removed_.erase(device);
  }
  for (const std::uint32_t device : change.devices_begin) {
    add(device);
    const std::string id = object_id(device);
    if (!devices_.contains(id)) continue;
    due_.insert(device);
    cleared_.erase(topic_of(id));
    const auto before = described_.find(id);
    if (before == described_.end()) continue;
    const Components wanted = components_of(config_.devices[device], writes_);
    for (const auto& [key, platform] : components_of(before->second, writes_))
      if (!wanted.contains(key)) removed_[device].emplace(key, platform);
  }
  std::erase_if(described_, [this](const auto& each) {
    if (devices_.contains(each.first)) return false;
    cleared_.insert(topic_of(each.first));
    return true;
  });
}

std::vector<Publication> HomeAssistantProfile::due(SteadyTime, std::int64_t) {
  std::vector<Publication> due;
  if (!cleared_.empty()) {
    due.push_back(retained(cleared_.extract(cleared_.begin()).value()));
  } else if (!due_.empty()) {
    const std::uint32_t device = *due_.begin();
    // A message without them follows, as the new state to retain.
    const auto removed = removed_.extract(device);
    if (removed.empty()) due_.erase(device);
    due.push_back(discovery(device, removed.empty() ? Components{} : removed.mapped()));
    described_[object_id(device)] = config_.devices[device];
  }
  return due;
}

Publication HomeAssistantProfile::discovery(std::uint32_t device, const Components& removed) const {
  const DeviceConfig& of = config_.devices[device];
  const std::string base = config_.base_topic() + "/" + of.name;
  const std::string id = object_id(device);
  // kBegin depends on the order.
  json::Writer out;
  out.begin_object().key("origin").begin_object().key("name").string("fxagent");
  out.key("sw_version").string(version_).end_object();
  out.key("device").begin_object().key("identifiers").begin_array().string(id).end_array();
  out.key("name").string(config_.id + " " + of.name);
  const auto model = models_.find(device);
  std::string text(of.protocol != nullptr ? of.protocol->name : "");
  if (model != models_.end() && !model->second.empty())
    text = model->second + (text.empty() ? "" : " (" + text + ")");
  if (!text.empty()) out.key("model").string(text);
  out.end_object();
  out.key("availability_mode").string("all").key("availability").begin_array();
  write_availability(out, config_.base_topic() + "/state", "{{ value_json.state }}");
  write_availability(out, base + "/state",
                     "{{ 'online' if value_json.state in ['online', 'degraded'] else 'offline' }}");
  out.end_array();
  out.key("components").begin_object();
  for (const auto& [key, platform] : removed)
    out.key(key).begin_object().key("platform").string(platform).end_object();
  for_each_entity(of, writes_, [&](const Entity& entity) { write_entity(out, of, base, entity); });
  for (const std::string_view op : buttons_of(of, writes_)) {
    out.key("button_" + std::string(op)).begin_object().key("platform").string("button");
    out.key("unique_id").string(id_of(base + "/button/" + std::string(op)));
    out.key("name").string(op);
    write_command(out, base, command_template(op, ""));
    out.end_object();
  }
  out.end_object().end_object();
  return retained(topic_of(id), out.take());
}

}  // namespace fxagent
