#include "agent/uplink/json.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <set>
#include <utility>

#include "agent/config_reader.h"
#include "agent/utf8.h"

namespace fxagent::json {
namespace {

constexpr std::int64_t kMaxExactInteger = std::int64_t{1} << 53;

// ---- out ----------------------------------------------------------------------------------------

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

constexpr std::array<CommandStatus, 6> kStatuses{
    CommandStatus::succeeded, CommandStatus::failed,    CommandStatus::rejected,
    CommandStatus::expired,   CommandStatus::duplicate, CommandStatus::unknown_outcome};

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
                   PlcAnswer plc) {
  out.key("status").string(to_string(status));
  out.key("reason").word(to_string(reason));
  out.key("detail").word(detail);
  out.key("plc").word(text_of(plc));
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
  write_outcome(out, result.status, result.reason, result.detail, result.plc);
  out.key("op").word(result.op);
  if (result.is_list) {
    out.key("targets").begin_array();
    for (const TargetResult& target : result.targets) {
      out.begin_object();
      write_target(out, &target);
      write_outcome(out, target.status, target.reason, target.detail, target.plc);
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

void write_percentiles(Writer& out, std::string_view name, const Percentiles& of) {
  out.key(name).begin_object();
  out.key("p50").number(of.p50).key("p99").number(of.p99);
  out.end_object();
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

// ---- in -----------------------------------------------------------------------------------------

using Json = nlohmann::json;

constexpr std::size_t kMaxCommandBytes = 65536;
constexpr std::size_t kMaxIdLength = 64;
constexpr std::size_t kMaxQuoted = 64;  ///< characters of foreign text that a detail repeats
constexpr std::size_t kMaxDepth = 3;  ///< root object, `targets`, one target, an array value in it

constexpr std::array<std::string_view, 12> kCommandKeys{"id",     "op",     "tag",     "address",
                                                        "type",   "value",  "targets", "expires",
                                                        "expect", "verify", "dry_run", "by"};
constexpr std::array<std::string_view, 4> kTargetKeys{"tag", "address", "type", "value"};

std::string in_quotes(std::string_view text) {
  return "'" + std::string(text.substr(0, kMaxQuoted)) + "'";
}

std::string unknown_key(std::string_view key, std::span<const std::string_view> known) {
  return "unknown key " + in_quotes(key) + ", " + did_you_mean(key, known);
}

/// Collects faults and keeps the one that comes first in the contract's order of checks.
class Faults final {
 public:
  void add(Reason reason, std::string detail) {
    if (!first_ || rank(reason) < rank(first_->reason)) first_ = Refusal{reason, std::move(detail)};
  }
  std::optional<Refusal> take() { return std::move(first_); }

 private:
  /// Reason's enumerators stand in that order; the two target faults share one place.
  static int rank(Reason reason) {
    return static_cast<int>(reason == Reason::bad_address ? Reason::unknown_tag : reason);
  }
  std::optional<Refusal> first_;
};

/// What the parser itself does not refuse: a key given twice (which of them counts?) and deep
/// nests.
class Watch final {
 public:
  bool operator()(Json::parse_event_t event, const Json& parsed) {
    switch (event) {
      case Json::parse_event_t::object_start:
      case Json::parse_event_t::array_start:
        open_.emplace_back();
        if (open_.size() > kMaxDepth + 1 && fault_.empty()) fault_ = "nested too deep";
        break;
      case Json::parse_event_t::object_end:
      case Json::parse_event_t::array_end:
        open_.pop_back();
        break;
      case Json::parse_event_t::key:
        if (!open_.back().insert(parsed.get_ref<const std::string&>()).second && fault_.empty())
          fault_ = "key " + in_quotes(parsed.get_ref<const std::string&>()) + " is there twice";
        break;
      case Json::parse_event_t::value:
        break;
    }
    return true;
  }
  const std::string& fault() const { return fault_; }

 private:
  std::vector<std::set<std::string>> open_;
  std::string fault_;
};

std::optional<Scalar> scalar_of(const Json& json) {
  if (json.is_boolean()) return Scalar(json.get<bool>());
  if (json.is_number_unsigned() &&
      json.get<std::uint64_t>() > std::uint64_t{std::numeric_limits<std::int64_t>::max()})
    return Scalar(json.get<double>());
  if (json.is_number_integer()) return Scalar(json.get<std::int64_t>());
  if (json.is_number_float()) return Scalar(json.get<double>());
  if (json.is_string()) return Scalar(json.get<std::string>());
  return std::nullopt;
}

std::optional<Value> value_of(const Json& json) {
  if (!json.is_array()) {
    auto scalar = scalar_of(json);
    if (!scalar) return std::nullopt;
    return Value(*std::move(scalar));
  }
  Scalars items;
  for (const Json& element : json) {
    auto scalar = scalar_of(element);
    if (!scalar) return std::nullopt;
    items.push_back(*std::move(scalar));
  }
  return Value::array(std::move(items));
}

const Json* find(const Json& object, const char* key) {
  const auto found = object.find(key);
  return found == object.end() ? nullptr : &*found;
}

/// A key of a command: null is as good as absent, since templates fill in every key.
const Json* given(const Json& object, const char* key) {
  const Json* value = find(object, key);
  return value == nullptr || value->is_null() ? nullptr : value;
}

void read_id(const Json& object, Command& command, Faults& faults) {
  const Json* id = given(object, "id");
  if (id == nullptr) return faults.add(Reason::missing_id, "no id");
  const auto* text = id->get_ptr<const std::string*>();
  const bool fits =
      text != nullptr && !text->empty() && text->size() <= kMaxIdLength &&
      std::all_of(text->begin(), text->end(), [](char c) { return c >= ' ' && c <= '~'; });
  if (!fits)
    return faults.add(Reason::missing_id,
                      "id must be a string of 1 to 64 printable ASCII characters");
  command.id = *text;
}

void read_op(const Json& object, Command& command, Faults& faults) {
  constexpr std::string_view words = "write, force_on, force_off, read, run, stop";
  const Json* op = given(object, "op");
  const auto* text = op == nullptr ? nullptr : op->get_ptr<const std::string*>();
  if (text == nullptr) {
    return faults.add(Reason::bad_op, std::string(op == nullptr ? "no op" : "op must be a string") +
                                          "; one of " + std::string(words));
  }
  command.op_text = text->substr(0, kMaxQuoted);
  command.op = op_from(*text);
  if (!command.op)
    faults.add(Reason::bad_op, "op " + in_quotes(*text) + " is none of " + std::string(words));
}

/// `object` holds tag, address, type and value: the command itself, or one of its `targets`.
CommandTarget read_target(const Json& object, Faults& faults) {
  CommandTarget target;
  const Json* tag = given(object, "tag");
  const Json* address = given(object, "address");
  const Json* type = given(object, "type");
  if (tag != nullptr && address != nullptr) {
    faults.add(Reason::bad_address, "tag and address exclude each other");
  } else if (tag != nullptr) {
    if (tag->is_string() && !tag->get_ref<const std::string&>().empty())
      target.tag = tag->get<std::string>();
    else
      faults.add(Reason::unknown_tag, "tag must be a string");
    if (type != nullptr) faults.add(Reason::bad_address, "type goes with an address only");
  } else if (address != nullptr) {
    if (address->is_string() && !address->get_ref<const std::string&>().empty())
      target.address = address->get<std::string>();
    else
      faults.add(Reason::bad_address, "address must be a string");
    if (type != nullptr) {
      const auto* word = type->get_ptr<const std::string*>();
      const auto known =
          word == nullptr ? Result<DataType>(fail(ErrorCode::bad_request, "type must be a string"))
                          : data_type_from(*word);
      if (known)
        target.type = *known;
      else
        faults.add(Reason::bad_address, known.error().text);
    }
  } else {
    faults.add(Reason::unknown_tag, "neither tag nor address");
  }
  if (const Json* value = given(object, "value")) {
    target.value = value_of(*value);
    if (!target.value)
      faults.add(Reason::bad_value,
                 "value must be a number, a boolean, a string or an array of them");
  }
  return target;
}

void read_targets(const Json& object, Command& command, Faults& faults) {
  const Json* targets = given(object, "targets");
  const bool has_single =
      std::any_of(kTargetKeys.begin(), kTargetKeys.end(),
                  [&](std::string_view key) { return given(object, key.data()) != nullptr; });
  if (targets == nullptr) {
    const bool needs_none = command.op == Op::run || command.op == Op::stop;
    if (has_single || !needs_none) command.targets.push_back(read_target(object, faults));
    return;
  }
  command.is_list = true;
  if (has_single)
    faults.add(Reason::bad_address, "targets stands in place of tag, address, type and value");
  if (!targets->is_array() || targets->empty())
    return faults.add(Reason::bad_address, "targets must be an array of at least one target");
  for (const Json& entry : *targets) {
    if (!entry.is_object()) {
      faults.add(Reason::bad_address, "every one of targets must be an object");
      continue;
    }
    for (const auto& item : entry.items())
      if (std::find(kTargetKeys.begin(), kTargetKeys.end(), item.key()) == kTargetKeys.end())
        faults.add(Reason::bad_json, unknown_key(item.key(), kTargetKeys));
    command.targets.push_back(read_target(entry, faults));
  }
}

/// A key that must be `true` or `false` where it is there.
std::optional<bool> read_flag(const Json* flag, const char* key, Faults& faults) {
  if (flag == nullptr) return std::nullopt;
  if (flag->is_boolean()) return flag->get<bool>();
  faults.add(Reason::bad_value, std::string(key) + " must be true or false");
  return std::nullopt;
}

void read_conditions(const Json& object, Command& command, Faults& faults) {
  // A condition that got lost on its way (NaN becomes null) must not become an order without one.
  if (const Json* expires = find(object, "expires")) {
    // A sender may write 1.79e12; a fraction or a huge number is no time.
    const double at = expires->is_number() ? expires->get<double>() : -1.0;
    if (at >= 0 && at <= static_cast<double>(kMaxExactInteger) && at == std::floor(at))
      command.expires_ms = static_cast<std::int64_t>(at);
    else
      faults.add(Reason::bad_value, "expires must be milliseconds UTC, a whole number");
  }
  if (const Json* expect = find(object, "expect")) {
    command.expect = value_of(*expect);
    if (!command.expect)
      faults.add(Reason::bad_value,
                 "expect must be a number, a boolean, a string or an array of them");
    else if (command.is_list)
      faults.add(Reason::bad_value, "expect goes with a single target");
  }
  command.verify = read_flag(given(object, "verify"), "verify", faults);
  command.dry_run = read_flag(find(object, "dry_run"), "dry_run", faults).value_or(false);
  if (const Json* by = given(object, "by")) {
    if (by->is_string())
      command.by = by->get<std::string>();
    else
      faults.add(Reason::bad_value, "by must be a string");
  }
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

bool is_intact(std::string_view row) { return Json::accept(row); }

std::string history(std::span<const std::string_view> rows) {
  Writer out;
  out.begin_object().key("history").boolean(true).key("rows").begin_array();
  for (const std::string_view row : rows) out.raw(row);
  out.end_array().end_object();
  return out.take();
}

std::string agent_online(std::int64_t since_ms, std::string_view boot, std::string_view version) {
  Writer out;
  out.begin_object().key("state").string("online").key("since").integer(since_ms);
  out.key("boot").string(boot).key("version").string(version).end_object();
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
  Writer out;
  write_result(out, result, total);
  return out.take();
}

CommandResult recorded_result(std::string text) {
  CommandResult result;
  result.status = CommandStatus::unknown_outcome;
  const Json json = Json::parse(text, nullptr, /*allow_exceptions=*/false);
  if (!json.is_object()) {
    result.detail = "the record of the result is damaged";
    return result;
  }
  const auto word = [&json](const char* key) {
    const Json* value = find(json, key);
    return value != nullptr && value->is_string() ? value->get<std::string>() : std::string();
  };
  for (const CommandStatus status : kStatuses)
    if (word("status") == to_string(status)) result.status = status;
  for (const PlcAnswer answer : {PlcAnswer::ack, PlcAnswer::nak})
    if (word("plc") == text_of(answer)) result.plc = answer;
  result.recorded = std::move(text);
  return result;
}

Command command(std::string_view payload) {
  Command command;
  if (payload.size() > kMaxCommandBytes) {
    command.refusal = Refusal{Reason::too_large, "more than 65536 bytes"};
    return command;
  }
  Watch watch;
  const Json json = Json::parse(
      payload.begin(), payload.end(),
      [&watch](int, Json::parse_event_t event, Json& parsed) { return watch(event, parsed); },
      /*allow_exceptions=*/false);
  if (json.is_discarded() || !json.is_object()) {
    command.refusal =
        Refusal{Reason::bad_json, json.is_discarded() ? "not JSON" : "a command is a JSON object"};
    return command;
  }
  Faults faults;
  if (!watch.fault().empty()) faults.add(Reason::bad_json, watch.fault());
  if (json.contains("status"))
    faults.add(Reason::bad_json, "key 'status' belongs to a result: this is no command");
  for (const auto& item : json.items())
    if (std::find(kCommandKeys.begin(), kCommandKeys.end(), item.key()) == kCommandKeys.end())
      faults.add(Reason::bad_json, unknown_key(item.key(), kCommandKeys));
  read_id(json, command, faults);
  read_op(json, command, faults);
  read_targets(json, command, faults);
  read_conditions(json, command, faults);
  command.refusal = faults.take();
  return command;
}

std::string escaped(const std::string& text) {
  const std::string quoted = Json(text).dump(-1, ' ', true, Json::error_handler_t::replace);
  return quoted.substr(1, quoted.size() - 2);
}

}  // namespace fxagent::json
