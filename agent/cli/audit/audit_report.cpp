#include "agent/cli/audit/audit_report.h"

#include <algorithm>
#include <array>
#include <nlohmann/json.hpp>

#include "agent/commands/audit_records.h"
#include "agent/text/json.h"
#include "agent/text/text.h"

namespace fxagent::audit {
namespace {

using Json = nlohmann::ordered_json;

Json parsed(std::string_view text) {
  Json json = parsed_ordered_json(text);
  return json.is_object() ? json : Json::object();
}

std::int64_t time_at(const Json& object, const char* key) {
  const Json& value = member(object, key);
  return value.is_number_integer() ? value.get<std::int64_t>() : 0;
}

/// Escapes text for a terminal, so that a sender's text cannot move the cursor.
std::string plain(const Json& value) {
  if (value.is_string()) return escaped(value.get_ref<const std::string&>(), Escape::terminal);
  return dumped_in_ascii(value);
}

/// Returns a text like " setpoint D200 = 50".
std::string place_text(const Json& target) {
  std::string out;
  for (const char* key : {"tag", "address"})
    if (member(target, key).is_string()) out += " " + plain(member(target, key));
  if (!member(target, "value").is_null()) out += " = " + plain(member(target, "value"));
  return out;
}

std::string outcome_text(const Json& outcome) {
  std::string out = plain(member(outcome, "status"));
  if (member(outcome, "plc").is_string()) out += ", " + plain(member(outcome, "plc"));
  if (member(outcome, "done").is_number())
    out += ", " + plain(member(outcome, "done")) + " of " + plain(member(outcome, "of"));
  if (member(outcome, "reason").is_string()) out += ", " + plain(member(outcome, "reason"));
  if (member(outcome, "detail").is_string()) out += ": " + plain(member(outcome, "detail"));
  if (member(outcome, "verify").is_object())
    out += ", read back " + plain(member(member(outcome, "verify"), "read"));
  if (member(outcome, "dry_run") == true) out += ", dry run";
  return out;
}

std::string frames_text(const Json& frames) {
  std::string out;
  if (!frames.is_array()) return out;
  for (const Json& frame : frames) {
    const bool leaves = frame.contains("out");
    out += std::string(out.empty() ? "" : " ") + (leaves ? "> " : "< ") +
           plain(member(frame, leaves ? "out" : "in"));
  }
  return out;
}

std::string line_text(const Json& line) {
  const std::int64_t received = time_at(line, "received");
  std::string out = received == 0 ? "before the records" : utc_text(received);
  out += " " + plain(member(line, "device")) + " ";
  out += member(line, "id").is_null() ? "(no id)" : plain(member(line, "id"));
  // Quoted, because the sender chose the name: it must not pass for the text after it.
  if (member(line, "by").is_string()) out += " by \"" + plain(member(line, "by")) + "\"";
  out += ": " + (member(line, "op").is_string() ? plain(member(line, "op")) : "(no op)");
  std::string places = place_text(line);
  if (member(line, "targets").is_array())
    for (const Json& target : member(line, "targets"))
      places += (places.empty() ? "" : ",") + place_text(target);
  out += places + ": ";
  out += member(line, "status").is_string() ? outcome_text(line) : "no result is recorded";
  const std::string frames = frames_text(member(line, "frames"));
  if (!frames.empty()) out += " | " + frames;
  if (const std::int64_t told = time_at(line, "acknowledged"); told != 0)
    out += " | acknowledged " + utc_text(told);
  else if (plain(member(line, "topic")) != kCommandLine)
    out += " | the broker has not acknowledged it";
  return out;
}

/// Merges the records of one command into one flat object.
Json line_of(std::uint64_t number, const Json& came, const Json& outcome, const Json& told) {
  Json line;
  line["arrival"] = number;
  for (const char* key : {"received", "device", "topic", "by", "retained"})
    line[key] = member(came, key);
  if (line["device"].is_null()) line["device"] = member(outcome, "device");
  if (line["device"].is_null()) line["device"] = member(told, "device");
  line["id"] = member(came, "id");
  line["op"] = member(came, "op");
  line["status"] = nullptr;
  const Json& result = member(outcome, "result");
  if (result.is_object())
    for (const auto& item : result.items()) line[item.key()] = item.value();
  if (line["id"].is_null()) line["id"] = member(told, "id");
  if (line["received"].is_null()) line["received"] = member(member(line, "t"), "received");
  line["frames"] = member(outcome, "frames").is_array() ? member(outcome, "frames") : Json::array();
  line["frames_omitted"] = time_at(outcome, "frames_omitted");
  line["finished"] = member(outcome, "ts");
  line["acknowledged"] = member(told, "acknowledged") == true ? member(told, "ts") : Json();
  line["refused_by_broker"] = member(told, "acknowledged") == false;
  for (const char* key : {"payload", "payload_bytes"}) line[key] = member(came, key);
  return line;
}

/// Returns a line like: config "v7" by "ann": rejected: /links: differs … (and 2 more) | in force
/// 0f3a…
std::string config_text(const Json& note) {
  std::string out = utc_text(time_at(note, "ts")) + " config ";
  if (member(note, "version").is_string())
    out += "\"" + plain(member(note, "version")) + "\"";
  else
    out += member(note, "desired_hash").is_null() ? "withdrawn" : "(no version)";
  if (member(note, "by").is_string()) out += " by \"" + plain(member(note, "by")) + "\"";
  out += ": " + plain(member(note, "state"));
  const Json& errors = member(note, "errors");
  if (errors.is_array() && !errors.empty()) {
    out += ": " + plain(errors.front());
    const std::int64_t all = time_at(note, "errors_in_all");
    if (all > 1) out += " (and " + std::to_string(all - 1) + " more)";
  }
  return out + " | in force " + plain(member(note, "hash"));
}

std::string note_text(const Json& note) {
  const std::string kind = text_at(note, "kind");
  if (kind == "config") return config_text(note);
  std::string out = utc_text(time_at(note, "ts")) + " the audit: ";
  if (kind == "pruned")
    return out + "records up to " + plain(member(note, "up_to")) + " were removed";
  if (kind == "begun")
    return out + "started again; the file before it is " + plain(member(note, "after"));
  if (kind == "lost")
    return out + plain(member(note, "records")) + " records were dropped for lack of space";
  return out + plain(note);
}

}  // namespace

void Report::add(const Record& record) {
  const Json said = parsed(record.text);
  const std::string kind = text_at(said, "kind");
  const Json& number = member(said, "arrival");
  if (!number.is_number_unsigned()) {
    notes_.push_back({time_at(said, "ts"), dumped_in_ascii(said), note_text(said)});
    return;
  }
  Pieces& pieces = commands_[number.get<std::uint64_t>()];
  pieces.records.push_back(record.number);
  if (kind == "answered" || kind == "ordered") pieces.came = record.text;
  if (kind == "answered" || kind == "result") pieces.outcome = record.text;
  if (kind == "told") pieces.told = record.text;
}

std::vector<Line> Report::take() {
  std::vector<Line> lines = std::move(notes_);
  for (const auto& [number, pieces] : commands_) {
    Json json = line_of(number, parsed(pieces.came), parsed(pieces.outcome), parsed(pieces.told));
    json["records"] = pieces.records;
    lines.push_back({time_at(json, "received"), dumped_in_ascii(json), line_text(json)});
  }
  commands_.clear();
  notes_.clear();
  std::ranges::stable_sort(lines, {}, &Line::at_ms);
  return lines;
}

std::optional<std::int64_t> since_from(std::string_view text, std::int64_t now_ms) {
  if (text.starts_with('-')) return std::nullopt;
  if (const auto utc_ms = number_from<std::int64_t>(text)) return utc_ms;
  if (const auto utc_ms = utc_ms_from(text)) return utc_ms;
  if (text.empty()) return std::nullopt;
  constexpr std::string_view units = "smhd";
  constexpr std::array<std::int64_t, 4> lengths{1000, 60000, 3600000, 86400000};
  constexpr std::int64_t kMost = 1000000;
  const std::size_t unit = units.find(text.back());
  const auto count = number_from<std::int64_t>(text.substr(0, text.size() - 1));
  if (unit == std::string_view::npos || !count || *count > kMost) return std::nullopt;
  return now_ms - *count * lengths[unit];
}

}  // namespace fxagent::audit
