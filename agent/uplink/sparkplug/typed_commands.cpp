#include "agent/uplink/sparkplug/typed_commands.h"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <type_traits>
#include <utility>
#include <variant>

#include "agent/log/log.h"
#include "agent/text/json.h"
#include "agent/text/json_writer.h"
#include "agent/text/sha256.h"
#include "agent/text/text.h"
#include "agent/uplink/sparkplug/sparkplug_c.pb.h"
#include "agent/uplink/topics.h"

namespace fxagent {
namespace {

using sparkplug::Type;
using sparkplug_c::Metric;
using sparkplug_c::Packet;

constexpr std::string_view kWrite = "Write/";
constexpr std::string_view kRun = "Run";
constexpr std::string_view kStop = "Stop";
constexpr std::string_view kCommands = "Write/{tag}, Run, Stop";
constexpr const char* kValue = "value";    // argument and result of a write
constexpr std::uint32_t kCommand = 35;     // data type
constexpr std::size_t kLongestId = 64;     // of a command of the agent
constexpr std::size_t kLongestName = 256;  // bytes of a name that an answer repeats
constexpr std::size_t kMostAnswers = 200;  // that wait for the broker
constexpr std::size_t kBytesOfSeq = 11;
// No command accepts this value. Null would count as absent.
constexpr const char* kNoValue = "{}";

std::uint64_t stamp(std::int64_t utc_ms) { return static_cast<std::uint64_t>(utc_ms) * 1'000'000; }

std::uint32_t number(Type type) { return static_cast<std::uint32_t>(type); }

void set_value(sparkplug_c::TypedValue& out, const Value& value, Type type) {
  out.set_datatype(number(type));
  const bool is_long = type == Type::int64 || type == Type::uint64;
  sparkplug::put(out, sparkplug::typed(value, type), [&](auto integer) {
    if constexpr (std::is_signed_v<decltype(integer)>)
      is_long ? out.set_int64_value(integer)
              : out.set_int32_value(static_cast<std::int32_t>(integer));
    else
      is_long ? out.set_uint64_value(integer)
              : out.set_uint32_value(static_cast<std::uint32_t>(integer));
  });
}

sparkplug::TypedValue received(const sparkplug_c::TypedValue& value) {
  return sparkplug::taken(value, [&value]() -> sparkplug::TypedValue {
    if (value.has_int32_value()) return std::int64_t{value.int32_value()};
    if (value.has_int64_value()) return std::int64_t{value.int64_value()};
    if (value.has_uint32_value()) return std::uint64_t{value.uint32_value()};
    if (value.has_uint64_value()) return std::uint64_t{value.uint64_value()};
    return {};
  });
}

/// Returns an argument as JSON, or kNoValue if it has none or is not an array of this type.
std::string json_of(const Metric& argument, Type type) {
  const sparkplug_c::TypedValue& value = argument.value();
  const auto is_other = [&](std::uint32_t declared) {
    return declared != 0 && declared != number(type);
  };
  // The elements of another type would be read as others.
  const bool is_other_array =
      value.has_bytes_value() && (is_other(value.datatype()) || is_other(argument.datatype()));
  if (value.is_null() || is_other_array) return kNoValue;
  auto json = sparkplug::json_of(received(value), type);
  return json && *json != "null" ? *std::move(json) : kNoValue;
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

// ---- results ------------------------------------------------------------------------------------

/// Code 0 is success; the others count the words of the contract in their order.
std::uint64_t code_of(std::string_view word) {
  const auto found = std::ranges::find(kCommandStatuses, word,
                                       [](CommandStatus status) { return to_string(status); });
  return static_cast<std::uint64_t>(found - kCommandStatuses.begin());
}

/// Returns the words of a result: "REJECTED: out_of_range: …", "SUCCEEDED, ACK".
std::string message_of(const nlohmann::json& result) {
  const auto& first = member(result, "first");
  const std::string plc = text_at(result, "plc");
  std::string out = text_at(result, "status");
  if (!plc.empty() && !first.is_object()) out += ", " + plc;
  if (member(result, "dry_run") == true) out += ", dry run: nothing was sent";
  const std::string reason = text_at(result, "reason");
  std::string detail = text_at(result, "detail");
  if (reason == to_string(Reason::missing_id)) detail = "a request needs source and correlation_id";
  for (const std::string& text : {reason, detail})
    if (!text.empty()) out += ": " + text;
  if (first.is_object()) out += "; the first had " + message_of(first);
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

/// Returns the id of the agent's command: "scada/17", or a hash if that is no id of a command.
/// Another host may use the same correlation id. Empty if one of them is missing.
std::string id_of(const std::string& source, const std::string& correlation_id) {
  if (source.empty() || correlation_id.empty()) return {};
  std::string id = source + "/" + correlation_id;
  const bool is_plain = id.size() <= kLongestId && source.find('/') == source.npos &&
                        std::ranges::all_of(id, [](char c) { return c >= ' ' && c <= '~'; });
  return is_plain ? id : to_text(sha256(std::to_string(source.size()) + "/" + id));
}

}  // namespace

TypedCommandsProfile::TypedCommandsProfile(const Config& config, const ProfileConfig& profile,
                                           RelayCommand relay, std::function<std::int64_t()> utc_ms)
    : EdgeNode(config, profile, "spCv1.0",
               {profile.host.empty() ? "" : "spCv1.0/STATE/" + profile.host, /*old_state=*/false},
               std::move(relay), std::move(utc_ms)) {}

// ---- session ------------------------------------------------------------------------------------

Publication TypedCommandsProfile::message(std::string_view verb, const std::string& device,
                                          Packet packet, std::optional<std::uint64_t> seq) const {
  if (seq) packet.set_seq(*seq);
  return EdgeNode::message(verb, device, packet.SerializeAsString());
}

std::vector<Subscription> TypedCommandsProfile::subscriptions() const {
  std::vector<Subscription> filters;
  for (const char* verb : {"REBIRTH/", "NCMD/"})
    filters.push_back({.filter = prefix_ + verb + node_, .qos = 0});
  filters.push_back({.filter = prefix_ + "DCMD/" + node_ + "/+", .qos = 0});
  if (!host().topic().empty()) filters.push_back({.filter = host().topic()});
  return filters;
}

/// Has the number of the session and nothing else, since it is the last will, too.
Publication TypedCommandsProfile::node_death(std::int64_t) const {
  Packet packet;
  packet.set_bd_seq(session());
  return message("NDEATH", "", packet);
}

// ---- births and answers -------------------------------------------------------------------------

std::vector<Publication> TypedCommandsProfile::due(SteadyTime now, std::int64_t utc_ms) {
  std::vector<Publication> messages = EdgeNode::due(now, utc_ms);
  if (!messages.empty() || !is_open()) return messages;
  if (is_asked_ && now >= last_births_at_ + kRebirthEvery) {
    last_births_at_ = now;
    return repeated_births(utc_ms);
  }
  // One at a time: what is handed over is lost with the connection.
  while (!answers_.empty() && messages.empty()) {
    Publication answer = std::move(answers_.front());
    answers_.pop_front();
    if (answer.payload.size() <= most_bytes())
      messages.push_back(std::move(answer));
    else
      log::error("answer_too_large", {{"topic", answer.topic},
                                      {"bytes", std::to_string(answer.payload.size())},
                                      {"note", "the broker does not accept it: raise its limit"}});
  }
  return messages;
}

bool TypedCommandsProfile::is_open() const { return is_ready() && host().is_online(); }

SteadyTime TypedCommandsProfile::next_wake() const {
  if (!is_asked_ || !is_open()) return EdgeNode::next_wake();
  return std::min(EdgeNode::next_wake(), last_births_at_ + kRebirthEvery);
}

Publication TypedCommandsProfile::node_birth(SteadyTime now, std::int64_t utc_ms) {
  seq_ = 0;
  is_asked_ = false;
  last_births_at_ = now;
  return message("NBIRTH", "", node_packet(utc_ms), seq_++);
}

std::optional<Publication> TypedCommandsProfile::device_birth(std::uint32_t index,
                                                              std::int64_t utc_ms) {
  Packet birth = device_packet(index, utc_ms);
  if (!accepts_birth(index, birth.ByteSizeLong() + kBytesOfSeq)) return std::nullopt;
  return message("DBIRTH", config_.devices[index].name, std::move(birth), seq_++);
}

Publication TypedCommandsProfile::device_death(const std::string& name, std::int64_t utc_ms) {
  Packet death;
  death.set_timestamp(stamp(utc_ms));
  return message("DDEATH", name, std::move(death), seq_++);
}

/// Births for a host that has asked. They repeat the last numbers, so that other hosts miss none.
std::vector<Publication> TypedCommandsProfile::repeated_births(std::int64_t utc_ms) {
  is_asked_ = false;
  const std::vector<std::uint32_t> devices = born();
  std::uint64_t seq = seq_ - devices.size() - 1;
  std::vector<Publication> messages;
  messages.push_back(message("NREBIRTH", "", node_packet(utc_ms), seq++));
  for (const std::uint32_t i : devices)
    messages.push_back(
        message("DREBIRTH", config_.devices.at(i).name, device_packet(i, utc_ms), seq++));
  return messages;
}

Packet TypedCommandsProfile::node_packet(std::int64_t utc_ms) const {
  Packet packet;
  packet.set_timestamp(stamp(utc_ms));
  packet.set_bd_seq(session());
  return packet;
}

Packet TypedCommandsProfile::device_packet(std::uint32_t index, std::int64_t utc_ms) const {
  const DeviceConfig& device = config_.devices.at(index);
  Packet packet;
  packet.set_timestamp(stamp(utc_ms));
  for (const TagConfig& tag : device.tags)
    if (tag.writable) define_write(packet, tag);
  if (device.commands.allow_run_stop && device.codec->plc() != nullptr)
    for (const std::string_view name : {kRun, kStop}) define(packet, std::string(name));
  return packet;
}

/// Answers a request that is not for a device of the config, and logs it: the audit has no place
/// for it.
void TypedCommandsProfile::reject(const Message& message, const Request& request,
                                  const std::string& why) {
  ignore_command(message, why);
  json::Writer result;
  result.begin_object().key("status").string(to_string(CommandStatus::rejected));
  answer(request, result.key("detail").string(why).end_object().take());
}

void TypedCommandsProfile::answer(const Request& request, const std::string& result) {
  const auto json = parsed_json(result);
  Packet packet;
  packet.set_timestamp(stamp(utc_ms_()));
  sparkplug_c::Command& command = define(packet, request.name);
  if (!request.correlation_id.empty()) command.set_correlation_id(request.correlation_id);
  command.mutable_status()->set_code(code_of(text_at(json, "status")));
  command.mutable_status()->set_message(message_of(json));
  if (request.type && command.status().code() == 0) {
    Metric& value = *command.add_results();
    value.set_name(kValue);
    value.set_datatype(number(*request.type));
    set_value(*value.mutable_value(), result_value(member(json, kValue), *request.type),
              *request.type);
  }
  answers_.push_back(message(request.device.empty() ? "NRESP" : "DRESP", request.device, packet));
}

// ---- requests -----------------------------------------------------------------------------------

void TypedCommandsProfile::hear(const Message& message) {
  if (hear_host(message)) return;
  Packet packet;
  if (message.payload.size() > kMaxMessageBytes || !packet.ParseFromString(message.payload))
    return ignore_command(message, "not a Sparkplug C payload of at most 64 KiB");
  // It would come again in each connection.
  if (message.retained)
    return ignore_command(message, "it is retained, so it was sent for an earlier time");
  if (message.topic == prefix_ + "REBIRTH/" + node_) {
    is_asked_ = is_ready();  // otherwise a birth is due anyway
    return;
  }
  if (!host().is_online())
    return ignore_command(message, "the node is not born: its primary host is not online");
  const auto commands = static_cast<std::size_t>(packet.metrics_size());
  if (commands > kMostTargets)
    return ignore_command(message, "more than " + std::to_string(kMostTargets) + " commands");
  if (answers_.size() + commands > kMostAnswers)
    return ignore_command(message, "too many answers wait for the broker");
  const std::string devices = prefix_ + "DCMD/" + node_ + "/";
  const bool is_for_device = message.topic.starts_with(devices);
  const std::string device = is_for_device ? message.topic.substr(devices.size()) : "";
  if ((is_for_device && device.empty()) || device.size() > kLongestName ||
      !is_publishable(message.topic))
    return ignore_command(message, "no such device");
  for (const Metric& metric : packet.metrics()) carry_out(message, device, packet.source(), metric);
}

/// Each request has one answer. A metric without a command has nothing that an answer could repeat.
void TypedCommandsProfile::carry_out(const Message& message, const std::string& device,
                                     const std::string& source, const Metric& metric) {
  if (!metric.has_command())
    return ignore_command(message, log::excerpt(metric.name()) +
                                       " is not a command: Write/{tag} writes a tag, and the verb "
                                       "REBIRTH asks for the births");
  Request request{device, metric.name(), metric.command().correlation_id(), {}};
  if (request.name.size() > kLongestName || request.correlation_id.size() > kLongestName)
    return ignore_command(message, "a name or a correlation_id of more than " +
                                       std::to_string(kLongestName) + " bytes");
  if (device.empty())
    return reject(message, request, "bad_op: the node has no commands, its devices have");
  const auto index = index_of(device);
  if (!index) return reject(message, request, "unknown_device: the agent has no device " + device);
  json::Writer command;
  command.begin_object();
  if (const std::string id = id_of(source, request.correlation_id); !id.empty())
    command.key("id").string(id);
  command.key("op");
  if (request.name.starts_with(kWrite)) {
    const std::string_view tag = std::string_view(request.name).substr(kWrite.size());
    const SharedVector<TagConfig>& tags = config_.devices.at(*index).tags;
    if (const auto place = sparkplug::place_of(tags, tag))
      request.type = sparkplug::type_of(tags[*place].point);
    command.string("write").key("tag").string(tag);
  } else if (request.name == kRun || request.name == kStop) {
    command.string(request.name == kRun ? "run" : "stop");
  } else {
    // A name such as "read" must not become the agent's own command. The host's answer, the result
    // on MQTT and the audit have it as "DCMD read".
    command.string(op_from(request.name) ? "DCMD " + request.name : request.name);
  }
  // Admission refuses an argument that is no key of a command, and a value that is missing.
  for (const Metric& argument : metric.command().arguments())
    command.key(argument.name()).raw(json_of(argument, request.type.value_or(Type::string)));
  RelayedCommand relayed = relayed_command(message, device, name_ + "/" + log::excerpt(source));
  relayed.ops = kCommands;
  relayed.payload = command.end_object().take();
  relayed.reply = [this, request](const std::string& result) { answer(request, result); };
  relay_(std::move(relayed));
}

}  // namespace fxagent
