// The output of `fxagent fleet`. Pure.
#pragma once

#include <cstdint>
#include <string>

#include "agent/cli/fleet/fleet.h"
#include "agent/cli/fleet/rollout.h"

namespace fxagent {

/// True if each agent is online, without a conflict, and has the config that it was sent.
bool is_fleet_good(const Fleet& fleet);

/// Returns a table with a line for each agent, the reasons of each refusal, and a sum.
std::string fleet_text(const Fleet& fleet);
/// Returns the same as one JSON object, with a newline at its end.
std::string fleet_json(const Fleet& fleet);

/// Returns the line of an agent in a rollout, and below it the reasons.
std::string push_text(const Push& push, std::size_t name_width);
/// Returns the last lines of a rollout: who has the document, who refused it, who got none.
std::string rollout_sum(const Rollout& rollout);
/// Returns the rollout as one JSON object, with a newline at its end.
std::string rollout_json(const Rollout& rollout, const std::string& error);
/// Returns what a rollout would do, without doing it: a line for each agent, in batches.
std::string dry_run_text(const std::vector<Push>& pushes, const RolloutRules& rules,
                         const Fleet& fleet);

}  // namespace fxagent
