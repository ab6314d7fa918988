// What earlier runs left of commands: the ids that the field must know, and the results that the
// broker does not have yet.
#pragma once

#include <cstdint>
#include <vector>

#include "agent/commands/journal.h"
#include "agent/config/config.h"
#include "agent/messages.h"

namespace fxagent {

struct Recovered {
  RestoredState field;  ///< without the numbers of samples
  /// To be published: results that the broker had not acknowledged, and the outcome, written into
  /// the journal here, of each command that the end of the agent left without one, but for those in
  /// field.interrupted.
  std::vector<CommandResult> unacknowledged;
};

/// Before the field and the uplink are started.
Recovered recover(const Config& config, CommandJournal& journal, std::int64_t utc_ms,
                  SteadyTime now);
/// The same for what a journal had that opened later.
Recovered recover(const Config& config, CommandJournal& journal, std::vector<KnownId> ids,
                  std::vector<JournalEntry> unacknowledged, std::int64_t utc_ms, SteadyTime now);

}  // namespace fxagent
