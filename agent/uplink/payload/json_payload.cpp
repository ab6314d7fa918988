#include "agent/uplink/payload/json_payload.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "agent/text/json_writer.h"
#include "agent/text/sha256.h"

namespace fxagent::json {
namespace {

/// True if JSON can represent the value: there is one, and it contains no NaN or Inf.
bool is_sayable(const Value& value) {
  if (!value.is_array && value.items.empty()) return false;
  return std::all_of(value.items.begin(), value.items.end(), [](const Scalar& item) {
    const auto* real = std::get_if<double>(&item);
    return real == nullptr || std::isfinite(*real);
  });
}

Precision precision_of(const RecordedReading& reading) {
  return reading.type == DataType::float32 && !reading.scaled ? Precision::single : Precision::full;
}

void write_bad(Writer& out, const RecordedReading& reading, std::int64_t now_ms) {
  const bool has_last = reading.bad && reading.last_ms != 0 && is_sayable(reading.value);
  out.key(reading.name).begin_object();
  out.key("why").string(to_string(reading.bad.value_or(BadReason::bad_value)));
  out.key("since").integer(reading.bad ? reading.bad_since_ms : now_ms);
  out.key("last");
  if (has_last)
    write_value(out, reading.value, precision_of(reading));
  else
    out.null();
  out.key("last_ts");
  has_last ? out.integer(reading.last_ms) : out.null();
  out.end_object();
}

void write_percentiles(Writer& out, std::string_view name, const Percentiles& of) {
  out.key(name).begin_object();
  out.key("p50").number(of.p50).key("p99").number(of.p99);
  out.end_object();
}

void write_config_status(Writer& out, const ConfigStatus& status) {
  out.key("config").begin_object();
  out.key("hash").string(status.hash).key("since").integer(status.since_ms);
  out.key("last_reload");
  if (const auto& reload = status.last_reload) {
    out.begin_object().key("state").string(reload->state).key("ts").integer(reload->ts_ms);
    out.key("errors").begin_array();
    for (const std::string& error : reload->errors) out.string(error);
    out.end_array();
    out.key("errors_in_all").integer(std::uint64_t{reload->errors_in_all});
    out.end_object();
  } else {
    out.null();
  }
  out.key("remote");
  if (const auto& remote = status.remote) {
    out.begin_object().key("version").word(remote->version);
    out.key("state").string(remote->state).key("confirmed").boolean(remote->confirmed);
    out.end_object();
  } else {
    out.null();
  }
  out.end_object();
}

void write_samples(Writer& out, const SampleCounts& samples) {
  out.key("samples").begin_object();
  out.key("collected").integer(samples.collected).key("recovered").integer(samples.recovered);
  out.key("suppressed").integer(samples.suppressed).key("queued").integer(samples.queued);
  out.key("in_flight").integer(samples.in_flight).key("stored").integer(samples.stored);
  out.key("acknowledged").integer(samples.acknowledged).key("dropped").integer(samples.dropped);
  out.key("published").integer(samples.published);
  out.key("balanced").boolean(samples.balanced());
  out.end_object();
}

void write_profiles(Writer& out, const std::vector<ProfileStatus>& profiles) {
  out.key("profiles").begin_object();
  for (const ProfileStatus& profile : profiles) {
    out.key(profile.name).begin_object().key("server").string(profile.server);
    out.key("connected").boolean(profile.connected).key("ready").boolean(profile.ready);
    out.key("why").word(profile.why);
    write_samples(out, profile.samples);
    out.end_object();
  }
  out.end_object();
}

void write_states(Writer& out, const TagStates& states) {
  out.key("states").begin_object();
  for (const auto& [value, label] : states) out.key(std::to_string(value)).string(label);
  out.end_object();
}

}  // namespace

std::string sample(const SampleRecord& sample) {
  constexpr std::size_t kHead = 128;
  constexpr std::size_t kReading = 24;
  Writer out(kHead + kReading * sample.readings.size());
  out.begin_object();
  out.key("ts").integer(sample.ts_ms);
  out.key("seq").integer(sample.seq);
  out.key("boot").string(sample.boot);
  out.key("meta").string(sample.meta);
  if (sample.span_ms) out.key("span_ms").number(*sample.span_ms);
  if (sample.partial) out.key("partial").boolean(true);
  std::vector<const RecordedReading*> bad;
  out.key("values").begin_object();
  for (const RecordedReading& reading : sample.readings) {
    if (reading.bad || !is_sayable(reading.value)) {
      bad.push_back(&reading);
      continue;
    }
    out.key(reading.name);
    write_value(out, reading.value, precision_of(reading));
  }
  out.end_object();
  if (!bad.empty()) {
    out.key("bad").begin_object();
    for (const RecordedReading* reading : bad) write_bad(out, *reading, sample.ts_ms);
    out.end_object();
  }
  if (sample.written) {
    out.key("written").begin_array();
    for (const RecordedReading& reading : sample.readings) out.string(reading.name);
    out.end_array();
  }
  out.end_object();
  return out.take();
}

std::string bare_value(const RecordedReading& reading) {
  if (reading.bad || !is_sayable(reading.value)) return "null";
  Writer out;
  write_value(out, reading.value, precision_of(reading));
  return out.take();
}

Meta device_meta(const DeviceConfig& device) {
  Writer tags;
  tags.begin_object();
  for (const TagConfig& tag : device.tags) {
    const Point& point = tag.point;
    tags.key(tag.name).begin_object();
    tags.key("address").string(point.address.text).key("type").string(to_string(point.type));
    if (point.is_array) tags.key("count").integer(std::int64_t{point.count});
    if (point.type == DataType::string) tags.key("length").integer(std::int64_t{point.length});
    tags.key("unit").string(tag.units->unit);
    tags.key("scale").number(point.scale).key("offset").number(point.offset);
    tags.key("group").string(device.groups.at(tag.group).name);
    tags.key("access").string(tag.writable ? "read_write" : "read");
    const TagLimits& limits = tag.units->limits;
    if (limits.min) tags.key("min").number(*limits.min);
    if (limits.max) tags.key("max").number(*limits.max);
    if (limits.deadband) tags.key("deadband").number(*limits.deadband);
    if (!tag.units->description.empty()) tags.key("description").string(tag.units->description);
    if (!tag.units->states.empty()) write_states(tags, tag.units->states);
    tags.end_object();
  }
  tags.end_object();
  const std::string text = tags.take();
  Meta meta;
  meta.hash = short_hash(text);
  Writer out;
  out.begin_object().key("hash").string(meta.hash).key("tags").raw(text).end_object();
  meta.text = out.take();
  return meta;
}

std::string health(const AgentStatus& status, const Config& config) {
  Writer out;
  out.begin_object();
  out.key("ts").integer(status.ts_ms);
  out.key("boot").string(status.boot).key("version").string(status.version);
  out.key("uptime_s").integer(std::int64_t{status.uptime.count()});
  out.key("conflict").word(status.conflict);
  write_config_status(out, status.config_status);
  write_samples(out, status.samples);
  if (!status.profiles.empty()) write_profiles(out, status.profiles);
  out.key("links").begin_object();
  for (std::size_t i = 0; i < config.links.size(); ++i) {
    if (config.links[i].is_vacant()) continue;
    const LinkHealth link = i < status.field->links.size() ? status.field->links[i] : LinkHealth{};
    out.key(config.links[i].name).begin_object();
    out.key("exchanges").integer(link.exchanges).key("timeouts").integer(link.timeouts);
    out.key("naks").integer(link.naks).key("bad_frames").integer(link.bad_frames);
    out.key("unexpected_bytes").integer(link.unexpected_bytes);
    out.key("doubts").integer(link.doubts).key("doubted").boolean(link.doubted);
    out.key("yielded").boolean(link.yielded);
    out.key("busy_percent").number(link.busy_percent);
    out.key("load_percent").number(link.load_percent);
    write_percentiles(out, "turnaround_ms", link.turnaround_ms);
    out.end_object();
  }
  out.end_object();
  out.key("devices").begin_object();
  for (std::size_t i = 0; i < config.devices.size(); ++i) {
    if (config.devices[i].is_vacant()) continue;
    const DeviceHealth device =
        i < status.field->devices.size() ? status.field->devices[i] : DeviceHealth{};
    out.key(config.devices[i].name).begin_object();
    out.key("polls").integer(device.polls).key("missed").integer(device.missed);
    write_percentiles(out, "late_ms", device.late_ms);
    out.key("dropped").integer(i < status.dropped.size() ? status.dropped[i] : std::uint64_t{0});
    out.key("refused").word(i < status.refused.size() ? status.refused[i] : std::string());
    out.end_object();
  }
  out.end_object();
  out.key("commands").begin_object();
  for (const CommandStatus word : kCommandStatuses) {
    const auto found = status.commands.find(word);
    out.key(to_string(word))
        .integer(found == status.commands.end() ? std::uint64_t{0} : found->second);
  }
  out.end_object();
  out.key("store").begin_object();
  out.key("state").string(status.store_state).key("bytes").integer(status.store_bytes);
  out.key("hours_left").number(status.hours_left);
  out.key("set_aside").word(status.store_set_aside).end_object();
  out.key("audit");
  if (status.audit_head.empty()) {
    out.null();
  } else {
    out.begin_object().key("records").integer(status.audit_records);
    out.key("head").string(status.audit_head).end_object();
  }
  out.key("clock_synchronised").boolean(status.clock_synchronised);
  out.key("rss_bytes").integer(status.rss_bytes);
  out.end_object();
  return out.take();
}

}  // namespace fxagent::json

