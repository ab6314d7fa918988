// Detects that the calendar was set, and shifts the times that this run has written by the same
// amount. A gateway without a real-time clock starts in the past and gets its time over the same
// network as the broker, after the outage. The store's thread.
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>

#include "agent/steady_time.h"
#include "agent/store/disk/store_disk.h"
#include "agent/store/journal/stored_journal.h"
#include "agent/store/samples/stored_samples.h"

namespace fxagent {

class StoreClock final : public StorePart {
 public:
  /// The calendar counts as set when it moves this far against the steady clock. Neither clock
  /// drifts that much.
  static constexpr std::chrono::seconds kClockSet{60};

  /// The referenced objects outlive it.
  StoreClock(StoreDisk& disk, StoredSamples& samples, StoredJournal& journal)
      : disk_(disk), samples_(samples), journal_(journal) {}

  /// Records the current time of both clocks. If the calendar was set, shifts the times in memory
  /// at once.
  void note(SteadyTime now, std::int64_t utc_ms);
  /// True if times in the file still have to be shifted.
  bool was_set() const { return unmoved_ms_ != 0; }
  /// Shifts the times in the file in a commit, if that is still to be done.
  void move_stored_times();

  void load(SQLite::Database& /*database*/) override {}
  /// Lost rows need no shift.
  void unload(Rows rows) override {
    if (rows == Rows::lost) unmoved_ms_ = 0;
  }

 private:
  StoreDisk& disk_;
  StoredSamples& samples_;
  StoredJournal& journal_;
  std::optional<SteadyTime> at_;  ///< steady time of the last note()
  std::int64_t unmoved_ms_ = 0;   ///< shift that the file does not have yet
};

}  // namespace fxagent
