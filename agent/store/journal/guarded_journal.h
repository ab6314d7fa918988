// The stored journal while the disk may hang. Then no command enters the journal; results,
// acknowledgements and audit records wait in memory, bounded, until take_up().
//
// Uplink thread, except starts(); before that thread starts, the thread that made it.
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <mutex>
#include <optional>
#include <span>
#include <stop_token>
#include <string>
#include <thread>
#include <vector>

#include "agent/commands/journal.h"
#include "agent/store/audit_trail.h"
#include "agent/store/disk/disk_guard.h"
#include "agent/store/journal/started_commands.h"
#include "agent/store/journal/stored_journal.h"
#include "agent/store/journal/unrecorded_commands.h"

namespace fxagent {

/// Marks started commands on its own thread, one after the other: a disk that hangs must not hold
/// up the field. Field thread, and its own.
class CommandMarker final : public CommandStarts {
 public:
  using Write = std::function<void(std::uint64_t number)>;

  /// `write` marks a command on disk, on a thread of its own. Throws std::system_error if that
  /// thread cannot be started.
  explicit CommandMarker(Write write);
  /// Waits until the marks in progress are made.
  ~CommandMarker() override = default;
  CommandMarker(const CommandMarker&) = delete;
  CommandMarker& operator=(const CommandMarker&) = delete;

  void set_patience(std::chrono::milliseconds patience) { patience_ = patience; }
  std::chrono::milliseconds patience() const override { return patience_; }
  /// Calls `done` with false at once while a mark takes longer than patience().
  void mark(std::uint64_t number, Done done) override;

 private:
  struct Mark {
    std::uint64_t number = 0;
    Done done;
  };

  void serve(const std::stop_token& stop);

  const Write write_;
  std::chrono::milliseconds patience_ = CommandStarts::patience();
  std::mutex mutex_;  ///< guards the next three
  std::condition_variable_any news_;
  std::deque<Mark> marks_;                         ///< the first is in progress
  std::chrono::steady_clock::time_point began_{};  ///< of the first
  std::jthread thread_;
};

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
  /// Without a device, these read on the caller's thread. Call them without a device only before
  /// the uplink starts. The wait is unlimited, because without all ids the agent would carry out a
  /// repeated command.
  std::vector<KnownId> known_ids(const std::string& device = {}) override;
  std::vector<JournalEntry> unacknowledged(const std::string& device = {}) override;
  bool was_read() const override { return !hangs() && journal_.was_read(); }

  /// Commands and results that the disk has not accepted; while it hangs, only those since then.
  std::size_t unrecorded() const {
    return hangs() ? waiting_.results.size() : journal_.unrecorded();
  }

  /// Call after a hang. Passes what has waited to the store. `before` runs on the disk's thread,
  /// ahead of the journal's own work.
  void take_up(DiskGuard::Work before);

 private:
  /// Entries that wait while the store hangs.
  struct Waiting {
    AuditTrail::Waiting audit;
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
