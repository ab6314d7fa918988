#include "agent/cli/fleet/rollout.h"

#include <algorithm>
#include <span>
#include <utility>

namespace fxagent {
namespace {

using Outcome = Push::Outcome;
using Presence = FleetAgent::Presence;

bool is_refusal(const FleetReport& report) {
  return report.state == "rejected" || report.state == "rolled_back";
}

/// Sets the outcome if the agent has answered this document. A refusal from before the push does
/// not count: the agent tries a rejected document again, and answers every document that arrives.
void judge(Push& push, const FleetAgent& agent, bool confirmed) {
  if (!agent.report || agent.report->desired_hash != push.hash) return;
  const FleetReport& report = *agent.report;
  if (is_refusal(report)) {
    if (agent.reports == push.reports_before) return;
    push.outcome = Outcome::refused;
    if (report.state == "rolled_back")
      push.why.emplace_back("rolled back; to try it again, send it with another version");
    push.why.insert(push.why.end(), report.errors.begin(), report.errors.end());
  } else if (report.state == "applied" && (report.confirmed || !confirmed)) {
    push.outcome = Outcome::accepted;
  }
}

std::string reason_of_silence(bool has_refused, const FleetAgent& agent) {
  if (agent.presence != Presence::online) return "the agent went offline";
  if (has_refused) return "no answer; it refused the same document before";
  if (!agent.report)
    return "no answer; the agent has never reported a config: is agent.remote_config set?";
  return "no answer";
}

/// Sets the outcome of a push that has not been decided in time.
void give_up(Push& push, const FleetAgent& agent) {
  const bool is_known = agent.report && agent.report->desired_hash == push.hash;
  if (is_known && agent.report->state == "applied") {
    push.outcome = Outcome::on_trial;
    push.why.emplace_back(agent.presence == Presence::online
                              ? "the document is in force; fleet status shows how its trial ends"
                              : "the agent went offline during the trial");
    return;
  }
  push.outcome = Outcome::silent;
  push.why.push_back(reason_of_silence(is_known && is_refusal(*agent.report), agent));
}

}  // namespace

Rollout::Rollout(std::vector<Push> pushes, RolloutRules rules)
    : pushes_(std::move(pushes)), rules_(rules), over_(pushes_.empty()) {}

std::vector<std::size_t> Rollout::advance(const Fleet& fleet, SteadyTime now) {
  if (over_) return {};
  judge_batch(fleet, now >= deadline_);
  const std::span batch(pushes_.data() + begin_, end_ - begin_);
  if (!std::ranges::all_of(batch, &Push::is_decided)) return {};
  deadline_ = SteadyTime::max();
  if (!std::ranges::all_of(batch, &Push::is_good) || end_ == pushes_.size()) {
    over_ = true;
    return {};
  }
  return begin_batch(fleet, now);
}

std::vector<std::size_t> Rollout::begin_batch(const Fleet& fleet, SteadyTime now) {
  begin_ = end_;
  end_ = std::min(begin_ + rules_.batch, pushes_.size());
  deadline_ = now + rules_.patience;
  std::vector<std::size_t> due;
  for (std::size_t i = begin_; i < end_; ++i) {
    Push& push = pushes_[i];
    const FleetAgent& agent = fleet.agent(push.agent);
    if (agent.presence == Presence::online) {
      push.outcome = Outcome::waits;
      push.reports_before = agent.reports;
      due.push_back(i);
      continue;
    }
    push.outcome = rules_.skip_offline ? Outcome::left_out : Outcome::offline;
    if (agent.presence == Presence::unknown)
      push.why.emplace_back("the broker has no state of this agent");
  }
  return due;
}

void Rollout::end(const Fleet& fleet) {
  judge_batch(fleet, /*time_is_up=*/true);
  over_ = true;
}

void Rollout::judge_batch(const Fleet& fleet, bool time_is_up) {
  for (std::size_t i = begin_; i < end_; ++i) {
    Push& push = pushes_[i];
    if (push.is_decided()) continue;
    const FleetAgent& agent = fleet.agent(push.agent);
    judge(push, agent, rules_.confirmed);
    if (!push.is_decided() && time_is_up) give_up(push, agent);
  }
}

void Rollout::not_accepted(std::size_t push, const std::string& why) {
  pushes_.at(push).outcome = Outcome::not_allowed;
  pushes_.at(push).why.push_back(why);
}

bool Rollout::waits() const {
  return std::ranges::find(pushes_, Outcome::waits, &Push::outcome) != pushes_.end();
}

bool Rollout::is_good() const {
  return std::ranges::all_of(pushes_, &Push::is_good) &&
         std::ranges::find(pushes_, Outcome::accepted, &Push::outcome) != pushes_.end();
}

}  // namespace fxagent
