#include "agent/cli/describe/payloads.h"

#include <algorithm>
#include <initializer_list>
#include <optional>
#include <utility>

#include "agent/commands/parse/parse.h"
#include "agent/handover/telemetry.h"
#include "agent/remote/desired_config.h"
#include "agent/remote/remote_report.h"
#include "agent/text/json.h"
#include "agent/text/json_writer.h"
#include "protocol/value/point.h"

namespace fxagent::contract {
namespace {

// ---- words of the program -----------------------------------------------------------------------

/// Returns the words of the enumerators from `first` to `last`.
template <class Enum>
Json words(Enum first, Enum last) {
  Json out = Json::array();
  for (auto each = static_cast<unsigned>(first); each <= static_cast<unsigned>(last); ++each)
    out.push_back(to_string(static_cast<Enum>(each)));
  return {{"enum", std::move(out)}};
}

Json bad_reasons() { return words(BadReason::timeout, BadReason::bad_value); }

Json device_reasons() {
  Json out = bad_reasons();
  for (const char* word : {"starting", "never_silent", "model_unknown", "yielded"})
    out["enum"].push_back(word);
  return out;
}

// ---- kinds of values ----------------------------------------------------------------------------

Json text() { return {{"type", "string"}}; }
Json text(const char* pattern) { return {{"type", "string"}, {"pattern", pattern}}; }
/// A text of `least` to `most` characters.
Json text(std::size_t least, std::size_t most) {
  return {{"type", "string"}, {"minLength", least}, {"maxLength", most}};
}
Json boolean() { return {{"type", "boolean"}}; }
Json number() { return {{"type", "number"}}; }
Json duration() { return {{"type", "number"}, {"minimum", 0}}; }
/// A whole number of at least 0.
Json count() { return {{"type", "integer"}, {"minimum", 0}}; }
Json between(std::int64_t least, std::int64_t most) {
  return {{"type", "integer"}, {"minimum", least}, {"maximum", most}};
}
/// Milliseconds UTC since 1970.
Json time() { return {{"type", "integer"}}; }
Json nothing() { return {{"type", "null"}}; }
Json list(Json items, std::size_t least = 0) {
  Json out{{"type", "array"}, {"items", std::move(items)}};
  if (least > 0) out["minItems"] = least;
  return out;
}
Json name() { return text("^[a-z0-9_-]{1,64}$"); }
/// An object whose keys are names of tags, links or devices.
Json by_name(Json schema) {
  return {{"type", "object"},
          {"propertyNames", {{"pattern", "^[a-z0-9_-]{1,64}$"}}},
          {"additionalProperties", std::move(schema)}};
}
Json boot() { return text("^[0-9a-f]{8}$"); }
Json hash() { return text("^[0-9a-f]{16}$"); }

// ---- objects ------------------------------------------------------------------------------------

enum class Presence { always, sometimes };
constexpr auto sometimes = Presence::sometimes;

struct Key {
  const char* name;
  Json schema;
  const char* meaning = "";
  Presence presence = Presence::always;
};

Json object(const std::initializer_list<Key>& keys) {
  Json required = Json::array();
  Json properties = Json::object();
  for (const Key& key : keys) {
    if (key.presence == Presence::always) required.push_back(key.name);
    Json& property = properties[key.name] = key.schema;
    if (*key.meaning != '\0') property["description"] = key.meaning;
  }
  Json out{{"type", "object"}};
  if (!required.empty()) out["required"] = std::move(required);
  out["properties"] = std::move(properties);
  return out;
}

/// An object that must not have other keys.
Json only(const std::initializer_list<Key>& keys) {
  Json out = object(keys);
  out["additionalProperties"] = false;
  return out;
}

Json percentiles() { return object({{"p50", number()}, {"p99", number()}}); }

// ---- states and samples -------------------------------------------------------------------------

void add_states(Json& out) {
  out["agent_state"] = one_of({reference("agent_online"), reference("agent_offline")});
  out["agent_online"] = object({
      {"state", constant("online")},
      {"since", time(), "Start of the agent, ms UTC"},
      {"boot", boot(), "New at every start"},
      {"version", text()},
      {"commands", constant(false), "Present while the agent receives no commands", sometimes},
      {"reason", text(), "With `commands`: the cause", sometimes},
      {"conflict", text("^([0-9a-f]{8}|unknown)$"), "`boot` of another agent with this id",
       sometimes},
  });
  out["agent_offline"] = object({
      {"state", constant("offline")},
      {"since", nullable(time()), "The stop, ms UTC; null in the last will"},
      {"reason", {{"enum", {"stopped", "lost"}}}, "A clean stop, or the last will"},
      {"boot", boot()},
  });
  out["device_state"] = object({
      {"state", words(DeviceStatus::State::offline, DeviceStatus::State::online)},
      {"since", time(), "Last change of `state`, ms UTC"},
      {"reason", nullable(device_reasons())},
      {"reason_text", nullable(text()), "`reason` for a person"},
      {"model", nullable(text()), "Model that the PLC reports"},
      {"model_configured", nullable(text()), "Model in the config, if the PLC reports another"},
      {"run", nullable(boolean()), "True if the PLC is in RUN"},
  });
  out["meta"] = object({
      {"hash", hash(), "Changes with `tags`; every sample has it as `meta`"},
      {"tags", by_name(reference("meta_tag"))},
  });
  out["meta_tag"] = object({
      {"address", text()},
      {"type", reference("data_type")},
      {"count", between(1, 65535), "Elements of an array", sometimes},
      {"length", between(1, 65535), "Characters of a string", sometimes},
      {"unit", text()},
      {"scale", number()},
      {"offset", number()},
      {"group", name()},
      {"access", {{"enum", {"read", "read_write"}}}},
      {"min", number(), "", sometimes},
      {"max", number(), "", sometimes},
      {"deadband", number(), "", sometimes},
      {"description", text(), "", sometimes},
      {"states",
       {{"type", "object"},
        {"propertyNames", {{"pattern", "^(0|-?[1-9][0-9]*)$"}}},
        {"additionalProperties", text()}},
       "Labels of values",
       sometimes},
  });
}

void add_samples(Json& out) {
  out["data_type"] = words(DataType::boolean, DataType::float64);
  out["scalar"] = one_of({boolean(), number(), text()});
  out["value"] = one_of({boolean(), number(), text(), list(reference("scalar"))});
  out["bad_reading"] = object({
      {"why", bad_reasons()},
      {"since", time(), "When the tag turned bad, ms UTC"},
      {"last", nullable(reference("value")), "The last good value"},
      {"last_ts", nullable(time()), "Time of `last`, ms UTC"},
  });
  out["sample"] = object({
      {"ts", time(), "Time of the last byte of the last reply, ms UTC"},
      {"seq", count(), "Sequence number of the device"},
      {"boot", boot(), "`boot` of the agent's state"},
      {"meta", hash(), "`hash` of the device's meta"},
      {"span_ms", duration(), "From the first reply to the last", sometimes},
      {"partial", constant(true), "Has only the tag that a command has just written", sometimes},
      {"values", by_name(reference("value"))},
      {"bad", by_name(reference("bad_reading")), "Tags without a value", sometimes},
      {"written", list(name()), "With `partial`: written and not read back", sometimes},
  });
  out["history"] = object({
      {"history", constant(true)},
      {"rows", list(reference("sample"), 1), "Samples, oldest first"},
  });
}

// ---- commands -----------------------------------------------------------------------------------

/// Null counts as absent.
Json expires() { return nullable(between(0, json::kMaxExactInteger)); }

/// Returns the case of a command, or of one of its targets, whose place has the key `present`. The
/// keys `others` are absent.
Json place(const char* present, std::initializer_list<const char*> others, bool with_value) {
  Json out{{"required", {present}}, {"properties", {{present, {{"not", nothing()}}}}}};
  if (with_value) out["required"].push_back("value");
  for (const char* other : others) out["properties"][other] = nothing();
  return out;
}

/// Returns a target of a list, with a value if `op` is a write.
Json target(Op op) {
  const bool writes = op == Op::write;
  Json out = only({
      {"tag", nullable(text(1, 128)), "", sometimes},
      {"address", nullable(text(1, 128)), "", sometimes},
      {"type", nullable(reference("data_type")), "", sometimes},
  });
  if (writes) out["properties"]["value"] = reference("value");
  out["oneOf"] = {place("tag", {"address", "type"}, writes), place("address", {"tag"}, writes)};
  return out;
}

/// Returns the command with the keys that go with `op`. The other keys may only be null.
Json command(Op op) {
  Json out = only({
      {"id", reference("id"), "A new one for every command of the device"},
      {"op", constant(to_string(op))},
      {"tag", nothing(), "The target by its name", sometimes},
      {"address", nothing(), "The target by its address", sometimes},
      {"type", nothing(), "With `address`: the type of the value", sometimes},
      {"targets", nothing(), "Several targets", sometimes},
      {"expires", expires(), "Do not send it after this, ms UTC", sometimes},
      {"verify", nothing(), "Read the value back", sometimes},
      {"count", nothing(), "Elements to read", sometimes},
      {"length", nothing(), "Characters to read", sometimes},
      {"dry_run", nullable(boolean()), "Make every check and send nothing", sometimes},
      {"by", nullable(text()), "The sender, for the audit", sometimes},
  });
  if (op == Op::run || op == Op::stop) return out;
  Json& keys = out["properties"];
  const auto allow = [&keys](const char* key, Json schema) {
    Json kept = keys[key];
    schema = nullable(std::move(schema));
    if (kept.contains("description")) schema["description"] = kept["description"];
    keys[key] = std::move(schema);
  };
  allow("tag", text(1, 128));
  allow("address", text(1, 128));
  allow("type", reference("data_type"));
  if (op == Op::read) {
    allow("count", between(1, 125));
    allow("length", between(1, 250));
    Json by_tag = place("tag", {"address", "type", "count", "length"}, false);
    Json numbers = place("address", {"tag", "length"}, false);
    numbers["properties"]["type"] = {{"not", constant("string")}};
    Json string = place("address", {"tag", "count"}, false);
    string["required"].push_back("type");
    string["properties"]["type"] = constant("string");
    out["oneOf"] = {std::move(by_tag), std::move(numbers), std::move(string)};
    return out;
  }
  const bool writes = op == Op::write;
  allow("verify", boolean());
  keys["expect"] = reference("value");
  if (writes) keys["value"] = reference("value");
  Json targets = list(reference(writes ? "write_target" : "force_target"), 1);
  targets["maxItems"] = kMostTargets;
  allow("targets", std::move(targets));
  Json several = place("targets", {"tag", "address", "type"}, false);
  if (writes) several["properties"]["value"] = never();
  several["properties"]["expect"] = never();
  out["oneOf"] = {place("tag", {"address", "type", "targets"}, writes),
                  place("address", {"tag", "targets"}, writes), std::move(several)};
  return out;
}

void add_commands(Json& out) {
  out["id"] = one_of({text("^[ -~]{1,64}$"), integer()});
  out["write_target"] = target(Op::write);
  out["force_target"] = target(Op::force_on);
  Json::array_t all;
  for (const Op op : kOps) all.push_back(reference(command_schema_name(op)));
  out["command"] = one_of(std::move(all));
  for (const Op op : kOps) out[command_schema_name(op)] = command(op);
  Json resume = only({
      {"id", nullable(reference("id")), "", sometimes},
      {"op", constant("resume")},
      {"by", nullable(text()), "", sometimes},
      {"expires", expires(), "", sometimes},
  });
  Json yield = resume;
  yield["properties"]["op"] = constant("yield");
  yield["properties"]["minutes"] = nullable(between(1, kLongestYield.count()));
  out["link_command"] = one_of({std::move(yield), std::move(resume)});
}

// ---- results ------------------------------------------------------------------------------------

Json plc() { return nullable({{"enum", {"ACK", "NAK"}}}); }

void add_results(Json& out) {
  out["status"] = words(kCommandStatuses.front(), kCommandStatuses.back());
  out["reason"] = words(Reason::too_large, Reason::interrupted);
  out["verification"] = object({
      {"read", nullable(reference("value")), "The value read back, or found instead of `expect`"},
      {"match", boolean()},
  });
  out["target_result"] = object({
      {"tag", nullable(text())},
      {"address", nullable(text())},
      {"value", nullable(reference("value"))},
      {"status", reference("status")},
      {"reason", nullable(reference("reason"))},
      {"detail", nullable(text())},
      {"plc", plc()},
      {"done", count(), "", sometimes},
      {"of", count(), "", sometimes},
      {"verify", nullable(reference("verification"))},
  });
  Json result = object({
      {"id", nullable(one_of({text(), integer()})), "As in the command"},
      {"status", reference("status")},
      {"reason", nullable(reference("reason"))},
      {"detail", nullable(text()), "For people"},
      {"plc", plc(), "Answer of the device"},
      {"done", count(), "The part that was certainly carried out", sometimes},
      {"of", count(), "The whole of which `done` is a part", sometimes},
      {"op", nullable(text()), "As in the command"},
      {"tag", nullable(text()), "", sometimes},
      {"address", nullable(text()), "", sometimes},
      {"value", nullable(reference("value")), "The value read, or to write", sometimes},
      {"verify", nullable(reference("verification")), "", sometimes},
      {"targets", nullable(list(reference("target_result"))), "Of a list", sometimes},
      {"one_frame", constant(true), "One frame carried the whole list", sometimes},
      {"dry_run", constant(true), "As in the command", sometimes},
      {"first", nullable(reference("result")), "With DUPLICATE: the first result", sometimes},
      {"t", object({
                {"received", time(), "Arrival at the agent, ms UTC"},
                {"queue_ms", duration()},
                {"wire_ms", duration()},
                {"total_ms", nullable(duration())},
                {"bound_ms", nullable(duration()), "Limit of `queue_ms` + `wire_ms`"},
            })},
      {"attempts", count(), "Frames that carry out the command, repeats included"},
  });
  result["oneOf"] = {{{"required", {"tag", "address", "value", "verify"}}},
                     {{"required", {"targets"}}}};
  const Json duplicate{{"properties", {{"status", constant("DUPLICATE")}}}};
  result["if"] = duplicate;
  result["then"] = {{"required", {"first"}}};
  result["else"] = {{"not", {{"required", {"first"}}}}};
  out["result"] = std::move(result);
}

// ---- health and remote config -------------------------------------------------------------------

Json sample_counts() {
  return object({
      {"collected", count()},
      {"recovered", count()},
      {"suppressed", count()},
      {"queued", count()},
      {"in_flight", count()},
      {"stored", count()},
      {"acknowledged", count()},
      {"dropped", count()},
      {"published", count()},
      {"balanced", boolean(), "False only if the agent has a bug"},
  });
}

void add_health(Json& out) {
  out["link_health"] = object({
      {"exchanges", count(), "Requests sent"},
      {"timeouts", count()},
      {"naks", count()},
      {"bad_frames", count()},
      {"unexpected_bytes", count()},
      {"doubts", count()},
      {"doubted", boolean(), "True while the line is in doubt"},
      {"yielded", boolean(), "True while the port is free for another program"},
      {"busy_percent", duration()},
      {"load_percent", duration(), "Share of the line that the poll intervals need"},
      {"turnaround_ms", percentiles()},
  });
  out["device_health"] = object({
      {"polls", count()},
      {"missed", count(), "Poll intervals left out"},
      {"late_ms", percentiles()},
      {"dropped", count(), "Lost samples"},
      {"refused", nullable(text()), "Reason code with which the broker refuses the samples"},
  });
  Json results = object({});
  for (const CommandStatus status : kCommandStatuses) {
    results["required"].push_back(to_string(status));
    results["properties"][std::string(to_string(status))] = count();
  }
  out["health"] = object({
      {"ts", time()},
      {"boot", boot()},
      {"version", text()},
      {"uptime_s", count()},
      {"conflict", nullable(text()), "`boot` of another agent with this id"},
      {"config",
       object({
           {"hash", hash()},
           {"since", time()},
           {"last_reload", nullable(object({
                               {"state", {{"enum", {"applied", "unchanged", "rejected"}}}},
                               {"ts", time()},
                               {"errors", list(text())},
                               {"errors_in_all", count()},
                           }))},
           {"remote",
            nullable(object({
                {"version", nullable(text())},
                {"state", words(RemoteReport::State::applied, RemoteReport::State::rolled_back)},
                {"confirmed", boolean()},
            }))},
       })},
      {"samples", sample_counts()},
      {"profiles",
       {{"type", "object"},
        {"additionalProperties", object({
                                     {"server", text()},
                                     {"connected", boolean()},
                                     {"ready", boolean(), "Samples are sent"},
                                     {"why", nullable(text()), "Why it is not connected"},
                                     {"samples", sample_counts()},
                                 })}},
       "Profiles with a session of their own, by name",
       sometimes},
      {"links", by_name(reference("link_health"))},
      {"devices", by_name(reference("device_health"))},
      {"commands", std::move(results), "Results by status"},
      {"store", object({
                    {"state", {{"enum", {"disk", "memory", "hangs"}}}},
                    {"bytes", count()},
                    {"hours_left", nullable(number())},
                    {"set_aside", nullable(text()), "A damaged file"},
                })},
      {"audit", nullable(object({{"records", count()}, {"head", text("^[0-9a-f]{64}$")}}))},
      {"clock_synchronised", boolean()},
      {"rss_bytes", count()},
  });
}

void add_remote_config(Json& out) {
  Json desired = only({
      {"version", text(1, kMaxDesiredVersion), "The answer repeats it"},
      {"by", text(1, kMaxDesiredVersion), "The sender, for the audit", sometimes},
      {"config", {{"type", "object"}}, "Sections that replace those of the local file", sometimes},
      {"patch", {{"type", "object"}}, "RFC 7396 merge onto the local file", sometimes},
  });
  desired["oneOf"] = {{{"required", {"config"}}}, {{"required", {"patch"}}}};
  out["desired"] = std::move(desired);
  out["reported"] = object({
      {"version", nullable(text()), "Of the answered document"},
      {"hash", hash(), "Of the config in force"},
      {"state", words(RemoteReport::State::applied, RemoteReport::State::rolled_back)},
      {"errors", list(text())},
      {"errors_in_all", count()},
      {"since", time(), "Start of this state, ms UTC"},
      {"desired_hash", nullable(hash()), "Of the answered document"},
      {"in_force", nullable(text()), "Remote version in force"},
      {"confirmed", boolean(), "False: the config in force is on trial"},
  });
}

// ---- values of a tag ----------------------------------------------------------------------------

constexpr auto kExact = static_cast<double>(json::kMaxExactInteger);

/// Returns the number as samples have it.
Json whole(std::int64_t number) {
  if (number > json::kMaxExactInteger || number < -json::kMaxExactInteger)
    return std::to_string(number);
  return number;
}

bool is_real(DataType type) { return type == DataType::float32 || type == DataType::float64; }

Json number_schema(const TagConfig& tag, Use use) {
  const Point& point = tag.point;
  const TagLimits none;
  const TagLimits& limits = use == Use::command ? tag.units->limits : none;
  std::optional<double> least = limits.min;
  std::optional<double> greatest = limits.max;
  bool may_be_text = false;
  const auto range = is_real(point.type) ? std::nullopt : value_range(point);
  if (range) {
    may_be_text = range->least < -kExact || range->greatest > kExact;
    least = std::max({range->least, -kExact, least.value_or(range->least)});
    greatest = std::min({range->greatest, kExact, greatest.value_or(range->greatest)});
  }
  const bool is_whole = use == Use::sample && !is_real(point.type) && !point.scaled();
  Json out{{"type", is_whole ? "integer" : "number"}};
  if (least) out["minimum"] = json_number(*least);
  if (greatest) out["maximum"] = json_number(*greatest);
  if (!may_be_text) return out;
  return one_of({std::move(out), text("^(0|-?[1-9][0-9]*)$")});
}

Json element_schema(const TagConfig& tag, Use use) {
  switch (tag.point.type) {
    case DataType::boolean:
      if (use == Use::sample) return boolean();
      return {{"enum", {true, false, 1, 0}}};
    case DataType::string: {
      Json out{{"type", "string"}, {"maxLength", tag.point.length}};
      if (use == Use::command) out["pattern"] = R"(^[\u0001-\u00ff]*$)";
      return out;
    }
    default:
      return number_schema(tag, use);
  }
}

/// Returns `element` as a choice of labelled values and of all others.
Json labelled(const TagConfig& tag, Use use, Json element) {
  const bool is_bool = tag.point.type == DataType::boolean;
  Json::array_t choices;
  Json values = Json::array();
  const TagLimits& limits = tag.units->limits;
  for (const auto& [number, label] : tag.units->states) {
    const auto value = static_cast<double>(number);
    if (use == Use::command &&
        (value < limits.min.value_or(value) || value > limits.max.value_or(value)))
      continue;
    const Json one = is_bool ? Json(number != 0) : whole(number);
    values.push_back(one);
    choices.push_back({{"const", one}, {"title", label}});
  }
  if (choices.empty()) return element;
  element["not"] = {{"enum", std::move(values)}};
  choices.push_back(std::move(element));
  return one_of(std::move(choices));
}

std::string description_of(const TagConfig& tag) {
  std::string out = tag.units->description;
  if (!tag.units->unit.empty()) out += (out.empty() ? "Unit: " : "; unit: ") + tag.units->unit;
  return out;
}

}  // namespace

Json reference(const std::string& name) { return {{"$ref", "#/$defs/" + name}}; }

Json one_of(Json::array_t schemas) { return {{"oneOf", std::move(schemas)}}; }

Json nullable(Json schema) { return one_of({std::move(schema), nothing()}); }

Json never() { return {{"not", Json::object()}}; }

Json constant(Json value) { return {{"const", std::move(value)}}; }

Json integer() { return between(-json::kMaxExactInteger, json::kMaxExactInteger); }

std::string command_schema_name(Op op) { return "command_" + std::string(to_string(op)); }

void append(Json& object, std::string key, Json value) {
  object.get_ref<Json::object_t&>().emplace_back(std::move(key), std::move(value));
}

Json payload_schemas() {
  Json out = Json::object();
  add_states(out);
  add_samples(out);
  add_commands(out);
  add_results(out);
  add_health(out);
  add_remote_config(out);
  return out;
}

Json value_schema(const TagConfig& tag, Use use) {
  Json schema = labelled(tag, use, element_schema(tag, use));
  if (tag.point.is_array)
    schema = {{"type", "array"},
              {"items", std::move(schema)},
              {"minItems", tag.point.count},
              {"maxItems", tag.point.count}};
  if (std::string text = description_of(tag); !text.empty())
    schema["description"] = std::move(text);
  return schema;
}

}  // namespace fxagent::contract
