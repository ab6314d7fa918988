// The store on disk: samples that were not acknowledged, the journal of commands, the audit trail,
// and the numbers that each device has reached. One SQLite file, fxagent.db, in a directory of its
// own. The parts know what they keep; the store opens the file, and says when what is done. Uplink
// thread; before that thread is started, the thread that made it.
//
// No failure of the disk is a failure of the caller: what could not be written is the caller's to
// keep, the state becomes `memory`, and upkeep() tries again now and then.
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
#include "agent/config/config.h"
#include "agent/messages.h"
#include "agent/store/audit_trail.h"
#include "agent/store/sequence_numbers.h"
#include "agent/store/started_commands.h"
#include "agent/store/store_clock.h"
#include "agent/store/store_disk.h"
#include "agent/store/stored_journal.h"
#include "agent/store/stored_samples.h"

namespace fxagent {

class Store final {
 public:
  using Hold = StoredSamples::Hold;
  static constexpr std::chrono::seconds kTryAgain{10};

  /// Opens or makes the file in `config.path`, and the directory. A damaged file is set aside as
  /// fxagent.db.corrupt-<utc_ms>. Never throws on what the disk does: see state().
  Store(const StoreConfig& config, std::int64_t utc_ms);
  ~Store();
  Store(const Store&) = delete;
  Store& operator=(const Store&) = delete;

  StoredSamples& samples() { return samples_; }
  const StoredSamples& samples() const { return samples_; }
  StoredJournal& journal() { return journal_; }
  SequenceNumbers& numbers() { return numbers_; }
  AuditTrail& audit() { return audit_; }
  const AuditTrail& audit() const { return audit_; }

  /// The directory.
  const std::string& path() const { return config_.path; }
  bool is_writable() const { return disk_.is_writable(); }
  /// "disk", or "memory" where nothing can be written.
  std::string_view state() const { return is_writable() ? "disk" : "memory"; }
  /// Of samples, and of what is kept of commands: together they stay below max_bytes().
  std::uint64_t bytes() const { return samples_.bytes() + journal_.bytes(); }
  std::uint64_t max_bytes() const { return config_.max_bytes; }
  /// The name of the damaged file that was set aside in this run; empty: none was.
  const std::string& set_aside() const { return disk_.set_aside(); }

  /// Tries again to write where that failed, deletes what was acknowledged, lets go what is older
  /// than max_age and ids that need not be remembered any more. Ages are those of the time on disk,
  /// and a clock that is set meanwhile makes nothing older or younger. Files that were deleted or
  /// replaced since are noticed within a minute: what was in them counts as dropped, and those that
  /// are there now are opened, or made. Cheap where nothing is due.
  void upkeep(SteadyTime now, std::int64_t utc_ms);
  /// The first part of upkeep(): notes the time, in memory. True: the rest has work for the disk.
  bool note_time(SteadyTime now, std::int64_t utc_ms);
  /// Whether upkeep() has something to write soon.
  bool has_pending() const;
  /// The clean end: the next boot goes on right behind the numbers used, and the file is closed up.
  void close();

  /// What earlier runs left in a file that could not be opened at the start of this one.
  struct FoundLate {
    std::vector<KnownId> ids;                      ///< as known_ids()
    std::vector<JournalEntry> unacknowledged;      ///< as unacknowledged()
    std::map<std::string, std::uint64_t> numbers;  ///< by device; only those above this run's
  };
  /// Once after such a file has opened: until then none of its ids was known.
  std::optional<FoundLate> take_found_late() { return std::exchange(found_late_, std::nullopt); }

 private:
  bool is_flush_due(SteadyTime now) const;
  bool try_the_disk(SteadyTime now);
  void open_late();
  void look_for_the_files();

  const StoreConfig config_;
  StoreDisk disk_;
  SequenceNumbers numbers_{config_, disk_};
  AuditTrail audit_{config_, disk_};
  StartedCommands started_{config_.path};
  StoredJournal journal_{config_, disk_, audit_, started_};
  StoredSamples samples_{config_, disk_, journal_, numbers_};
  StoreClock clock_{disk_, samples_, journal_};

  std::optional<SteadyTime> running_since_;
  std::optional<SteadyTime> try_at_;
  std::optional<SteadyTime> flush_at_;
  std::optional<SteadyTime> clean_up_at_;
  std::optional<FoundLate> found_late_;
};

}  // namespace fxagent
