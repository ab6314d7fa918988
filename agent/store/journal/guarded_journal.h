// The stored journal while the disk may hang. Then no command enters the journal; results,
// acknowledgements and audit records wait in memory, bounded, until take_up().
//
// Uplink thread, except starts(); before that thread starts, the thread that made it.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "agent/commands/journal.h"
#include "agent/store/audit_trail.h"
#include "agent/store/disk/disk_guard.h"
#include "agent/store/journal/command_marker.h"
#include "agent/store/journal/started_commands.h"
#include "agent/store/journal/stored_journal.h"
#include "agent/store/journal/unrecorded_commands.h"

namespace fxagent {

class GuardedJournal final : public CommandJournal {
 public:
  /// The referenced objects outlive it, except `guard`: it ends first, with its thread.
  GuardedJournal(StoredJournal& journal, AuditTrail& audit, StartedCommands& started,
                 DiskGuard& guard)
      : journal_(journal),
        audit_(audit),
        guard_(guard),
        marker_([&started](std::uint64_t number) { started.mark(number); }) {}
  /// Sets the longest wait for a mark.
  void set_patience(std::chrono::milliseconds patience) { marker_.set_patience(patience); }

  std::uint64_t next_command_number() override { return journal_.next_command_number(); }
  void note(std::string audit) override;
  bool journal(std::span<const JournalEntry> entries) override;
  bool hangs() const override { return guard_.hangs(); }
  using CommandJournal::record;
  void record(std::vector<JournalEntry> entries) override;
  void acknowledge(std::string device, std::string id, std::uint64_t number,
                   std::string total_ms = {}) override;
  CommandStarts* starts() override { return &marker_; }
  std::optional<JournalEntry> find(const std::string& device, const std::string& id) override;
  std::vector<KnownId> known_ids(const std::string& device = {}) override;
  std::vector<JournalEntry> unacknowledged(const std::string& device = {}) override;

  /// Call after a hang. Passes what has waited to the store. `before` runs on the disk's thread,
  /// ahead of the journal's own work.
  void take_up(DiskGuard::Work before);

 private:
  /// Entries that wait while the store hangs.
  struct Waiting {
    std::deque<std::string> audit;
    std::size_t audit_bytes = 0;
    std::uint64_t audit_lost = 0;  ///< records that found no room
    UnrecordedCommands results;
    std::vector<std::function<void()>> acknowledgements;
  };

  StoredJournal& journal_;
  AuditTrail& audit_;
  DiskGuard& guard_;
  Waiting waiting_;
  CommandMarker marker_;
};

}  // namespace fxagent