namespace fxagent {
namespace {

std::string offline_text(std::optional<std::int64_t> since_ms, std::string_view reason,
                         std::string_view boot) {
  json::Writer out;
  out.begin_object().key("state").string("offline").key("since").integer(since_ms);
  return out.key("reason").string(reason).key("boot").string(boot).end_object().take();
}

}  // namespace

/// Builds {"history":true,"rows":[…]} of rows as they were published live.
class JsonPayload::History final : public SampleHistory {
 public:
  History(const JsonPayload& payload, std::size_t max_bytes)
      : payload_(payload), max_bytes_(max_bytes) {}

  bool add(const SampleRecord& sample) override {
    const std::string row = json::sample(sample);
    const bool is_first = text_.size() == kBegin.size();
    if (!is_first && text_.size() + 1 + row.size() + kEnd.size() > max_bytes_) return false;
    if (!is_first) text_ += ',';
    text_ += row;
    return true;
  }
  std::vector<Publication> take(const StreamKey& stream) override {
    text_ += kEnd;
    return payload_.data(payload_.data_topic(stream) + "/history", std::move(text_));
  }

 private:
  static constexpr std::string_view kBegin = R"({"history":true,"rows":[)";
  static constexpr std::string_view kEnd = "]}";
  const JsonPayload& payload_;
  const std::size_t max_bytes_;
  std::string text_{kBegin};
};

JsonPayload::JsonPayload(const Config& config, std::string boot, std::string version,
                         std::string broker)
    : config_(config),
      base_(config.base_topic()),
      boot_(std::move(boot)),
      version_(std::move(version)),
      broker_(std::move(broker)) {}

Publication JsonPayload::last_will() const {
  return retained(base_ + "/state", offline_text(std::nullopt, "lost", boot_));
}

Publication JsonPayload::agent_online(std::int64_t since_ms,
                                      const std::optional<std::string>& not_heard_why,
                                      const std::optional<std::string>& conflict) const {
  json::Writer out;
  out.begin_object().key("state").string("online").key("since").integer(since_ms);
  out.key("boot").string(boot_).key("version").string(version_);
  if (not_heard_why) out.key("commands").boolean(false).key("reason").string(*not_heard_why);
  if (conflict) out.key("conflict").string(*conflict);
  return retained(base_ + "/state", out.end_object().take());
}

Publication JsonPayload::agent_offline(std::int64_t since_ms) const {
  return retained(base_ + "/state", offline_text(since_ms, "stopped", boot_));
}

Publication JsonPayload::device_state(const DeviceStatus& status) const {
  json::Writer out;
  out.begin_object().key("state").string(to_string(status.state));
  out.key("since").integer(status.since_ms).key("reason").word(status.reason);
  out.key("reason_text").word(status.reason_text);
  out.key("model").word(status.model);
  out.key("model_configured").word(status.model_configured);
  out.key("run").boolean(status.run).end_object();
  return retained(device_topic(status.device) + "/state", out.take());
}

Publication JsonPayload::device_meta(std::uint32_t device) const {
  return retained(device_topic(device) + "/meta",
                  json::device_meta(config_.devices.at(device)).text);
}

std::vector<Publication> JsonPayload::sample(const StreamKey& stream, const SampleRecord& sample) {
  return data(data_topic(stream), json::sample(sample));
}

std::shared_ptr<SampleHistory> JsonPayload::begin_history(std::size_t max_bytes) {
  return std::make_shared<History>(*this, max_bytes);
}

std::vector<Publication> JsonPayload::data(std::string topic, std::string payload) const {
  // Not an initializer list, which would copy the payload.
  std::vector<Publication> made;
  made.push_back({.topic = std::move(topic),
                  .payload = std::move(payload),
                  .qos = broker_of(config_, broker_).qos});
  return made;
}

std::string JsonPayload::device_topic(std::uint32_t device) const {
  return base_ + "/" + config_.devices.at(device).name;
}

std::string JsonPayload::data_topic(const StreamKey& stream) const {
  return base_ + "/" + stream.device + "/data/" + stream.group;
}

}  // namespace fxagent
