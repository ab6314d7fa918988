#include "agent/uplink/json.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <nlohmann/json.hpp>
#include <utility>

#include "agent/utf8.h"

namespace fxagent::json {
namespace {

using Json = nlohmann::json;

/// Appends JSON text to a string; commas come by themselves.
class Writer final {
 public:
  Writer& begin_object() { return open('{'); }
  Writer& end_object() { return close('}'); }
  Writer& begin_array() { return open('['); }
  Writer& end_array() { return close(']'); }

  Writer& key(std::string_view name) {
    separate();
    append_text(name);
    text_ += ':';
    comma_ = false;
    return *this;
  }
  Writer& string(std::string_view value) {
    separate();
    append_text(value);
    return *this;
  }
  /// Null where it is empty.
  Writer& word(std::string_view value) { return value.empty() ? null() : string(value); }
  Writer& boolean(bool value) { return raw(value ? "true" : "false"); }
  Writer& null() { return raw("null"); }
  Writer& raw(std::string_view json) {
    separate();
    text_ += json;
    return *this;
  }
  Writer& integer(std::int64_t value) {
    return integer_text(value, value > kMaxExactInteger || value < -kMaxExactInteger);
  }
  Writer& integer(std::uint64_t value) {
    return integer_text(value, value > static_cast<std::uint64_t>(kMaxExactInteger));
  }
  /// The shortest text that reads back as the same number; null where it is none.
  template <class Float>
  Writer& number(Float value) {
    if (!std::isfinite(value)) return null();
    std::array<char, 40> digits{};
    const auto end = std::to_chars(digits.data(), digits.data() + digits.size(), value).ptr;
    return raw(std::string_view(digits.data(), static_cast<std::size_t>(end - digits.data())));
  }
  /// A duration as ms with at most three decimals.
  Writer& milliseconds(std::chrono::nanoseconds duration) {
    return number(std::round(static_cast<double>(duration.count()) / 1e3) / 1e3);
  }

  std::string take() { return std::move(text_); }

 private:
  Writer& open(char bracket) {
    separate();
    text_ += bracket;
    comma_ = false;
    return *this;
  }
  Writer& close(char bracket) {
    text_ += bracket;
    comma_ = true;
    return *this;
  }
  void separate() {
    if (comma_) text_ += ',';
    comma_ = true;
  }
  template <class Integer>
  Writer& integer_text(Integer value, bool quoted) {
    std::array<char, 24> digits{};
    const auto end = std::to_chars(digits.data(), digits.data() + digits.size(), value).ptr;
    const std::string_view text(digits.data(), static_cast<std::size_t>(end - digits.data()));
    return quoted ? string(text) : raw(text);
  }
  void append_text(std::string_view value) {
    constexpr std::string_view hex = "0123456789abcdef";
    text_ += '"';
    while (!value.empty()) {
      const char c = value.front();
      const std::size_t length = utf8_length(value);
      if (length == 0) {
        text_ += "\xEF\xBF\xBD";
      } else if (c == '"' || c == '\\') {
        text_ += '\\';
        text_ += c;
      } else if (c == '\n') {
        text_ += "\\n";
      } else if (static_cast<unsigned char>(c) < 0x20) {
        text_ += "\\u00";
        text_ += hex[static_cast<unsigned char>(c) >> 4];
        text_ += hex[static_cast<unsigned char>(c) & 0x0F];
      } else {
        text_ += value.substr(0, length);
      }
      value.remove_prefix(std::max<std::size_t>(length, 1));
    }
    text_ += '"';
  }

