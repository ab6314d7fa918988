#include "agent/uplink/profile/thingsboard_profile.h"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <utility>

#include "agent/text/json.h"
#include "agent/text/json_writer.h"
#include "agent/uplink/payload/json_payload.h"

namespace fxagent {
namespace {

constexpr std::string_view kConnectTopic = "v1/gateway/connect";
constexpr std::string_view kDisconnectTopic = "v1/gateway/disconnect";
constexpr std::string_view kTelemetryTopic = "v1/gateway/telemetry";
constexpr std::string_view kAttributesTopic = "v1/gateway/attributes";
constexpr std::string_view kRpcTopic = "v1/gateway/rpc";

constexpr std::string_view kSetMethod = "set_";
constexpr std::string_view kGetMethod = "get_";
constexpr std::string_view kMethods =
    "write, force_on, force_off, read, run, stop, set_{tag}, get_{tag}";
// ThingsBoard refuses messages above 64 KiB by default.
constexpr std::size_t kAttributeBytes = 16384;
// Levels of a request: the message, its data, the params, a target, an array.
constexpr int kMaxRequestDepth = 8;

Publication message_on(std::string_view topic, std::string payload) {
  return {.topic = std::string(topic), .payload = std::move(payload)};
}

/// Returns {"`device`":`content`}.
std::string of_device(std::string_view device, std::string_view content) {
  json::Writer out(device.size() + content.size() + 8);
  return out.begin_object().key(device).raw(content).end_object().take();
}

Publication connect_message(const std::string& device, std::string_view type) {
  json::Writer out;
  out.begin_object().key("device").string(device).key("type").string(type).end_object();
  return message_on(kConnectTopic, out.take());
}

Publication disconnect_message(const std::string& device) {
  json::Writer out;
  out.begin_object().key("device").string(device).end_object();
  return message_on(kDisconnectTopic, out.take());
}

// ---- samples ------------------------------------------------------------------------------------

using Changes = std::vector<std::pair<std::string_view, std::optional<BadReason>>>;

/// Writes the value, each element of an array with a key of its own: ThingsBoard draws numbers and
/// compares them in alarm rules, but a JSON array is only text there. Returns false, having written
/// nothing, if JSON cannot represent the value.
bool write_reading(json::Writer& out, const RecordedReading& reading) {
  const std::string text = json::bare_value(reading);
  if (text == "null") return false;
  if (!reading.value.is_array) {
    out.key(reading.name).raw(text);
    return true;
  }
  RecordedReading element = reading;
  element.value.is_array = false;
  for (std::size_t i = 0; i < reading.value.items.size(); ++i) {
    element.value.items.assign(1, reading.value.items[i]);
    out.key(std::string(reading.name) + "_" + std::to_string(i)).raw(json::bare_value(element));
  }
  return true;
}

/// Returns {"ts":…,"values":{…}}; empty if it would have no values. `changes` gets the tags whose
/// reason is not the one in `published`.
std::string row_of(const SampleRecord& sample, const ThingsBoardProfile::Reasons& published,
                   Changes& changes) {
  json::Writer values;
  values.begin_object();
  bool has_any = false;
  for (const RecordedReading& reading : sample.readings) {
    const bool is_good = write_reading(values, reading);
    const auto bad =
        is_good ? std::nullopt : std::optional(reading.bad.value_or(BadReason::bad_value));
    has_any = has_any || (is_good && (!reading.value.is_array || !reading.value.items.empty()));
    const auto last = published.find(reading.name);
    if (last != published.end() && last->second == bad) continue;
    changes.emplace_back(reading.name, bad);
    values.key(std::string(reading.name) + "_bad").string(bad ? to_string(*bad) : "");
    has_any = true;
  }
  if (!has_any) return "";
  json::Writer row;
  row.begin_object().key("ts").integer(sample.ts_ms);
  return row.key("values").raw(values.end_object().take()).end_object().take();
}

void remember(const Changes& changes, ThingsBoardProfile::Reasons& published) {
  for (const auto& [tag, bad] : changes) published.insert_or_assign(std::string(tag), bad);
}

// ---- attributes ---------------------------------------------------------------------------------

std::string state_attributes(const DeviceStatus& status) {
  json::Writer out;
  out.begin_object().key("state").string(to_string(status.state));
  out.key("since").integer(status.since_ms).key("reason").string(status.reason);
  out.key("reason_text").string(status.reason_text).key("model").string(status.model).key("run");
  status.run ? out.boolean(*status.run) : out.string("");
  return out.end_object().take();
}

void write_units(json::Writer& out, const TagConfig& tag) {
  const std::string name(tag.name);
  const TagUnits& units = *tag.units;
  if (!units.unit.empty()) out.key(name + "_unit").string(units.unit);
  if (units.limits.min) out.key(name + "_min").number(*units.limits.min);
  if (units.limits.max) out.key(name + "_max").number(*units.limits.max);
  if (!units.description.empty()) out.key(name + "_description").string(units.description);
  if (units.states.empty()) return;
  out.key(name + "_states").begin_object();
  for (const auto& [value, label] : units.states) out.key(std::to_string(value)).string(label);
  out.end_object();
}

/// Returns units, limits, labels and descriptions of the tags, in as many messages as they need.
std::vector<Publication> tag_attributes(const DeviceConfig& device) {
  std::vector<Publication> messages;
  std::string content;
  const auto flush = [&] {
    if (content.empty()) return;
    messages.push_back(message_on(kAttributesTopic, of_device(device.name, "{" + content + "}")));
    content.clear();
  };
  for (const TagConfig& tag : device.tags) {
    json::Writer out;
    write_units(out, tag);
    const std::string text = out.take();
    if (text.empty()) continue;
    if (content.size() + text.size() > kAttributeBytes) flush();
    content += (content.empty() ? "" : ",") + text;
  }
  flush();
  return messages;
}

// ---- requests -----------------------------------------------------------------------------------

struct Request {
  std::string device;
  std::int64_t id = 0;
  nlohmann::json data;
  /// A key stands twice, the nesting is too deep, or a number would become 0. Admission names the
  /// fault.
  bool is_faulty = false;
};

/// Returns nullopt if the message cannot be answered: it has no device or no id.
std::optional<Request> parse_request(const std::string& text) {
  Request request;
  request.is_faulty = !vanishing_number(text).empty();
  std::vector<std::set<std::string>> open;  // keys of the objects around
  const auto check = [&](int depth, nlohmann::json::parse_event_t event, nlohmann::json& value) {
    using Event = nlohmann::json::parse_event_t;
    if (event == Event::object_start) open.emplace_back();
    if (event == Event::object_end) open.pop_back();
    if (event == Event::key && !open.back().insert(value.get<std::string>()).second)
      request.is_faulty = true;
    if (depth <= kMaxRequestDepth) return true;
    request.is_faulty = true;
    return false;
  };
  const auto message = nlohmann::json::parse(text, check, /*allow_exceptions=*/false);
  const auto& device = member(message, "device");
  request.data = member(message, "data");
  const auto& id = member(request.data, "id");
  if (!device.is_string() || !id.is_number_integer()) return std::nullopt;
  request.device = device.get<std::string>();
  request.id = id.get<std::int64_t>();
  return request;
}

/// Returns the command of a request. A method of an unknown name becomes the `op`, and parameters
/// of a wrong form a key, so that admission refuses them with a reason. Nullopt: no method.
std::optional<std::string> command_of(const nlohmann::json& data, const std::string& id,
                                      std::int64_t expires_ms) {
  const auto& named = member(data, "method");
  if (!named.is_string()) return std::nullopt;
  const auto method = named.get<std::string>();
  const auto& params = member(data, "params");
  json::Writer out;
  out.begin_object().key("id").string(id);
  if (!params.is_object() || !params.contains("expires")) out.key("expires").integer(expires_ms);
  if (method.starts_with(kSetMethod)) {
    out.key("op").string("write").key("tag").string(method.substr(kSetMethod.size()));
    out.key("value").raw(dumped(params));
  } else if (method.starts_with(kGetMethod)) {
    out.key("op").string("read").key("tag").string(method.substr(kGetMethod.size()));
  } else {
    out.key("op").string(method);
    if (!op_from(method) || params.is_null()) return out.end_object().take();
    if (!params.is_object()) return out.key("params").raw(dumped(params)).end_object().take();
    // Admission refuses an unknown key. Those of the command itself would stand in it twice.
    for (const auto& [key, value] : params.items())
      out.key(key == "id" || key == "op" ? "params." + key : key).raw(dumped(value));
  }
  return out.end_object().take();
}

}  // namespace

// ---- session ------------------------------------------------------------------------------------

ThingsBoardProfile::ThingsBoardProfile(const Config& config, const ProfileConfig& profile,
                                       RelayCommand relay, std::function<std::string()> new_id)
    : config_(config),
      name_(name_of(profile)),
      deadline_(profile.deadline),
      relay_(std::move(relay)),
      new_id_(std::move(new_id)),
      states_(config.devices.size()),
      devices_(config.devices.size()) {
  for (std::uint32_t i = 0; i < devices_.size(); ++i) prepare(i);
}

void ThingsBoardProfile::prepare(std::uint32_t index) {
  const DeviceConfig& device = config_.devices.at(index);
  if (device.is_vacant()) return;
  devices_.at(index) = Device{.name = device.name};
  index_[device.name] = index;
}

std::vector<Subscription> ThingsBoardProfile::subscriptions() const {
  if (!relay_) return {};
  return {{std::string(kRpcTopic), /*no_local=*/true}};
}

void ThingsBoardProfile::connection_began(const Connected&) {
  for (std::uint32_t i = 0; i < devices_.size(); ++i)
    if (states_.all()[i]) changed_.insert(i);
}

void ThingsBoardProfile::connection_ended() {
  ++session_;
  for (Device& device : devices_) device.is_connected = device.is_described = false;
  gone_.clear();
  answers_.clear();
  reasons_.clear();
}

void ThingsBoardProfile::device_state(const DeviceStatus& status) {
  states_.set(status);
  devices_.at(status.device).is_alive = status.is_alive();
  changed_.insert(status.device);
}

void ThingsBoardProfile::change(const ConfigChange& change) {
  for (const std::uint32_t i : change.devices_end) {
    Device& device = devices_.at(i);
    if (device.is_connected) gone_.push_back(device.name);
    index_.erase(device.name);
    reasons_.erase(device.name);
    changed_.erase(i);
    device = Device{};
  }
  states_.change(change);
  devices_.resize(config_.devices.size());
  for (const std::uint32_t i : change.devices_begin) prepare(i);
}

std::vector<Publication> ThingsBoardProfile::due(SteadyTime, std::int64_t) {
  std::vector<Publication> messages;
  if (!answers_.empty()) {
    messages.push_back(std::move(answers_.front()));
    answers_.pop_front();
  } else if (!gone_.empty()) {
    for (const std::string& name : std::exchange(gone_, {}))
      messages.push_back(disconnect_message(name));
  } else if (!changed_.empty()) {
    messages = announce(changed_.extract(changed_.begin()).value());
  }
  return messages;
}

/// A lost device is connected for its attributes, which ThingsBoard takes only of connected ones.
std::vector<Publication> ThingsBoardProfile::announce(std::uint32_t index) {
  Device& device = devices_.at(index);
  const DeviceConfig& config = config_.devices.at(index);
  std::vector<Publication> messages;
  if (!std::exchange(device.is_connected, device.is_alive))
    messages.push_back(connect_message(device.name, config.protocol == nullptr
                                                        ? std::string_view("default")
                                                        : config.protocol->name));
  if (!std::exchange(device.is_described, true))
    for (Publication& each : tag_attributes(config)) messages.push_back(std::move(each));
  messages.push_back(message_on(
      kAttributesTopic, of_device(device.name, state_attributes(*states_.all().at(index)))));
  if (!device.is_alive) messages.push_back(disconnect_message(device.name));
  return messages;
}

// ---- samples ------------------------------------------------------------------------------------

/// Telemetry would connect a lost device again: its samples wait until it is back.
bool ThingsBoardProfile::may_send(const std::string& device) const {
  const auto found = index_.find(device);
  return found == index_.end() || devices_[found->second].is_alive;
}

std::vector<Publication> ThingsBoardProfile::sample(const StreamKey& stream,
                                                    const SampleRecord& sample) {
  Reasons& reasons = reasons_[stream.device];
  Changes changes;
  const std::string row = row_of(sample, reasons, changes);
  if (row.empty()) return {};
  remember(changes, reasons);
  return {message_on(kTelemetryTopic, of_device(stream.device, "[" + row + "]"))};
}

/// Gathers rows of one device. Each message begins with the reasons of all tags, because the
/// messages between two of them may be lost.
class ThingsBoardProfile::History final : public SampleHistory {
 public:
  History(const ThingsBoardProfile& profile, std::size_t max_bytes)
      : profile_(profile), max_bytes_(max_bytes) {}

