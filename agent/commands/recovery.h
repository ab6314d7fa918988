// Recovers what earlier runs left of commands: ids that must be known, results that the broker does
// not have yet, and commands without a result. Pure except for the journal. Uplink thread.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "agent/commands/journal.h"
#include "agent/config/model.h"
#include "agent/handover/command_message.h"

namespace fxagent {

struct InterruptedWrite {
  Command command;
  std::string place;  ///< JournalEntry::place
};

/// Commands and results belong to devices of the config.
struct Recovered {
  std::vector<KnownId> ids;  ///< of all devices; Commands selects its own
  /// To be published: results that the broker had not acknowledged, and the outcome of each command
  /// that was left without a result, except those in `interrupted`. recover() writes these outcomes
  /// to the journal.
  std::vector<CommandResult> unacknowledged;
  /// Writes that may have been sent in part, oldest first. Their targets may be read back; they are
  /// not sent again.
  std::vector<InterruptedWrite> interrupted;
};

/// Call before the field and the uplink start. Each entry in `newer`, from the standby of a pair,
/// replaces that of the same device and id in the journal.
Recovered recover(const Config& config, CommandJournal& journal, std::int64_t utc_ms,
                  SteadyTime now, const std::vector<JournalEntry>& newer = {});
/// Same for these devices only, which are new to this run. Returns nullopt if the journal cannot be
/// read now. Uplink thread.
std::optional<Recovered> recover_of(const std::vector<std::string>& devices, const Config& config,
                                    CommandJournal& journal, std::int64_t utc_ms, SteadyTime now);
/// Same for a command that the other gateway of a pair left, as it announced it on `topic`, if the
/// journal does not know it. Writes it to the journal.
Recovered recover_unanswered(const Config& config, CommandJournal& journal, JournalEntry left,
                             const std::string& topic, std::int64_t utc_ms, SteadyTime now);
/// Same for the contents of a journal that opened later.
Recovered recover(const Config& config, CommandJournal& journal, std::vector<KnownId> ids,
                  std::vector<JournalEntry> unacknowledged, std::int64_t utc_ms, SteadyTime now);

}  // namespace fxagent
