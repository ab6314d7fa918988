#include "agent/remote/remote_report.h"

#include <algorithm>
#include <array>
#include <nlohmann/json.hpp>
#include <utility>

#include "agent/text/json.h"
#include "agent/text/text.h"

namespace fxagent {
namespace {

using OrderedJson = nlohmann::ordered_json;
using State = RemoteReport::State;

constexpr auto kStates =
    std::to_array<std::string_view>({"applied", "rejected", "rolled_back"});  // as State
static_assert(kStates.size() == static_cast<std::size_t>(State::rolled_back) + 1);

/// Cuts `text` after at most kMostErrorBytes, at the end of a UTF-8 character, and appends "…".
std::string cut(std::string text) {
  if (text.size() <= kMostErrorBytes) return text;
  return std::string(beginning(text, kMostErrorBytes)) + "…";
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

void RemoteAnswer::resume(const KeptConfigs& kept) {
  if (kept.good) report_in_force(kept.good, 0);
  if (kept.rolled_back) report_rolled_back(*kept.rolled_back);
  clear_news();
}

void RemoteAnswer::report(State state, const DesiredConfig& desired, const ConfigErrors& errors,
                          std::int64_t since_ms) {
  has_answer_ = true;
  RemoteReport fresh = make_report(state, desired, errors, since_ms);
  if (report_.says(fresh)) return;
  report_ = std::move(fresh);
  is_news_ = true;
}

void RemoteAnswer::report_in_force(const std::optional<KeptConfig>& in_force,
                                   std::int64_t local_since_ms) {
  if (in_force)
    report(State::applied, in_force->document, {}, in_force->since_ms);
  else
    report(State::applied, {}, {}, local_since_ms);
}

void RemoteAnswer::report_rolled_back(const RolledBackConfig& back) {
  report(State::rolled_back, {"", back.hash, back.version, back.by}, {{"", 0, back.why}},
         back.since_ms);
}

void RemoteAnswer::reject(std::string_view payload, const DesiredConfig& desired,
                          const ConfigErrors& errors, std::int64_t now_ms) {
  rejected_ = payload.size() <= kMaxDesiredBytes ? payload : std::string_view();
  report(State::rejected, desired, errors, now_ms);
}

bool RemoteAnswer::repeat(const DesiredConfig& desired, const std::optional<KeptConfig>& in_force,
                          const std::optional<RolledBackConfig>& back) {
  if (in_force && in_force->document.hash == desired.hash)
    report_in_force(in_force, 0);
  else if (back && back->hash == desired.hash)
    report_rolled_back(*back);
  else
    return false;
  rejected_.clear();  // an older document
  return true;
}

}  // namespace fxagent
