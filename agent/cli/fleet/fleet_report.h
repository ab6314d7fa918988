// The output of `fxagent fleet`. Pure.
#pragma once

#include <cstddef>
#include <set>
#include <string>
#include <vector>

#include "agent/cli/fleet/fleet.h"
#include "agent/cli/fleet/rollout.h"

namespace fxagent {

/// True if each agent is online, without a conflict, and has the config that it was sent.
bool is_fleet_good(const Fleet& fleet);

/// Returns a table with a line for each agent, the reasons of each refusal, and a sum.
std::string fleet_text(const Fleet& fleet);
/// Returns the same as one JSON object, with a newline at its end.
std::string fleet_json(const Fleet& fleet);

/// The lines of a rollout in progress.
class RolloutLines final {
 public:
  /// `rollout` must outlive the object.
  explicit RolloutLines(const Rollout& rollout);
  /// Returns the lines that are new since the last call: each batch as it begins, and each agent
  /// once it is decided, with the reasons below it. Call after each advance() of the rollout.
  std::string take();

 private:
  std::string decided_until(std::size_t end);

  const Rollout& rollout_;
  std::size_t name_width_ = 0;
  std::size_t batch_ = 0;
  std::set<std::size_t> reported_;  ///< indexes in Rollout::pushes()
};
/// Returns the last lines of a rollout: who has the document, who refused it, who got none.
std::string rollout_sum(const Rollout& rollout);
/// Returns the rollout as one JSON object, with a newline at its end.
std::string rollout_json(const Rollout& rollout, const std::string& error);
/// Returns what a rollout would do, without doing it: a line for each agent, in batches.
std::string dry_run_text(const std::vector<Push>& pushes, const RolloutRules& rules,
                         const Fleet& fleet);
/// True if each agent is online and its report is known. With `rules.skip_offline`: each agent
/// that is online, and at least one is.
bool is_dry_run_good(const std::vector<Push>& pushes, const RolloutRules& rules,
                     const Fleet& fleet);

}  // namespace fxagent
