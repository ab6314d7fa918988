#include "agent/remote/remote_report.h"

#include <algorithm>
#include <array>
#include <nlohmann/json.hpp>
#include <utility>

#include "agent/text/json_member.h"

namespace fxagent {
namespace {

using OrderedJson = nlohmann::ordered_json;
using State = RemoteReport::State;

constexpr std::array<std::string_view, 3> kStates{"applied", "rejected",
                                                  "rolled_back"};  // as State

/// Cuts `text` after at most kMostErrorBytes, at the end of a UTF-8 character, and appends "…".
std::string cut(std::string text) {
  if (text.size() <= kMostErrorBytes) return text;
  std::size_t end = kMostErrorBytes;
  const auto is_inside = [&text](std::size_t at) {
    return (static_cast<unsigned char>(text[at]) & 0xC0u) == 0x80u;
  };
  while (end > 0 && is_inside(end)) --end;
  text.resize(end);
  return text + "…";
}

OrderedJson word(const std::string& text) {
  return text.empty() ? OrderedJson(nullptr) : OrderedJson(text);
}

}  // namespace

bool RemoteReport::says(const RemoteReport& other) const {
  return state == other.state && desired.hash == other.desired.hash &&
         errors_in_all == other.errors_in_all &&
         std::ranges::equal(errors, other.errors, {}, text_of, text_of);
}

std::string text_of(const ConfigError& error) {
  return error.pointer.empty() ? error.text : error.pointer + ": " + error.text;
}

std::string_view to_string(State state) { return kStates[static_cast<std::size_t>(state)]; }

RemoteReport make_report(State state, DesiredConfig desired, const ConfigErrors& errors,
                         std::int64_t since_ms) {
  desired.text.clear();
  RemoteReport report{state, std::move(desired), {}, errors.size(), since_ms};
  std::size_t bytes = 0;
  for (const ConfigError& error : errors) {
    ConfigError shown{cut(error.pointer), 0, cut(error.text)};
    if (shown.pointer.size() + shown.text.size() > kMostErrorBytes)
      shown = {"", 0, cut(text_of(shown))};
    bytes += dumped(OrderedJson(text_of(shown))).size() + 1;
    if (report.errors.size() == kMostReportedErrors || bytes > kMostReportedBytes) break;
    report.errors.push_back(std::move(shown));
  }
  return report;
}

std::string reported_text(const RemoteReport& report, const std::string& hash,
                          const std::string& in_force, bool is_confirmed) {
  OrderedJson out;
  out["version"] = word(report.desired.version);
  out["hash"] = hash;
  out["state"] = to_string(report.state);
  auto& errors = out["errors"] = OrderedJson::array();
  for (const ConfigError& error : report.errors) errors.push_back(text_of(error));
  out["errors_in_all"] = report.errors_in_all;
  out["since"] = report.since_ms;
  out["desired_hash"] = word(report.desired.hash);
  out["in_force"] = word(in_force);
  out["confirmed"] = is_confirmed;
  return dumped(out);
}

}  // namespace fxagent
