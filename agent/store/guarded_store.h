// The store as the uplink uses it. A DiskGuard runs everything that may touch the disk. While the
// store hangs, writes are refused, as by a full disk. Notes wait in samples() and journal(),
// bounded. The first upkeep() after the disk's answer passes them to the store, after the outcome
// of the overdue work.
//
// Uplink thread; before that thread starts, the thread that made it.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>

#include "agent/steady_time.h"
#include "agent/store/disk/disk_guard.h"
#include "agent/store/journal/guarded_journal.h"
#include "agent/store/samples/guarded_samples.h"
#include "agent/store/store.h"

namespace fxagent {

class GuardedStore final {
 public:
  /// `store` outlives it. Calls `wake` on the disk's thread after overdue work; call upkeep() then.
  GuardedStore(Store& store, std::function<void()> wake);
  void set_patience(std::chrono::milliseconds patience) {
    guard_.set_patience(patience);
    journal_.set_patience(patience);
  }

  GuardedSamples& samples() { return samples_; }
  GuardedJournal& journal() { return journal_; }

  /// True from the time when work became overdue until the first upkeep() after it has ended.
  bool hangs() const { return guard_.hangs(); }
  /// "disk"; "memory" if nothing can be written; "hangs" while the disk does not answer.
  std::string_view state() const { return hangs() ? "hangs" : store_.state(); }
  bool is_writable() const { return !hangs() && store_.is_writable(); }
  std::uint64_t max_bytes() const { return store_.max_bytes(); }
  bool has_pending() const { return !hangs() && store_.has_pending(); }

  /// Figures of the store. While it hangs, those from before.
  struct Figures {
    std::uint64_t rows = 0;
    std::uint64_t recovered = 0;
    std::uint64_t bytes = 0;
    std::string set_aside;
    audit::Head audit;
    StoreLimit dropped_by = StoreLimit::none;  ///< StoredSamples::dropped_by()
  };
  Figures figures() const { return hangs() ? seen_ : read_figures(); }

  /// Store::upkeep(). After overdue work, first handles its outcome and the notes that have waited.
  void upkeep(SteadyTime now, std::int64_t utc_ms);
  std::optional<Store::FoundLate> take_found_late();
  void close();

 private:
  Figures read_figures() const;

  Store& store_;
  Figures seen_;  ///< from before the last work of the disk
  GuardedSamples samples_;
  GuardedJournal journal_;
  DiskGuard guard_;  ///< last: its work refers to the others
};

}  // namespace fxagent
