#include "agent/uplink/identity_conflict.h"

#include <algorithm>
#include <chrono>
#include <nlohmann/json.hpp>
#include <utility>

namespace fxagent {
namespace {

using std::chrono::seconds;

// An agent answers a state that is not its own within a second.
constexpr seconds kAnswersWithin{5};
// Until it counts as gone where our own state does not come back, so that nobody can tell when it
// could have heard it.
constexpr seconds kUnheardFor{30};
constexpr std::size_t kLongestState = 4096;
constexpr std::size_t kLongestBoot = 64;

struct AgentState {
  std::string state;
  std::string reason;
  std::string boot;
};

/// What an agent says of itself; empty words where it is something else.
AgentState agent_state_of(std::string_view payload) {
  AgentState found;
  if (payload.size() > kLongestState) return found;
  const auto json = nlohmann::json::parse(payload, nullptr, /*allow_exceptions=*/false);
  const auto word = [&json](const char* key) {
    if (!json.is_object()) return std::string();
    const auto value = json.find(key);
    return value != json.end() && value->is_string() ? value->get<std::string>() : std::string();
  };
  found = {word("state"), word("reason"), word("boot")};
  const auto is_plain = [](char c) { return c > ' ' && c <= '~'; };
  if (found.boot.size() > kLongestBoot || !std::ranges::all_of(found.boot, is_plain))
    found.boot = "unknown";
  return found;
}

}  // namespace

void IdentityConflict::heard(std::string_view payload, SteadyTime now) {
  const AgentState said = agent_state_of(payload);
  if (said.boot.empty()) return;
  if (said.boot == boot_) {
    is_ours_ = is_ours_ || said.state == "online";
    // Ours has come back: from now on the other one can answer.
    if (is_online_) silent_at_ = std::min(silent_at_, now + kAnswersWithin);
    return;
  }
  if (said.state == "online") {
    other_boot_ = said.boot;
    is_online_ = true;
    silent_at_ = now + kUnheardFor;
  } else if (said.state == "offline") {
    if (was_ours_ && !is_ours_) taken_over_ = true;
    if (taken_over_) other_boot_ = said.boot;
    if (said.boot == other_boot_) is_online_ = false;
    // "lost" is what the broker says for one that we throw off ourselves.
    if (said.reason == "stopped") taken_over_ = false;
  }
}

void IdentityConflict::connection_began(SteadyTime now, SteadyTime::duration steady_after) {
  was_ours_ = was_ours_ || is_ours_;
  is_ours_ = false;
  steady_at_ = now + steady_after;
  silent_at_ = now + kUnheardFor;
}

void IdentityConflict::connection_ended() {
  steady_at_ = SteadyTime::max();
  silent_at_ = SteadyTime::max();
}

void IdentityConflict::keep(SteadyTime now) {
  if (is_online_ && now >= silent_at_) is_online_ = false;
  if (taken_over_ && now >= steady_at_) taken_over_ = false;
}

SteadyTime IdentityConflict::next_wake() const {
  SteadyTime wake = SteadyTime::max();
  if (is_online_) wake = std::min(wake, silent_at_);
  if (taken_over_) wake = std::min(wake, steady_at_);
  return wake;
}

std::optional<std::string> IdentityConflict::other() const {
  if (!is_online_ && !taken_over_) return std::nullopt;
  return other_boot_.empty() ? "unknown" : other_boot_;
}

}  // namespace fxagent
