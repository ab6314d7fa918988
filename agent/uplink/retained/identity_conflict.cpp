#include "agent/uplink/retained/identity_conflict.h"

#include <algorithm>
#include <chrono>

#include "agent/text/json.h"

namespace fxagent {
namespace {

using std::chrono::seconds;

// An agent replaces a state that is not its own within 1 s.
constexpr seconds kAnswersWithin{5};
// Time after which another agent counts as gone if our own state does not come back. Without it we
// do not know when the other agent could have received our state.
constexpr seconds kUnheardFor{30};
constexpr std::size_t kMostOthers = 16;
constexpr std::size_t kLongestState = 4096;
constexpr std::size_t kLongestBoot = 64;

struct AgentState {
  std::string state;
  std::string reason;
  std::string boot;
};

/// Returns what an agent publishes about itself; empty strings if the payload is anything else.
AgentState agent_state_of(std::string_view payload) {
  AgentState found;
  if (payload.size() > kLongestState) return found;
  const auto json = parsed_json(payload);
  found = {text_at(json, "state"), text_at(json, "reason"), text_at(json, "boot")};
  const auto is_plain = [](char c) { return c > ' ' && c <= '~'; };
  if (found.boot.size() > kLongestBoot || !std::ranges::all_of(found.boot, is_plain))
    found.boot = IdentityConflict::kUnknown;
  return found;
}

}  // namespace

void IdentityConflict::heard(std::string_view payload, SteadyTime now) {
  const AgentState said = agent_state_of(payload);
  if (said.boot.empty()) return;
  if (said.boot == boot_) {
    is_ours_ = is_ours_ || said.state == "online";
    unheard_at_ = SteadyTime::max();
    logged_unheard_ = false;
    // Our state has come back, so the other agents can answer now.
    for (auto& [boot, silent_at] : online_) silent_at = std::min(silent_at, now + kAnswersWithin);
    return;
  }
  if (is_ours_too_ && is_ours_too_(said.boot)) return;
  if (said.state == "online") {
    other_boot_ = said.boot;
    if (online_.size() >= kMostOthers && !online_.contains(said.boot))
      online_.erase(online_.begin());
    online_[said.boot] = now + kUnheardFor;
  } else if (said.state == "offline") {
    if (ours_on_.contains(server_) && !is_ours_) taken_over_ = true;
    if (taken_over_) other_boot_ = said.boot;
    online_.erase(said.boot);
    // The broker publishes "lost" for an agent whose session we have taken over.
    if (said.reason == "stopped") taken_over_ = false;
  }
}

void IdentityConflict::connection_began(const std::string& server, SteadyTime now,
                                        SteadyTime::duration steady_after) {
  if (is_ours_) ours_on_.insert(server_);
  server_ = server;
  is_ours_ = false;
  steady_at_ = now + steady_after;
  unheard_at_ = now + kUnheardFor;
  for (auto& [boot, silent_at] : online_) silent_at = now + kUnheardFor;
}

void IdentityConflict::connection_ended() {
  steady_at_ = unheard_at_ = SteadyTime::max();
  for (auto& [boot, silent_at] : online_) silent_at = SteadyTime::max();
}

bool IdentityConflict::keep(SteadyTime now, bool messages_held) {
  if (messages_held) {
    for (auto& [boot, silent_at] : online_) silent_at = std::max(silent_at, now + kAnswersWithin);
    unheard_at_ = std::max(unheard_at_, now + kAnswersWithin);
  }
  std::erase_if(online_, [now](const auto& each) { return each.second <= now; });
  if (taken_over_ && now >= steady_at_) taken_over_ = false;
  if (now < unheard_at_) return false;
  unheard_at_ = SteadyTime::max();
  return !std::exchange(logged_unheard_, true);
}

SteadyTime IdentityConflict::next_wake() const {
  SteadyTime wake = unheard_at_;
  for (const auto& [boot, silent_at] : online_) wake = std::min(wake, silent_at);
  if (taken_over_) wake = std::min(wake, steady_at_);
  return wake;
}

std::optional<std::string> IdentityConflict::other() const {
  if (online_.empty() && !taken_over_) return std::nullopt;
  if (!online_.empty() && !online_.contains(other_boot_)) return online_.begin()->first;
  return other_boot_.empty() ? std::string(kUnknown) : other_boot_;
}

}  // namespace fxagent
