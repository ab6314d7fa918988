#include "agent/uplink/sparkplug/sparkplug_profile.h"

#include <algorithm>
#include <chrono>
#include <numeric>
#include <type_traits>
#include <utility>
#include <variant>

#include "agent/log/log.h"
#include "agent/uplink/sparkplug/sparkplug.pb.h"
#include "agent/uplink/sparkplug/typed_value.h"

namespace fxagent {
namespace {

using sparkplug::Metric;
using sparkplug::Packet;
using sparkplug::Type;

constexpr std::string_view kNodeRebirth = "Node Control/Rebirth";
constexpr std::string_view kDeviceRebirth = "Device Control/Rebirth";
constexpr std::chrono::milliseconds kLatest{60'000};  // far longer than a sample waits to be sent
// Numbers of a session and of its messages wrap at 256.
constexpr std::uint64_t kNumbers = 256;

std::uint64_t stamp(std::int64_t utc_ms) { return static_cast<std::uint64_t>(utc_ms); }

std::uint32_t number(Type type) { return static_cast<std::uint32_t>(type); }

// ---- metrics ------------------------------------------------------------------------------------

Metric& add_metric(Packet& packet, std::string_view name, std::int64_t ts_ms, Type type) {
  Metric& metric = *packet.add_metrics();
  metric.set_name(std::string(name));
  metric.set_timestamp(stamp(ts_ms));
  metric.set_datatype(number(type));
  return metric;
}

sparkplug::PropertyValue& add_property(Metric& metric, std::string_view name, Type type) {
  sparkplug::PropertySet& set = *metric.mutable_properties();
  set.add_keys(std::string(name));
  sparkplug::PropertyValue& value = *set.add_values();
  value.set_type(number(type));
  return value;
}

/// Sets the value, or is_null if there is none or the type cannot hold it.
void set_value(Metric& metric, const Value& value, Type type) {
  sparkplug::put(metric, sparkplug::typed(value, type), [&](auto integer) {
    // The specification has UInt32 in int_value; the hosts that we know read it from long_value.
    if (type == Type::int16 || type == Type::uint16 || type == Type::int32)
      metric.set_int_value(static_cast<std::uint32_t>(integer));
    else
      metric.set_long_value(static_cast<std::uint64_t>(integer));
  });
}

/// Adds the quality, and for a bad value our reason as the property `why`.
void add_quality(Metric& metric, const std::optional<BadReason>& bad) {
  // Codes of the specification. Stale: the device does not answer. Bad: it answers, and not with a
  // value.
  constexpr std::uint32_t kGood = 192;
  constexpr std::uint32_t kStale = 500;
  constexpr std::uint32_t kBad = 0;
  const bool is_stale = bad == BadReason::timeout || bad == BadReason::link_down;
  add_property(metric, "quality", Type::int32)
      .set_int_value(!bad       ? kGood
                     : is_stale ? kStale
                                : kBad);
  if (bad) add_property(metric, "why", Type::string).set_string_value(std::string(to_string(*bad)));
}

/// Adds unit, limits, description and whether commands may write the tag, by the names under which
/// Ignition shows them.
void add_units(Metric& metric, const TagConfig& tag) {
  const TagUnits& units = *tag.units;
  const auto add_text = [&](std::string_view name, const std::string& text) {
    if (!text.empty()) add_property(metric, name, Type::string).set_string_value(text);
  };
  add_text("engUnit", units.unit);
  add_text("documentation", units.description);
  if (units.limits.min)
    add_property(metric, "engLow", Type::real64).set_double_value(*units.limits.min);
  if (units.limits.max)
    add_property(metric, "engHigh", Type::real64).set_double_value(*units.limits.max);
  add_property(metric, "readOnly", Type::boolean).set_boolean_value(!tag.writable);
}

/// Returns the value of a command's metric as JSON. Its data type says how to read an integer; a
/// metric without one has that of the tag, `type`. A value of another kind is returned as it came:
/// admission refuses it with the reason. nullopt: the metric has no value.
std::optional<std::string> json_of(const Metric& metric, Type type) {
  // The elements of another type would be read as others.
  const bool is_other_array =
      metric.has_bytes_value() && metric.datatype() != 0 && metric.datatype() != number(type);
  if (metric.is_null() || is_other_array) return std::nullopt;
  const Type sent = metric.datatype() != 0 ? static_cast<Type>(metric.datatype()) : type;
  const auto integer = [&]() -> sparkplug::TypedValue {
    const std::uint32_t bits = metric.int_value();
    if (!metric.has_int_value() && !metric.has_long_value()) return {};
    if (sparkplug::is_unsigned(sent))
      return std::uint64_t{metric.has_int_value() ? bits : metric.long_value()};
    if (!metric.has_int_value()) return static_cast<std::int64_t>(metric.long_value());
    // Hosts with Tahu's Python library write -5 in the bits of its type, others in all 32.
    if (sent == Type::int8 && bits <= 0xFF) return std::int64_t{static_cast<std::int8_t>(bits)};
    if (sent == Type::int16 && bits <= 0xFFFF) return std::int64_t{static_cast<std::int16_t>(bits)};
    return std::int64_t{static_cast<std::int32_t>(bits)};
  };
  return sparkplug::json_of(sparkplug::taken(metric, integer), type);
}

// ---- values -------------------------------------------------------------------------

/// Returns a hash of the value; equal values have equal hashes.
std::size_t hash_of(const Value& value) {
  std::size_t hash = value.is_array ? 1 : 2;
  const auto add = [&hash](std::size_t more) { hash = hash * 1099511628211U + more; };
  for (const Scalar& item : value.items) {
    add(item.index());
    std::visit(
        [&](const auto& each) {
          using Each = std::remove_cvref_t<decltype(each)>;
          if constexpr (std::is_same_v<Each, BigInteger>)
            add(std::hash<std::string>{}(each.digits));
          else
            add(std::hash<Each>{}(each));
        },
        item);
  }
  return hash;
}

sparkplug::PrimaryHost host_of(const ProfileConfig& profile) {
  if (profile.host.empty()) return {"", /*old_state=*/false};
  return {(profile.old_state ? "STATE/" : "spBv1.0/STATE/") + profile.host, profile.old_state};
}

}  // namespace

SparkplugProfile::SparkplugProfile(const Config& config, const ProfileConfig& profile,
                                   RelayCommand relay, std::function<std::string()> new_id,
                                   std::function<std::int64_t()> utc_ms)
    : EdgeNode(config, profile, "spBv1.0", host_of(profile), std::move(relay), std::move(utc_ms)),
      new_id_(std::move(new_id)),
      devices_(config.devices.size()) {
  for (std::uint32_t i = 0; i < devices_.size(); ++i) prepare(i);
}

/// Gives the device its aliases: one for each tag and one for its rebirth. No other has had them.
void SparkplugProfile::prepare(std::uint32_t index) {
  const DeviceConfig& device = config_.devices.at(index);
  if (device.is_vacant()) return;
  Device& state = devices_.at(index);
  state = Device{};
  state.first_alias = next_alias_;
  state.last.resize(device.tags.size());
  next_alias_ += device.tags.size() + 1;
}

// ---- session ------------------------------------------------------------------------------------

std::vector<Subscription> SparkplugProfile::subscriptions() const {
  std::vector<Subscription> filters{{prefix_ + "NCMD/" + node_, /*no_local=*/false},
                                    {prefix_ + "DCMD/" + node_ + "/+", /*no_local=*/false}};
  if (!host().topic().empty()) filters.push_back({host().topic(), /*no_local=*/false});
  return filters;
}

// ---- births and deaths --------------------------------------------------------------------------

std::uint64_t SparkplugProfile::next_seq() { return std::exchange(seq_, (seq_ + 1) % kNumbers); }

Publication SparkplugProfile::node_birth(SteadyTime, std::int64_t utc_ms) {
  Packet packet = session_packet(utc_ms);
  seq_ = 0;
  packet.set_seq(next_seq());
  add_metric(packet, kNodeRebirth, utc_ms, Type::boolean).set_boolean_value(false);
  return message("NBIRTH", "", packet.SerializeAsString());
}

/// Has no `seq`. The topic is that of the last will.
Publication SparkplugProfile::node_death(std::int64_t utc_ms) const {
  return message("NDEATH", "", session_packet(utc_ms).SerializeAsString());
}

/// Returns a packet with the number of the session.
Packet SparkplugProfile::session_packet(std::int64_t utc_ms) const {
  Packet packet;
  packet.set_timestamp(stamp(utc_ms));
  add_metric(packet, "bdSeq", utc_ms, Type::int64).set_long_value(session() % kNumbers);
  return packet;
}

std::optional<Publication> SparkplugProfile::device_birth(std::uint32_t index,
                                                          std::int64_t utc_ms) {
  const DeviceConfig& device = config_.devices.at(index);
  Device& state = devices_[index];
  // Metrics stand in the order of their time; those that were never read have that of the birth.
  std::vector<std::size_t> order(device.tags.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  const auto time_of = [&](std::size_t tag) {
    return state.last[tag].ts_ms == 0 ? utc_ms : state.last[tag].ts_ms;
  };
  std::ranges::stable_sort(order, {}, time_of);
  Packet packet;
  packet.set_timestamp(stamp(utc_ms));
  for (const std::size_t tag : order) {
    const Last& last = state.last[tag];
    const Type type = sparkplug::type_of(device.tags[tag].point);
    Metric& metric = add_metric(packet, device.tags[tag].name, time_of(tag), type);
    metric.set_alias(state.first_alias + tag);
    set_value(metric, last.value, type);
    if (last.ts_ms != 0) add_quality(metric, last.bad);
    add_units(metric, device.tags[tag]);
  }
  const std::int64_t newest = order.empty() ? utc_ms : std::max(utc_ms, time_of(order.back()));
  Metric& rebirth = add_metric(packet, kDeviceRebirth, newest, Type::boolean);
  rebirth.set_alias(state.first_alias + device.tags.size());
  rebirth.set_boolean_value(false);
  if (!accepts_birth(index, packet.ByteSizeLong())) return std::nullopt;
  state.born_ms = 0;
  for (Last& last : state.last) {
    last.sent = hash_of(last.value);
    last.sent_bad = last.bad;
    state.born_ms = std::max(state.born_ms, last.ts_ms);
  }
  packet.set_seq(next_seq());
  return message("DBIRTH", device.name, packet.SerializeAsString());
}

Publication SparkplugProfile::device_death(const std::string& name, std::int64_t utc_ms) {
  Packet packet;
  packet.set_timestamp(stamp(utc_ms));
  packet.set_seq(next_seq());
  return message("DDEATH", name, packet.SerializeAsString());
}

void SparkplugProfile::change(const ConfigChange& change) {
  EdgeNode::change(change);
  devices_.resize(config_.devices.size());
  for (const std::uint32_t i : change.devices_begin) prepare(i);
}

// ---- samples ------------------------------------------------------------------------------------

void SparkplugProfile::saw(const Telemetry& sample, SteadyTime) {
  Device& device = devices_.at(sample.device);
  for (const TagReading& reading : sample.readings) {
    Last& last = device.last.at(reading.tag);
    last.value = reading.value;
    last.bad = reading.bad;
    last.ts_ms = sample.ts_ms;
  }
}

std::vector<Publication> SparkplugProfile::sample(const StreamKey& stream,
                                                  const SampleRecord& sample) {
  const auto index = index_of(stream.device);
  if (!index) return {};
  Device& device = devices_[*index];
  const DeviceConfig& config = config_.devices[*index];
  // Read before the birth, whose values are newer. A larger difference is a clock that was set.
  const bool is_late =
      sample.ts_ms < device.born_ms && device.born_ms - sample.ts_ms < kLatest.count();
  Packet packet;
  std::size_t next = 0;
  for (const RecordedReading& reading : sample.readings) {
    const auto tag = sparkplug::place_of(config.tags, reading.name, next);
    if (!tag) continue;
    next = *tag + 1;
    Last& last = device.last[*tag];
    const std::size_t hash = hash_of(reading.value);
    const bool same_quality = last.sent_bad == reading.bad;
    if (!is_late && same_quality && last.sent == hash) continue;
    Metric& metric = *packet.add_metrics();
    metric.set_alias(device.first_alias + *tag);
    metric.set_timestamp(stamp(sample.ts_ms));
    set_value(metric, reading.value, sparkplug::type_of(config.tags[*tag].point));
    if (is_late ? reading.bad.has_value() : !same_quality) add_quality(metric, reading.bad);
    if (is_late) {
      metric.set_is_historical(true);
      continue;
    }
    last.sent = hash;
    last.sent_bad = reading.bad;
  }
  return data(config.name, std::move(packet));
}

/// Gathers historical metrics by name: a message under construction does not know its device. Their
/// data type is that of the value that was read.
class SparkplugProfile::History final : public SampleHistory {
 public:
  History(SparkplugProfile& profile, std::size_t max_bytes)
      : profile_(profile), max_bytes_(max_bytes) {}

  bool add(const SampleRecord& sample) override {
    Packet more;
    for (const RecordedReading& reading : sample.readings) {
      const Type type = sparkplug::type_of(reading);
      Metric& metric = add_metric(more, reading.name, sample.ts_ms, type);
      metric.set_is_historical(true);
      set_value(metric, reading.value, type);
      if (reading.bad) add_quality(metric, reading.bad);
    }
    const std::size_t bytes = more.ByteSizeLong();
    if (!gathered_.metrics().empty() && bytes_ + bytes > max_bytes_) return false;
    bytes_ += bytes;
    gathered_.mutable_metrics()->MergeFrom(more.metrics());
    return true;
  }
  std::vector<Publication> take(const StreamKey& stream) override {
    const auto index = profile_.index_of(stream.device);
    if (!index) return {};
    const DeviceConfig& config = profile_.config_.devices[*index];
    Packet packet;
    std::size_t next = 0;
    for (Metric& metric : *gathered_.mutable_metrics()) {
      const auto tag = sparkplug::place_of(config.tags, metric.name(), next);
      if (!tag) continue;
      next = *tag + 1;
      // The births of this session do not have the metric in this form.
      if (metric.datatype() != number(sparkplug::type_of(config.tags[*tag].point))) continue;
      metric.clear_name();
      metric.clear_datatype();
      metric.set_alias(profile_.devices_[*index].first_alias + *tag);
      *packet.add_metrics() = std::move(metric);
    }
    return profile_.data(config.name, std::move(packet));
  }

 private:
  SparkplugProfile& profile_;
  const std::size_t max_bytes_;
  std::size_t bytes_ = 0;
  Packet gathered_;
};

std::shared_ptr<SampleHistory> SparkplugProfile::begin_history(std::size_t max_bytes) {
  return std::make_shared<History>(*this, std::min(max_bytes, most_bytes()));
}

/// Returns the metrics as a message, or nothing if there are none.
std::vector<Publication> SparkplugProfile::data(const std::string& device, Packet packet) {
  if (packet.metrics().empty()) return {};
  packet.set_timestamp(stamp(utc_ms_()));
  packet.set_seq(next_seq());
  return {message("DDATA", device, packet.SerializeAsString())};
}

// ---- commands -----------------------------------------------------------------------------------

void SparkplugProfile::hear(const Message& message) {
  if (hear_host(message)) return;
  const std::string devices = prefix_ + "DCMD/" + node_ + "/";
  if (message.topic == prefix_ + "NCMD/" + node_) return hear_node_command(message);
  if (message.topic.starts_with(devices))
    hear_device_command(message, message.topic.substr(devices.size()));
}

void SparkplugProfile::hear_node_command(const Message& message) {
  Packet packet;
  if (!packet.ParseFromString(message.payload))
    return ignore_command(message, "not a Sparkplug payload");
  if (message.retained)
    return ignore_command(message, "it is retained, so it was sent for an earlier time");
  for (const Metric& metric : packet.metrics()) {
    if (metric.name() != kNodeRebirth || !metric.boolean_value())
      return ignore_command(
          message, "the node has only the command " + std::string(kNodeRebirth) + " = true");
    request_rebirth();
  }
}

void SparkplugProfile::hear_device_command(const Message& message, const std::string& device) {
  const auto index = index_of(device);
  if (!index) return ignore_command(message, "no such device");
  Packet packet;
  if (!packet.ParseFromString(message.payload))
    return ignore_command(message, "not a Sparkplug payload");
  if (packet.metrics_size() > static_cast<int>(kMostTargets))
    return ignore_command(message, "more than " + std::to_string(kMostTargets) + " metrics");
  const DeviceConfig& config = config_.devices[*index];
  const std::uint64_t first = devices_[*index].first_alias;
  for (const Metric& metric : packet.metrics()) {
    std::optional<std::size_t> tag;
    if (metric.has_name()) {
      tag = metric.name() == kDeviceRebirth ? config.tags.size()
                                            : sparkplug::place_of(config.tags, metric.name());
    } else if (metric.has_alias() && metric.alias() >= first &&
               metric.alias() - first <= config.tags.size()) {
      tag = metric.alias() - first;
    }
    if (!tag) {
      ignore_command(message, metric.has_name()
                                  ? "no metric " + log::excerpt(metric.name())
                                  : "no metric with alias " + std::to_string(metric.alias()));
    } else if (*tag < config.tags.size()) {
      relay_write(message, *index, *tag, metric);
    } else if (message.retained || !metric.boolean_value()) {
      ignore_command(message, std::string(kDeviceRebirth) + " must be true, and not retained");
    } else {
      request_rebirth();
    }
  }
}

/// Each metric becomes one command with one result.
void SparkplugProfile::relay_write(const Message& message, std::uint32_t device, std::size_t tag,
                                   const Metric& metric) {
  if (!relay_)
    return ignore_command(message, "this broker may not send commands: brokers[].commands");
  const DeviceConfig& config = config_.devices[device];
  const auto value = json_of(metric, sparkplug::type_of(config.tags[tag].point));
  if (!value) return ignore_command(message, "a metric without a value that its tag can have");
  RelayedCommand command = relayed_command(message, config.name, name_);
  command.payload = write_command(new_id_(), config.tags[tag].name, *value);
  relay_(std::move(command));
}

}  // namespace fxagent