  bool add(const SampleRecord& sample) override {
    Changes changes;
    const std::string row = row_of(sample, reasons_, changes);
    if (row.empty()) return true;
    if (!rows_.empty() && rows_.size() + row.size() + 2 > max_bytes_) return false;
    rows_ += (rows_.empty() ? "[" : ",") + row;
    remember(changes, reasons_);
    return true;
  }
  std::vector<Publication> take(const StreamKey& stream) override {
    const std::string& device = stream.device;
    Publication rows =
        message_on(kTelemetryTopic, of_device(device, rows_.empty() ? "[]" : rows_ + "]"));
    if (profile_.index_.contains(device)) return {std::move(rows)};
    // A config change has removed the device.
    return {connect_message(device, "default"), std::move(rows), disconnect_message(device)};
  }

 private:
  const ThingsBoardProfile& profile_;
  const std::size_t max_bytes_;
  std::string rows_;
  Reasons reasons_;
};

std::shared_ptr<SampleHistory> ThingsBoardProfile::begin_history(std::size_t max_bytes) {
  return std::make_shared<History>(*this, max_bytes);
}

// ---- commands -----------------------------------------------------------------------------------

void ThingsBoardProfile::hear(const Message& message) {
  if (!relay_ || message.topic != kRpcTopic) return;
  const auto request = parse_request(message.payload);
  if (!request)
    return ignore_command(message, "it cannot be answered: not JSON, or no device or data.id");
  if (is_for_link(config_, message, request->device)) return;
  std::chrono::milliseconds deadline = deadline_;
  if (const auto found = index_.find(request->device); found != index_.end())
    deadline = std::min<std::chrono::milliseconds>(
        deadline, config_.devices[found->second].commands.max_expiry);
  RelayedCommand command = relayed_command(message, request->device, name_);
  command.ops = kMethods;
  command.reply = [this, device = request->device, id = request->id,
                   session = session_](const std::string& result) {
    // A server that has restarted counts from 0 again: a late answer would be that to another one.
    if (session != session_) return;
    json::Writer out;
    out.begin_object().key("device").string(device).key("id").integer(id);
    answers_.push_back(message_on(kRpcTopic, out.key("data").raw(result).end_object().take()));
  };
  std::optional<std::string> translated;
  if (!request->is_faulty)
    translated = command_of(request->data, new_id_(), message.received_ms + deadline.count());
  // Admission refuses the message itself, which is no command, with its own words.
  command.payload = translated ? std::move(*translated) : message.payload;
  relay_(std::move(command));
}

}  // namespace fxagent
