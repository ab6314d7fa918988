#include "agent/uplink/sparkplug/typed_commands.h"

#include <algorithm>
#include <iterator>
#include <nlohmann/json.hpp>
#include <type_traits>
#include <utility>
#include <variant>

#include "agent/json_member.h"
#include "agent/json_writer.h"
#include "agent/log/log.h"
#include "agent/sha256.h"
#include "agent/text.h"
#include "agent/uplink/profile/heard_command.h"
#include "agent/uplink/sparkplug/sparkplug_c.pb.h"

namespace fxagent {
namespace {

using sparkplug::Type;
using sparkplug_c::Metric;
using sparkplug_c::Packet;

constexpr std::string_view kWrite = "Write/";
constexpr std::string_view kRun = "Run";
constexpr std::string_view kStop = "Stop";
constexpr const char* kValue = "value";  // argument and result of a write
constexpr std::uint32_t kCommand = 35;   // data type
constexpr std::size_t kLongestId = 64;   // of a command of the agent
constexpr std::size_t kBytesOfSeq = 11;

std::uint64_t stamp(std::int64_t utc_ms) { return static_cast<std::uint64_t>(utc_ms) * 1'000'000; }

std::uint32_t number(Type type) { return static_cast<std::uint32_t>(type); }

void set_value(sparkplug_c::TypedValue& out, const Value& value, Type type) {
  out.set_datatype(number(type));
  const bool is_short = type != Type::int64 && type != Type::uint64;
  const auto set = [&](const auto& each) {
    using Each = std::remove_cvref_t<decltype(each)>;
    if constexpr (std::is_same_v<Each, std::monostate>) {
      out.set_is_null(true);
    } else if constexpr (std::is_same_v<Each, bool>) {
      out.set_boolean_value(each);
    } else if constexpr (std::is_same_v<Each, std::int64_t>) {
      is_short ? out.set_int32_value(static_cast<std::int32_t>(each)) : out.set_int64_value(each);
    } else if constexpr (std::is_same_v<Each, std::uint64_t>) {
      is_short ? out.set_uint32_value(static_cast<std::uint32_t>(each))
               : out.set_uint64_value(each);
    } else if constexpr (std::is_same_v<Each, float>) {
      out.set_float_value(each);
    } else if constexpr (std::is_same_v<Each, double>) {
      out.set_double_value(each);
    } else if constexpr (std::is_same_v<Each, std::string>) {
      out.set_string_value(each);
    } else {
      out.set_bytes_value(each.bytes);
    }
  };
  std::visit(set, sparkplug::typed(value, type));
}

sparkplug::TypedValue received(const sparkplug_c::TypedValue& value) {
  using Of = sparkplug_c::TypedValue;
  switch (value.value_case()) {
    case Of::kInt32Value:
      return std::int64_t{value.int32_value()};
    case Of::kInt64Value:
      return std::int64_t{value.int64_value()};
    case Of::kUint32Value:
      return std::uint64_t{value.uint32_value()};
    case Of::kUint64Value:
      return std::uint64_t{value.uint64_value()};
    case Of::kFloatValue:
      return value.float_value();
    case Of::kDoubleValue:
      return value.double_value();
    case Of::kBooleanValue:
      return value.boolean_value();
    case Of::kStringValue:
      return value.string_value();
    case Of::kBytesValue:
      return sparkplug::Packed{value.bytes_value()};
    case Of::VALUE_NOT_SET:
      break;
  }
  return {};
}

// ---- definitions --------------------------------------------------------------------------------

sparkplug_c::Command& define(Packet& packet, std::string name) {
  Metric& metric = *packet.add_metrics();
  metric.set_name(std::move(name));
  metric.set_timestamp(packet.timestamp());
  metric.set_datatype(kCommand);
  return *metric.mutable_command();
}

void add_property(Metric& metric, const char* key, const Value& value, Type type) {
  metric.mutable_properties()->add_keys(key);
  set_value(*metric.mutable_properties()->add_values(), value, type);
}

/// The properties are those of a metric in the profile `sparkplug`.
void define_write(Packet& packet, const TagConfig& tag) {
  sparkplug_c::Command& command = define(packet, std::string(kWrite) + std::string(tag.name));
  Metric& argument = *command.add_arguments();
  argument.set_name(kValue);
  argument.set_datatype(number(sparkplug::type_of(tag.point)));
  *command.add_results() = argument;
  const TagUnits& units = *tag.units;
  if (!units.unit.empty())
    add_property(argument, "engUnit", Value(Scalar(units.unit)), Type::string);
  if (!units.description.empty())
    add_property(argument, "documentation", Value(Scalar(units.description)), Type::string);
  if (units.limits.min)
    add_property(argument, "engLow", Value(Scalar(*units.limits.min)), Type::real64);
  if (units.limits.max)
    add_property(argument, "engHigh", Value(Scalar(*units.limits.max)), Type::real64);
}

/// Finds the type of the tag that a command writes; nullopt if the device has no such tag.
std::optional<Type> type_of(const DeviceConfig& device, std::string_view tag) {
  const auto found = std::ranges::find_if(
      device.tags, [&](const TagConfig& each) { return std::string_view(each.name) == tag; });
  if (found == device.tags.end()) return std::nullopt;
  return sparkplug::type_of((*found).point);
}

// ---- results ------------------------------------------------------------------------------------

/// Code 0 is success; the others count the words of the contract in their order.
std::uint64_t code_of(CommandStatus status) {
  const auto found = std::ranges::find(kCommandStatuses, status);
  return static_cast<std::uint64_t>(found - kCommandStatuses.begin());
}

std::uint64_t code_of(std::string_view word) {
  const auto found = std::ranges::find(kCommandStatuses, word,
                                       [](CommandStatus status) { return to_string(status); });
  return static_cast<std::uint64_t>(found - kCommandStatuses.begin());
}

/// Returns the words of a result: "REJECTED: out_of_range: …", "SUCCEEDED, ACK".
std::string message_of(const nlohmann::json& result) {
  std::string out = text_at(result, "status");
  if (const std::string plc = text_at(result, "plc"); !plc.empty()) out += ", " + plc;
  for (const char* key : {"reason", "detail"})
    if (const std::string text = text_at(result, key); !text.empty()) out += ": " + text;
  if (const auto& first = member(result, "first"); first.is_object())
    out += "; the first had " + message_of(first);
  return out;
}

/// An integer beyond 2^53 is a text in a result.
std::optional<Scalar> result_scalar(const nlohmann::json& json, Type type) {
  auto scalar = scalar_of(json);
  const bool is_text = type == Type::string || type == Type::string_array;
  const auto* digits = scalar && !is_text ? std::get_if<std::string>(&*scalar) : nullptr;
  if (digits == nullptr) return scalar;
  if (const auto integer = number_from<std::int64_t>(*digits)) return Scalar(*integer);
  return Scalar(BigInteger{*digits});
}

Value result_value(const nlohmann::json& json, Type type) {
  Value value;
  value.is_array = json.is_array();
  for (const nlohmann::json& item : json.is_array() ? json : nlohmann::json::array({json}))
    if (auto scalar = result_scalar(item, type)) value.items.push_back(*std::move(scalar));
  return value;
}

/// Returns the id of the agent's command. Another host may use the same correlation id.
std::string id_of(const std::string& source, const std::string& correlation_id) {
  std::string id = source + "/" + correlation_id;
  return id.size() <= kLongestId ? id : to_text(sha256(id));
}

}  // namespace

TypedCommandsProfile::TypedCommandsProfile(const Config& config, const ProfileConfig& profile,
                                           TakeOrder take_order,
                                           std::function<std::int64_t()> utc_ms)
    : config_(config),
      name_(name_of(profile)),
      prefix_("spCv1.0/" + profile.group + "/"),
      node_(profile.node),
      take_order_(std::move(take_order)),
      utc_ms_(std::move(utc_ms)),
      births_(config, profile.broker,
              {profile.host.empty() ? "" : "spCv1.0/STATE/" + profile.host, /*old_state=*/false}) {}

// ---- session ------------------------------------------------------------------------------------

Publication TypedCommandsProfile::message(std::string_view verb, const std::string& device,
                                          const Packet& packet) const {
  return {.topic = prefix_ + std::string(verb) + "/" + node_ + (device.empty() ? "" : "/" + device),
          .payload = packet.SerializeAsString(),
          .qos = 0};
}

Will TypedCommandsProfile::last_will() {
  births_.next_session();
  const Publication death = node_death();
  return {death.topic, death.payload, Retain::no};
}

std::vector<Subscription> TypedCommandsProfile::subscriptions() const {
  std::vector<Subscription> filters;
  for (const char* verb : {"REBIRTH/", "NCMD/"})
    filters.push_back({.filter = prefix_ + verb + node_, .qos = 0});
  filters.push_back({.filter = prefix_ + "DCMD/" + node_ + "/+", .qos = 0});
  if (!births_.host_topic().empty()) filters.push_back({.filter = births_.host_topic()});
  return filters;
}

void TypedCommandsProfile::connection_began(const Connected& connected) {
  births_.connection_began(connected);
  is_asked_ = false;
}

void TypedCommandsProfile::refused() {
  births_.request_rebirth();
  is_asked_ = false;
}

std::vector<Publication> TypedCommandsProfile::farewell(std::int64_t) {
  if (!births_.is_born()) return {};
  return {node_death()};
}

/// Has the number of the session and nothing else, since it is the last will, too.
Publication TypedCommandsProfile::node_death() const {
  Packet packet;
  packet.set_bd_seq(births_.session());
  return message("NDEATH", "", packet);
}

// ---- births and answers -------------------------------------------------------------------------

/// Births that a host asked for have verbs of their own. They repeat the numbers before that of the
/// next message, so that other hosts miss none.
std::vector<Publication> TypedCommandsProfile::due(SteadyTime now, std::int64_t utc_ms) {
  using Step = sparkplug::BirthSchedule::Step;
  struct Made {
    std::string verb, device;
    Packet packet;
  };
  std::vector<Made> made;
  const std::vector<Step> steps = births_.due(now);
  const bool repeats =
      !steps.empty() && steps[0].kind == Step::Kind::node_birth && std::exchange(is_asked_, false);
  for (const auto& [kind, index, device] : steps) {
    Packet packet;
    packet.set_timestamp(stamp(utc_ms));
    if (kind == Step::Kind::node_birth) {
      packet.set_bd_seq(births_.session());
      made.push_back({repeats ? "NREBIRTH" : "NBIRTH", "", std::move(packet)});
      if (!repeats) seq_ = 0;
    } else if (kind == Step::Kind::device_death) {
      made.push_back({"DDEATH", device, std::move(packet)});
    } else if (auto birth = device_birth(index, utc_ms)) {
      made.push_back({repeats ? "DREBIRTH" : "DBIRTH", device, std::move(*birth)});
    }
  }
  if (repeats) seq_ -= made.size();
  std::vector<Publication> messages;
  for (auto& [verb, device, packet] : made) {
    packet.set_seq(seq_++);
    messages.push_back(message(verb, device, packet));
  }
  if (!births_.is_born()) return messages;
  std::ranges::move(std::exchange(answers_, {}), std::back_inserter(messages));
  return messages;
}

/// Returns nullopt if the broker does not accept the size.
std::optional<Packet> TypedCommandsProfile::device_birth(std::uint32_t index, std::int64_t utc_ms) {
  const DeviceConfig& device = config_.devices.at(index);
  Packet packet;
  packet.set_timestamp(stamp(utc_ms));
  for (const TagConfig& tag : device.tags)
    if (tag.writable) define_write(packet, tag);
  if (device.commands.allow_run_stop && device.codec->plc() != nullptr)
    for (const std::string_view name : {kRun, kStop}) define(packet, std::string(name));
  if (!births_.accepts_birth(index, packet.ByteSizeLong() + kBytesOfSeq)) return std::nullopt;
  return packet;
}

void TypedCommandsProfile::send(const Request& request, Metric answer) {
  Packet packet;
  packet.set_timestamp(stamp(utc_ms_()));
  answer.set_name(request.name);
  answer.set_timestamp(packet.timestamp());
  answer.set_datatype(kCommand);
  answer.mutable_command()->set_correlation_id(request.correlation_id);
  *packet.add_metrics() = std::move(answer);
  answers_.push_back(message(request.device.empty() ? "NRESP" : "DRESP", request.device, packet));
}

void TypedCommandsProfile::reject(const Request& request, std::string_view why) {
  Metric answer;
  sparkplug_c::Status& status = *answer.mutable_command()->mutable_status();
  status.set_code(code_of(CommandStatus::rejected));
  status.set_message(std::string(to_string(CommandStatus::rejected)) + ": " + std::string(why));
  send(request, std::move(answer));
}

void TypedCommandsProfile::answer(const Request& request, const std::string& result) {
  const auto json = nlohmann::json::parse(result, nullptr, /*allow_exceptions=*/false);
  Metric answer;
  sparkplug_c::Command& command = *answer.mutable_command();
  command.mutable_status()->set_code(code_of(text_at(json, "status")));
  command.mutable_status()->set_message(message_of(json));
  if (request.type && command.status().code() == code_of(CommandStatus::succeeded)) {
    Metric& value = *command.add_results();
    value.set_name(kValue);
    value.set_datatype(number(*request.type));
    set_value(*value.mutable_value(), result_value(member(json, kValue), *request.type),
              *request.type);
  }
  send(request, std::move(answer));
}

// ---- requests -----------------------------------------------------------------------------------

void TypedCommandsProfile::hear(const Message& message) {
  if (births_.hear(message)) return;
  Packet packet;
  if (message.payload.size() > kMaxMessageBytes || !packet.ParseFromString(message.payload))
    return ignore_command(message, "not a Sparkplug C payload of at most 64 KiB");
  if (message.topic == prefix_ + "REBIRTH/" + node_) {
    if (message.retained)
      return ignore_command(message, "it is retained, so it was sent for an earlier time");
    if (!births_.is_rebirth_due()) is_asked_ = true;
    return births_.request_rebirth();
  }
  if (!births_.is_host_online())
    return ignore_command(message, "the node is not born: its primary host is offline");
  const std::string devices = prefix_ + "DCMD/" + node_ + "/";
  const bool is_for_device = message.topic.starts_with(devices);
  const std::string device = is_for_device ? message.topic.substr(devices.size()) : "";
  if (is_for_device && device.empty()) return ignore_command(message, "no device");
  if (packet.metrics_size() > static_cast<int>(kMostTargets))
    return ignore_command(message, "more than " + std::to_string(kMostTargets) + " commands");
  for (const Metric& metric : packet.metrics()) carry_out(message, device, packet.source(), metric);
}

/// Each request has one answer. One without a command has nothing to which an answer could belong.
void TypedCommandsProfile::carry_out(const Message& message, const std::string& device,
                                     const std::string& source, const Metric& metric) {
  if (!metric.has_command())
    return ignore_command(
        message, log::excerpt(metric.name()) + " is not a command: write a tag with Write/{tag}");
  Request request{device, metric.name(), metric.command().correlation_id(), {}};
  const auto index = births_.index_of(device);
  if (device.empty()) return reject(request, "bad_op: the node has no commands, its devices have");
  if (!index) return reject(request, "unknown_device: the agent has no such device");
  if (source.empty())
    return reject(request, "missing_id: the payload has no source, the host's id");
  if (request.correlation_id.empty())
    return reject(request, "missing_id: the command has no correlation_id");
  json::Writer command;
  command.begin_object().key("id").string(id_of(source, request.correlation_id)).key("op");
  if (request.name.starts_with(kWrite)) {
    const std::string_view tag = std::string_view(request.name).substr(kWrite.size());
    request.type = type_of(config_.devices.at(*index), tag);
    command.string("write").key("tag").string(tag);
  } else if (request.name == kRun || request.name == kStop) {
    command.string(request.name == kRun ? "run" : "stop");
  } else {
    return reject(request, "bad_op: no such command; the birth of the device lists its commands");
  }
  // Admission refuses an argument that is no key of a command, or one that is missing.
  for (const Metric& argument : metric.command().arguments())
    command.key(argument.name())
        .raw(sparkplug::json_of(received(argument.value()), request.type.value_or(Type::string))
                 .value_or("null"));
  Order order = order_of(message, device, name_ + "/" + log::excerpt(source));
  order.payload = command.end_object().take();
  order.tell = [this, request](const std::string& result) { answer(request, result); };
  take_order_(std::move(order));
}

}  // namespace fxagent
