#include "agent/remote/remote_report.h"

#include <algorithm>
#include <array>
#include <utility>

#include "agent/text/json_writer.h"
#include "agent/text/text.h"

namespace fxagent {
namespace {

using State = RemoteReport::State;

constexpr auto kStates =
    std::to_array<std::string_view>({"applied", "rejected", "rolled_back"});  // as State
static_assert(kStates.size() == static_cast<std::size_t>(State::rolled_back) + 1);

/// Cuts `text` after at most kMostErrorBytes, at the end of a UTF-8 character, and appends "…".
std::string cut(std::string text) {
  if (text.size() <= kMostErrorBytes) return text;
  return std::string(beginning(text, kMostErrorBytes)) + "…";
}

}  // namespace

bool RemoteReport::says(const RemoteReport& other) const {
  return state == other.state && desired.hash == other.desired.hash &&
         errors_in_all == other.errors_in_all &&
         std::ranges::equal(errors, other.errors, {}, text_of, text_of);
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
    bytes += json::Writer().string(text_of(shown)).take().size() + 1;
    if (report.errors.size() == kMostReportedErrors || bytes > kMostReportedBytes) break;
    report.errors.push_back(std::move(shown));
  }
  return report;
}

std::string reported_text(const RemoteReport& report, const std::string& hash,
                          const std::string& in_force, bool is_confirmed) {
  json::Writer out;
  out.begin_object().key("version").word(report.desired.version).key("hash").string(hash);
  out.key("state").string(to_string(report.state)).key("errors").begin_array();
  for (const ConfigError& error : report.errors) out.string(text_of(error));
  out.end_array().key("errors_in_all").integer(std::uint64_t{report.errors_in_all});
  out.key("since").integer(report.since_ms).key("desired_hash").word(report.desired.hash);
  out.key("in_force").word(in_force).key("confirmed").boolean(is_confirmed);
  return out.end_object().take();
}

void RemoteAnswer::resume(const KeptConfigs& kept) {
  if (kept.good) report_in_force(kept.good, 0);
  if (kept.rolled_back) report_rolled_back(*kept.rolled_back);
  clear_news();
}

void RemoteAnswer::report(State state, const DesiredConfig& desired, const ConfigErrors& errors,
                          std::int64_t since_ms) {
  is_due_ = true;
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
