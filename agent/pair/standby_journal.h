// The journal of the active gateway, as the standby keeps it in its own store: the commands that
// the active one announces, and their results.
#pragma once

#include <cstdint>
#include <deque>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "agent/commands/journal.h"
#include "agent/config/model.h"
#include "agent/handover/line_permit.h"
#include "agent/steady_time.h"
#include "agent/store/store.h"

namespace fxagent {

/// Made before the pair's thread starts; then the pair's thread.
///
/// An earlier process of this gateway may have taken a command just before it ended. Such a command
/// has no result, and the other gateway may not know it. This gateway announces it again until it
/// has received the result. The active gateway publishes one if it does not know the command.
class StandbyJournal final {
 public:
  /// Opens this gateway's store, and keeps what save_heard() has saved. Throws what Store() throws.
  explicit StandbyJournal(const StoreConfig& config);
  /// Saves what the other gateway has sent while this one still took itself for the active one: the
  /// process ends, and the broker does not send it again. `where`: the topic of an announcement, or
  /// the device of a result. Writes to a file in the store's directory; returns false if that
  /// fails.
  static bool save_heard(const StoreConfig& config, const std::string& where,
                         const std::string& text);

  /// Keeps a command that the other gateway, which is active, announced on `topic`.
  void keep_announced(JournalEntry entry, const std::string& topic);
  /// Keeps a command that one of the gateways left. Returns its entry if it was known before.
  std::optional<JournalEntry> keep_unanswered(JournalEntry entry, const std::string& topic);
  /// Keeps a result that the active gateway published, as in docs/interface.md.
  void keep_result(const std::string& device, const std::string& text);
  /// Keeps the reply to an unanswered command.
  void keep_answered(const JournalEntry& entry);
  /// Returns the next command of earlier processes of this gateway whose result it has not heard,
  /// oldest first; none that the other gateway may have forgotten. Begins anew after 5 s, then
  /// after pauses that double up to 60 s. nullopt: none is due now.
  std::optional<JournalEntry> next_unanswered(BootTime now);
  /// next_unanswered() begins anew at once, and with its shortest pause.
  void connection_began();
  /// Acknowledges the commands of an earlier process of this gateway. Call if the results that the
  /// other gateway published may not have come here.
  void acknowledge_own_commands();
  void upkeep(SteadyTime now);
  /// Closes the store. Returns the entries that the disk refused to record.
  std::vector<JournalEntry> close();

 private:
  void keep_heard(const StoreConfig& config);
  /// Keeps a command under a new number.
  void keep(JournalEntry entry, const std::string& topic);
  void acknowledge(const JournalEntry& known);

  Store store_;
  /// Journal numbers of commands of an earlier process that had no acknowledged result at the
  /// start.
  std::set<std::uint64_t> own_;
  std::deque<JournalEntry> unanswered_;    ///< the rest of those that next_unanswered() returns
  std::optional<BootTime> unanswered_at_;  ///< when it begins anew; nullopt: at once
  BootTime unanswered_pause_{};
  SteadyTime upkeep_at_{};
};

/// Writes entries of another store to this one. A command that only the other one has gets a new
/// number, and counts as sent.
void take_over(std::vector<JournalEntry>& entries, Store& store);

}  // namespace fxagent
