#include "agent/remote/remote_answer.h"

namespace fxagent {

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
