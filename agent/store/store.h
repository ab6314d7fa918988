// The store on disk: samples that were not acknowledged, the journal of commands, the audit trail,
// and the sequence number of each device. One SQLite file, fxagent.db, in its own directory, with
// fxagent.lock, fxagent.db.started, .unrecorded and .behind next to it. The parts define the
// contents; the store opens the file and schedules the work.
//
// One thread at a time: the thread that made it, then the uplink's, which runs disk access on the
// disk's thread (guarded_store.h). Two exceptions: started().mark() runs on a thread of its own,
// and next_command_number() may run while the disk's thread works.
//
// A failure of the disk is not a failure of the caller. The caller keeps samples that could not be
// written, the state becomes `memory`, and upkeep() tries again every 10 s.
#pragma once

#include <chrono>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "agent/commands/journal.h"
#include "agent/config/model.h"
#include "agent/steady_time.h"
#include "agent/store/audit_trail.h"
#include "agent/store/disk/store_disk.h"
#include "agent/store/journal/started_commands.h"
#include "agent/store/journal/stored_journal.h"
#include "agent/store/samples/sequence_numbers.h"
#include "agent/store/samples/stored_samples.h"

namespace fxagent {

class Store final {
 public:
  using Hold = StoredSamples::Hold;
  static constexpr std::chrono::seconds kTryAgain{10};

  /// Opens or creates the directory `config.path` and the file in it. Sets a damaged file aside as
  /// fxagent.db.corrupt-<utc_ms>. Does not throw on disk errors: see state(). Throws
  /// std::runtime_error if another process uses the directory: call await_other_agent() before.
  Store(const StoreConfig& config, std::int64_t utc_ms);
  Store(const Store&) = delete;
  Store& operator=(const Store&) = delete;

  StoredSamples& samples() { return samples_; }
  StoredJournal& journal() { return journal_; }
  SequenceNumbers& numbers() { return numbers_; }
  StartedCommands& started() { return started_; }
  AuditTrail& audit() { return audit_; }

  /// Path of the directory.
  const std::string& path() const { return config_.path; }
  bool is_writable() const { return disk_.is_writable(); }
  /// Returns "disk", or "memory" if nothing can be written.
  std::string_view state() const { return is_writable() ? "disk" : "memory"; }
  /// Bytes of samples and commands, without the audit. Above max_bytes(), upkeep() deletes samples.
  std::uint64_t bytes() const { return samples_.streams().bytes() + journal_.bytes(); }
  std::uint64_t max_bytes() const { return config_.max_bytes; }
  /// Name of the damaged file that was set aside in this run; empty if there is none.
  const std::string& set_aside() const { return disk_.set_aside(); }

  /// Retries failed writes, deletes acknowledged samples, drops samples, results and ids beyond
  /// their limits, and prunes the audit trail. A sample's age counts from its write to disk;
  /// setting the clock makes nothing older or younger. Detects within a minute that the files were
  /// deleted or replaced: counts their contents as dropped, and opens or creates the files at the
  /// path. Cheap if nothing is due.
  void upkeep(SteadyTime now, std::int64_t utc_ms);
  /// First part of upkeep(): records the time, in memory. True: the rest has disk work to do.
  bool note_time(SteadyTime now, std::int64_t utc_ms);
  /// True if upkeep() has something to write soon.
  bool has_pending() const;
  /// Clean end: writes what is pending and closes the file. The next boot continues right after the
  /// numbers used. While the disk refuses writes, only brings UnrecordedFile up to date.
  void close();

  /// Left by earlier runs in a database or UnrecordedFile that could not be opened, or whose
  /// commands could not be read, at the start of this one.
  struct FoundLate {
    std::vector<KnownId> ids;
    std::vector<JournalEntry> unacknowledged;
    std::map<std::string, std::uint64_t> numbers;  ///< by device, if above this run's
  };
  /// Returns it once after such a file was read. Until then none of its ids were known.
  std::optional<FoundLate> take_found_late() { return std::exchange(found_late_, std::nullopt); }

 private:
  bool is_flush_due(SteadyTime now) const;
  bool try_the_disk(SteadyTime now);
  void open_late();
  void find_commands();
  void find_unrecorded();
  void look_for_the_files();

  const StoreConfig config_;
  StoreDisk disk_;
  SequenceNumbers numbers_{config_, disk_};
  AuditTrail audit_{config_, disk_};
  StartedCommands started_{config_.path};
  StoredJournal journal_{config_, disk_, audit_, started_};
  StoredSamples samples_{config_, disk_, journal_, numbers_};

  std::optional<SteadyTime> running_since_;
  std::optional<SteadyTime> try_at_;
  SteadyTime flush_at_{};
  SteadyTime clean_up_at_{};
  std::optional<FoundLate> found_late_;
};

/// Waits for another process that uses the directory `config.path`. Returns false if there is none,
/// true if it has ended: what was read from the directory before may be out of date. Throws
/// std::runtime_error if it goes on for `patience`. An agent that is being stopped ends within 9 s
/// (StopWatchdog::kPatience).
bool await_other_agent(const StoreConfig& config,
                       std::chrono::milliseconds patience = std::chrono::seconds(10));

/// Returns the number before the first sample of each device, by index in Config::devices. If
/// `store` is null, numbers start at the clock, above every number of an earlier boot unless it was
/// set back. Call once, at the start.
std::vector<std::uint64_t> first_numbers(const Config& config, Store* store, std::int64_t utc_ms);

}  // namespace fxagent