  std::string text_;
  bool comma_ = false;
};

enum class Precision : std::uint8_t { full, single };

/// How exact a tag's doubles are: a float32 is written as short as a float can be (5.1, not
/// 5.099999904632568).
Precision precision_of(const Point& point) {
  return point.type == DataType::float32 && !point.scaled() ? Precision::single : Precision::full;
}

void write_scalar(Writer& out, const Scalar& scalar, Precision precision) {
  if (const auto* flag = std::get_if<bool>(&scalar))
    out.boolean(*flag);
  else if (const auto* integer = std::get_if<std::int64_t>(&scalar))
    out.integer(*integer);
  else if (const auto* real = std::get_if<double>(&scalar))
    precision == Precision::single ? out.number(static_cast<float>(*real)) : out.number(*real);
  else
    out.string(std::get<std::string>(scalar));
}

void write_value(Writer& out, const Value& value, Precision precision = Precision::full) {
  if (value.is_array) {
    out.begin_array();
    for (const Scalar& item : value.items) write_scalar(out, item, precision);
    out.end_array();
  } else if (value.items.empty()) {
    out.null();
  } else {
    write_scalar(out, value.items.front(), precision);
  }
}

void write_optional(Writer& out, const std::optional<Value>& value) {
  value ? write_value(out, *value) : static_cast<void>(out.null());
}

/// Whether JSON can say it: there is a value, and no NaN or Inf in it.
bool is_sayable(const Value& value) {
  if (!value.is_array && value.items.empty()) return false;
  return std::all_of(value.items.begin(), value.items.end(), [](const Scalar& item) {
    const auto* real = std::get_if<double>(&item);
    return real == nullptr || std::isfinite(*real);
  });
}

void write_bad(Writer& out, const TagReading& reading, std::int64_t now_ms, const Point& point) {
  const bool has_last = reading.bad && reading.last_ms != 0 && is_sayable(reading.value);
  out.begin_object();
  out.key("why").string(to_string(reading.bad.value_or(BadReason::bad_value)));
  out.key("since").integer(reading.bad ? reading.bad_since_ms : now_ms);
  out.key("last");
  if (has_last)
    write_value(out, reading.value, precision_of(point));
  else
    out.null();
  out.key("last_ts");
  has_last ? out.integer(reading.last_ms) : out.null();
  out.end_object();
}

constexpr std::array<CommandStatus, 7> kStatuses{
    CommandStatus::succeeded,      CommandStatus::failed,  CommandStatus::partial,
    CommandStatus::rejected,       CommandStatus::expired, CommandStatus::duplicate,
    CommandStatus::unknown_outcome};

std::string_view text_of(PlcAnswer answer) {
  switch (answer) {
    case PlcAnswer::none:
      return "";
    case PlcAnswer::ack:
      return "ACK";
    case PlcAnswer::nak:
      return "NAK";
  }
  return "";
}

void write_verification(Writer& out, const std::optional<Verification>& verify) {
  if (!verify) {
    out.null();
    return;
  }
  out.begin_object().key("read");
  write_optional(out, verify->read);
  out.key("match").boolean(verify->match).end_object();
}

void write_outcome(Writer& out, CommandStatus status, Reason reason, std::string_view detail,
                   PlcAnswer plc, const std::optional<Progress>& progress) {
  out.key("status").string(to_string(status));
  out.key("reason").word(to_string(reason));
  out.key("detail").word(detail);
  out.key("plc").word(text_of(plc));
  if (!progress) return;
  out.key("done").integer(std::int64_t{progress->done});
  out.key("of").integer(std::int64_t{progress->of});
}

/// `target` null: none could be read.
void write_target(Writer& out, const TargetResult* target) {
  out.key("tag").word(target ? target->tag : "");
  out.key("address").word(target ? target->address : "");
  out.key("value");
  write_optional(out, target ? target->value : std::nullopt);
}

void write_result(Writer& out, const CommandResult& result,
                  std::optional<std::chrono::nanoseconds> total) {
  if (!result.recorded.empty()) {
    out.raw(result.recorded);
    return;
  }
  out.begin_object();
  out.key("id").word(result.id);
  write_outcome(out, result.status, result.reason, result.detail, result.plc, result.progress);
  out.key("op").word(result.op);
  if (result.is_list) {
    out.key("targets").begin_array();
    for (const TargetResult& target : result.targets) {
      out.begin_object();
      write_target(out, &target);
      write_outcome(out, target.status, target.reason, target.detail, target.plc, target.progress);
      out.key("verify");
      write_verification(out, target.verify);
      out.end_object();
    }
    out.end_array();
    if (result.one_frame) out.key("one_frame").boolean(true);
  } else {
    const TargetResult* target = result.targets.empty() ? nullptr : &result.targets.front();
    write_target(out, target);
    out.key("verify");
    write_verification(out, target ? target->verify : std::nullopt);
  }
  if (result.dry_run) out.key("dry_run").boolean(true);
  if (result.status == CommandStatus::duplicate) {
    out.key("first");
    if (result.first)
      write_result(out, *result.first, std::nullopt);
    else
      out.null();
  }
  out.key("t").begin_object();
  out.key("received").integer(result.received_ms);
  out.key("queue_ms").milliseconds(result.queue);
  out.key("wire_ms").milliseconds(result.wire);
  out.key("total_ms");
  total ? out.milliseconds(*total) : out.null();
  out.key("bound_ms");
  result.bound ? out.milliseconds(*result.bound) : out.null();
  out.end_object();
  out.key("attempts").integer(std::int64_t{result.attempts});
  out.end_object();
}

void leave_out_details(CommandResult& result) {
  for (TargetResult& target : result.targets) target.detail.clear();
}

void leave_out_values(CommandResult& result) {
  result.detail += std::string(result.detail.empty() ? "" : "; ") +
                   "the values are left out: the result would be larger than 64 KiB";
  for (TargetResult& target : result.targets) {
    target.value.reset();
    if (target.verify) target.verify->read.reset();
  }
}

/// The same of a result that is text already.
std::string without_values(std::string_view recorded) {
  auto json = nlohmann::ordered_json::parse(recorded, nullptr, /*allow_exceptions=*/false);
  for (const char* key : {"value", "verify", "targets"})
    if (json.is_object() && json.contains(key)) json[key] = nullptr;
  return json.dump(-1, ' ', false, nlohmann::ordered_json::error_handler_t::replace);
}

void write_percentiles(Writer& out, std::string_view name, const Percentiles& of) {
  out.key(name).begin_object();
  out.key("p50").number(of.p50).key("p99").number(of.p99);
  out.end_object();
}

/// What the parser does not look at: it skips a byte order mark, and a NUL is the end to it.
/// Neither may come into the midst of another text.
bool may_stand_inside(std::string_view json) {
  return !json.starts_with('\xEF') && json.find('\0') == std::string_view::npos;
}

/// FNV-1a, 64 bit, as 16 hex digits.
std::string fingerprint(std::string_view text) {
  std::uint64_t hash = 0xCBF29CE484222325;
  for (const char c : text) {
    hash ^= static_cast<unsigned char>(c);
    hash *= 0x100000001B3;
  }
  constexpr std::string_view hex = "0123456789abcdef";
  std::string digits;
  for (int shift = 60; shift >= 0; shift -= 4) digits += hex[(hash >> shift) & 0x0F];
  return digits;
}

}  // namespace

std::string telemetry(const Telemetry& message, const DeviceConfig& device, std::string_view boot,
                      std::string_view meta_hash) {
  Writer out;
  out.begin_object();
  out.key("ts").integer(message.ts_ms);
  out.key("seq").integer(message.seq);
  out.key("boot").string(boot);
  out.key("meta").string(meta_hash);
  if (message.span_ms) out.key("span_ms").number(*message.span_ms);
  if (message.partial) out.key("partial").boolean(true);
  const auto is_good = [](const TagReading& reading) {
    return !reading.bad && is_sayable(reading.value);
  };
  bool any_bad = false;
  out.key("values").begin_object();
  for (const TagReading& reading : message.readings) {
    const TagConfig& tag = device.tags.at(reading.tag);
    if (!is_good(reading)) {
      any_bad = true;
      continue;
    }
    out.key(tag.name.get());
    write_value(out, reading.value, precision_of(tag.point));
  }
  out.end_object();
  if (any_bad) {
    out.key("bad").begin_object();
    for (const TagReading& reading : message.readings) {
      if (is_good(reading)) continue;
      const TagConfig& tag = device.tags.at(reading.tag);
      out.key(tag.name.get());
      write_bad(out, reading, message.ts_ms, tag.point);
    }
    out.end_object();
  }
  if (message.written) {
    out.key("written").begin_array();
    for (const TagReading& reading : message.readings)
      out.string(device.tags.at(reading.tag).name.get());
    out.end_array();
  }
  out.end_object();
  return out.take();
}

bool is_intact(std::string_view row) { return may_stand_inside(row) && Json::accept(row); }

std::string history(std::span<const std::string_view> rows) {
  Writer out;
  out.begin_object().key("history").boolean(true).key("rows").begin_array();
  for (const std::string_view row : rows) out.raw(row);
  out.end_array().end_object();
  return out.take();
}

std::string agent_online(std::int64_t since_ms, std::string_view boot, std::string_view version,
                         const std::optional<std::string>& deaf) {
  Writer out;
  out.begin_object().key("state").string("online").key("since").integer(since_ms);
  out.key("boot").string(boot).key("version").string(version);
  if (deaf) out.key("commands").boolean(false).key("reason").string(*deaf);
  out.end_object();
  return out.take();
}

std::string agent_offline(std::optional<std::int64_t> since_ms, std::string_view reason,
                          std::string_view boot) {
  Writer out;
  out.begin_object().key("state").string("offline").key("since");
  since_ms ? out.integer(*since_ms) : out.null();
  out.key("reason").string(reason).key("boot").string(boot).end_object();
  return out.take();
}

std::string device_state(const DeviceStatus& status) {
  Writer out;
  out.begin_object().key("state").string(to_string(status.state));
  out.key("since").integer(status.since_ms).key("reason").word(status.reason);
  out.key("model").word(status.model).key("run");
  status.run ? out.boolean(*status.run) : out.null();
  out.end_object();
  return out.take();
}

Meta device_meta(const DeviceConfig& device) {
  Writer tags;
  tags.begin_object();
  for (const TagConfig& tag : device.tags) {
    const Point& point = tag.point;
    tags.key(tag.name.get()).begin_object();
    tags.key("address").string(point.address.text).key("type").string(to_string(point.type));
    if (point.is_array) tags.key("count").integer(std::int64_t{point.count});
    if (point.type == DataType::string) tags.key("length").integer(std::int64_t{point.length});
    tags.key("unit").string(tag.unit.get());
    tags.key("scale").number(point.scale).key("offset").number(point.offset);
    tags.key("group").string(device.groups.at(tag.group).name);
    tags.key("access").string(tag.writable ? "read_write" : "read");
    const TagLimits& limits = tag.limits;
    if (limits.min) tags.key("min").number(*limits.min);
    if (limits.max) tags.key("max").number(*limits.max);
    if (limits.deadband) tags.key("deadband").number(*limits.deadband);
    tags.end_object();
  }
  tags.end_object();
  const std::string text = tags.take();
  Meta meta;
  meta.hash = fingerprint(text);
  Writer out;
  out.begin_object().key("hash").string(meta.hash).key("tags").raw(text).end_object();
  meta.text = out.take();
  return meta;
}

std::string health(const Health& health, const Config& config) {
  Writer out;
  out.begin_object();
  out.key("ts").integer(health.ts_ms);
  out.key("boot").string(health.boot).key("version").string(health.version);
  out.key("uptime_s").integer(std::int64_t{health.uptime.count()});
  const Samples& samples = health.samples;
  out.key("samples").begin_object();
  out.key("collected").integer(samples.collected).key("recovered").integer(samples.recovered);
  out.key("suppressed").integer(samples.suppressed).key("queued").integer(samples.queued);
  out.key("in_flight").integer(samples.in_flight).key("stored").integer(samples.stored);
  out.key("acknowledged").integer(samples.acknowledged).key("dropped").integer(samples.dropped);
  out.key("published").integer(samples.published);
  out.key("balanced").boolean(samples.balanced());
  out.end_object();
  out.key("links").begin_object();
  for (std::size_t i = 0; i < config.links.size(); ++i) {
    const LinkHealth link = i < health.field.links.size() ? health.field.links[i] : LinkHealth{};
    out.key(config.links[i].name).begin_object();
    out.key("exchanges").integer(link.exchanges).key("timeouts").integer(link.timeouts);
    out.key("naks").integer(link.naks).key("bad_frames").integer(link.bad_frames);
    out.key("unexpected_bytes").integer(link.unexpected_bytes);
    out.key("doubts").integer(link.doubts).key("doubted").boolean(link.doubted);
    out.key("busy_percent").number(link.busy_percent);
    out.key("load_percent").number(link.load_percent);
    write_percentiles(out, "turnaround_ms", link.turnaround_ms);
    out.end_object();
  }
  out.end_object();
  out.key("devices").begin_object();
  for (std::size_t i = 0; i < config.devices.size(); ++i) {
    const DeviceHealth device =
        i < health.field.devices.size() ? health.field.devices[i] : DeviceHealth{};
    out.key(config.devices[i].name).begin_object();
    out.key("polls").integer(device.polls).key("missed").integer(device.missed);
    write_percentiles(out, "late_ms", device.late_ms);
    out.key("dropped").integer(i < health.dropped.size() ? health.dropped[i] : std::uint64_t{0});
    out.key("refused").word(i < health.refused.size() ? health.refused[i] : std::string());
    out.end_object();
  }
  out.end_object();
  out.key("commands").begin_object();
  for (const CommandStatus status : kStatuses) {
    const auto found = health.commands.find(status);
    out.key(to_string(status))
        .integer(found == health.commands.end() ? std::uint64_t{0} : found->second);
  }
  out.end_object();
  out.key("store").begin_object();
  out.key("state").string(health.store_state).key("bytes").integer(health.store_bytes);
  out.key("hours_left");
  health.hours_left ? out.number(*health.hours_left) : out.null();
  out.key("set_aside").word(health.store_set_aside);
  out.end_object();
  out.key("audit");
  if (health.audit_head.empty()) {
    out.null();
  } else {
    out.begin_object().key("records").integer(health.audit_records);
    out.key("head").string(health.audit_head).end_object();
  }
  out.key("clock_synchronised").boolean(health.clock_synchronised);
  out.key("rss_bytes").integer(health.rss_bytes);
  out.end_object();
  return out.take();
}

std::string result(const CommandResult& result, std::optional<std::chrono::nanoseconds> total) {
  const auto written = [total](const CommandResult& what) {
    Writer out;
    write_result(out, what, total);
    return out.take();
  };
  std::string text = written(result);
  if (text.size() <= kMaxResultBytes || !result.recorded.empty()) return text;
  CommandResult shorter = result;
  if (result.first) {
    CommandResult first = *result.first;
    if (!first.recorded.empty()) first.recorded = without_values(first.recorded);
    leave_out_details(first);
    leave_out_values(first);
    shorter.first = std::make_shared<const CommandResult>(std::move(first));
  }
  leave_out_details(shorter);
  text = written(shorter);
  if (text.size() <= kMaxResultBytes) return text;
  leave_out_values(shorter);
  return written(shorter);
}

CommandResult recorded_result(std::string text) {
  CommandResult result;
  result.status = CommandStatus::unknown_outcome;
  const Json json = Json::parse(text, nullptr, /*allow_exceptions=*/false);
  if (!json.is_object() || !may_stand_inside(text)) {
    result.detail = "the record of the result is damaged";
    return result;
  }
  const auto word = [&json](const char* key) {
    const auto value = json.find(key);
    return value != json.end() && value->is_string() ? value->get<std::string>() : std::string();
  };
  for (const CommandStatus status : kStatuses)
    if (word("status") == to_string(status)) result.status = status;
  for (const PlcAnswer answer : {PlcAnswer::ack, PlcAnswer::nak})
    if (word("plc") == text_of(answer)) result.plc = answer;
  result.recorded = std::move(text);
  return result;
}

std::string escaped(const std::string& text) {
  const std::string quoted = Json(text).dump(-1, ' ', true, Json::error_handler_t::replace);
  return quoted.substr(1, quoted.size() - 2);
}

}  // namespace fxagent::json
