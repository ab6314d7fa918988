#include "agent/history/batch.h"

#include <algorithm>
#include <cstdint>
#include <limits>
#include <optional>
#include <utility>

#include "agent/text/json.h"
#include "agent/text/sha256.h"
#include "agent/text/text.h"

namespace fxagent::history {
namespace {

using Json = nlohmann::json;

constexpr std::size_t kMostKept = std::size_t{64} << 10;  // bytes of a refused payload
constexpr std::size_t kMostDepth = 32;                    // of JSON
constexpr std::size_t kMostText = 256;                    // bytes of `boot`, `meta` or `why`
constexpr std::size_t kMostTopic = 512;                   // bytes of a refused topic
constexpr std::int64_t kLastMs = 253'402'300'799'999;     // the end of the year 9999

/// Fault of a message or row. An empty text: none.
using Fault = std::string;

std::optional<std::int64_t> whole_number(const Json& object, const char* key, std::int64_t most) {
  const Json& value = member(object, key);
  if (!value.is_number_integer()) return std::nullopt;
  if (value.is_number_unsigned() && value.get<std::uint64_t>() > static_cast<std::uint64_t>(most))
    return std::nullopt;
  const auto number = value.get<std::int64_t>();
  return number < 0 ? std::nullopt : std::optional(number);
}

/// True if the member is a short text: it is part of an index.
bool is_text(const Json& object, const char* key) {
  const Json& text = member(object, key);
  return text.is_string() && text.get_ref<const std::string&>().size() <= kMostText;
}

/// True if a key or a text has the character NUL, which PostgreSQL cannot store.
bool has_nul(const Json& json) {
  if (json.is_string()) return json.get_ref<const std::string&>().find('\0') != std::string::npos;
  for (const auto& [key, member] : json.items())
    if (key.find('\0') != std::string::npos || (!json.is_primitive() && has_nul(member)))
      return true;
  return false;
}

bool is_value(const Json& value) {
  if (value.is_array())
    return std::ranges::all_of(
        value, [](const Json& element) { return element.is_primitive() && !element.is_null(); });
  return value.is_primitive() && !value.is_null();
}

/// Checks a sample of section 4 of the contract. Ignores keys that it does not know.
Fault fault_of(const Json& sample) {
  if (!sample.is_object()) return "a sample is no object";
  if (!whole_number(sample, "ts", kLastMs)) return "ts is no time in ms";
  if (!whole_number(sample, "seq", std::numeric_limits<std::int64_t>::max()))
    return "seq is no number";
  if (!is_text(sample, "boot")) return "boot is no text";
  if (!is_text(sample, "meta")) return "meta is no text";
  const Json& values = member(sample, "values");
  if (!values.is_object()) return "values is no object";
  for (const auto& [tag, value] : values.items())
    if (!is_value(value)) return "the value of a tag is neither a scalar nor an array of them";
  if (const auto bad = sample.find("bad"); bad != sample.end()) {
    if (!bad->is_object()) return "bad is no object";
    for (const auto& [tag, why] : bad->items())
      if (!why.is_object() || !is_text(why, "why")) return "a bad tag has no why";
  }
  const auto span = sample.find("span_ms");
  if (span != sample.end() && !span->is_number()) return "span_ms is no number";
  const auto partial = sample.find("partial");
  if (partial != sample.end() && !partial->is_boolean()) return "partial is no bool";
  if (has_nul(sample)) return "a text has the character NUL";
  return {};
}

/// True if objects and arrays are nested more than kMostDepth deep. Writing them would need as much
/// stack.
bool is_deep(std::string_view json) {
  std::size_t depth = 0;
  bool in_text = false;
  for (std::size_t i = 0; i < json.size(); ++i) {
    const char c = json[i];
    if (in_text && c == '\\')
      ++i;
    else if (c == '"')
      in_text = !in_text;
    else if (!in_text && (c == '{' || c == '['))
      ++depth;
    else if (!in_text && (c == '}' || c == ']') && depth > 0)
      --depth;
    if (depth > kMostDepth) return true;
  }
  return false;
}

/// Parses without exceptions. The result is discarded if it is not JSON, or nested too deep.
Json parsed(const std::string& payload) {
  if (is_deep(payload)) return Json(Json::value_t::discarded);
  return parsed_json(payload);
}

}  // namespace

Batch::Batch(std::string root) : root_(std::move(root)) {}

void Batch::add(const Message& message) {
  std::string_view rest = message.topic;
  if (!rest.starts_with(root_ + '/')) return refuse(message, "the topic is not below the root");
  rest.remove_prefix(root_.size() + 1);
  const std::string_view id = take_until(rest, '/');
  const std::string agent = root_ + '/' + std::string(id);
  if (!is_name(id)) return refuse(message, "the topic has no valid name of an agent");
  if (rest == "health") return add_health(message, agent);
  add_data(message, agent, rest);
}

void Batch::add_data(const Message& message, std::string_view agent, std::string_view rest) {
  const std::string_view device = take_until(rest, '/');
  const std::string_view data = take_until(rest, '/');
  const std::string_view group = take_until(rest, '/');
  const bool is_history = rest == "history";
  if (data != "data" || !is_name(device) || !is_name(group) || !(rest.empty() || is_history))
    return refuse(message, "the topic is not one of data");
  Json payload = parsed(message.payload);
  if (payload.is_discarded()) return refuse(message, "the payload is not JSON");
  Json rows = Json::array();
  if (is_history) {
    const auto found = payload.is_object() ? payload.find("rows") : payload.end();
    if (found == payload.end() || !found->is_array()) return refuse(message, "rows is no array");
    rows = std::move(*found);
  } else {
    rows.push_back(std::move(payload));
  }
  Fault fault;
  for (Json& row : rows) {
    if (Fault own = fault_of(row); !own.empty()) {
      if (fault.empty()) fault = std::move(own);
      continue;
    }
    Json& sample = samples_.emplace_back(
        Json{{"agent", agent}, {"device", device}, {"group_name", group}, {"history", is_history}});
    for (const char* key :
         {"seq", "ts", "boot", "meta", "span_ms", "values", "bad", "partial", "written"})
      if (const auto found = row.find(key); found != row.end()) sample[key] = std::move(*found);
  }
  if (!fault.empty()) refuse(message, fault);
}

void Batch::add_health(const Message& message, std::string_view agent) {
  const Json health = parsed(message.payload);
  if (!health.is_object()) return refuse(message, "the health is no object");
  constexpr auto kMost = std::int64_t{1} << 53;
  const auto ts = whole_number(health, "ts", kLastMs);
  const Json& samples = member(health, "samples");
  const Json& devices = member(health, "devices");
  if (!ts || !is_text(health, "boot") || !samples.is_object() || !devices.is_object())
    return refuse(message, "the health has no ts, boot, samples and devices");
  std::int64_t waiting = 0;
  for (const char* key : {"queued", "in_flight", "stored"})
    waiting += whole_number(samples, key, kMost).value_or(0);
  Json dropped = Json::object();
  for (const auto& [name, device] : devices.items()) {
    if (!is_name(name) || !device.is_object()) continue;
    if (const auto count = whole_number(device, "dropped", kMost)) dropped[name] = *count;
  }
  health_.push_back({{"agent", agent},
                     {"boot", health["boot"]},
                     {"ts", *ts},
                     {"waiting", waiting},
                     {"dropped", std::move(dropped)}});
}

void Batch::refuse(const Message& message, const std::string& reason) {
  const std::string_view kept = std::string_view(message.payload).substr(0, kMostKept);
  refused_.push_back({{"topic", message.topic.substr(0, kMostTopic)},
                      {"reason", reason},
                      {"payload", to_text(as_bytes(kept))},
                      {"bytes", message.payload.size()},
                      {"digest", to_text(sha256(message.topic + '\n' + message.payload))}});
}

std::string Batch::text() const {
  const Json all = {{"samples", samples_}, {"health", health_}, {"refused", refused_}};
  return dumped(all);
}

}  // namespace fxagent::history
