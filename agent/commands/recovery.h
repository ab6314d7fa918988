// What earlier runs left of commands: ids that must be known, results that the broker does not have
// yet, and commands without a result. Pure but for the journal. Uplink thread.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "agent/commands/journal.h"
#include "agent/config/config.h"
#include "agent/messages.h"

namespace fxagent {

/// Commands and results are those of devices of the config.
struct Recovered {
  std::vector<KnownId> ids;  ///< of all devices; Commands takes those of its own
  /// To be published: results that the broker had not acknowledged, and the outcome, written into
  /// the journal here, of each command that the end of the agent left without one, but for those in
  /// `interrupted`.
  std::vector<CommandResult> unacknowledged;
  /// Writes of which something may have left, oldest first: what they were to write may be read,
  /// and they are not sent again.
  std::vector<Command> interrupted;
};

/// Before the field and the uplink are started.
Recovered recover(const Config& config, CommandJournal& journal, std::int64_t utc_ms,
                  SteadyTime now);
/// The same of these devices alone, which this run did not know so far. Uplink thread.
Recovered recover_of(const std::vector<std::string>& devices, const Config& config,
                     CommandJournal& journal, std::int64_t utc_ms, SteadyTime now);
/// The same for what a journal had that opened later.
Recovered recover(const Config& config, CommandJournal& journal, std::vector<KnownId> ids,
                  std::vector<JournalEntry> unacknowledged, std::int64_t utc_ms, SteadyTime now);

}  // namespace fxagent
