// The calendar of the store. When it is set, the times of what this run wrote move with it: a
// gateway without a clock of its own starts in the past, and its time comes over the same network
// as the broker, after the outage. The store's thread.
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>

#include "agent/messages.h"
#include "agent/store/store_disk.h"
#include "agent/store/stored_journal.h"
#include "agent/store/stored_samples.h"

namespace fxagent {

class StoreClock final : public StorePart {
 public:
  /// Of the calendar against the steady clock: so much more than either drifts is a set clock.
  static constexpr std::chrono::seconds kClockSet{60};

  /// The others outlive it.
  StoreClock(StoreDisk& disk, StoredSamples& samples, StoredJournal& journal)
      : disk_(disk), samples_(samples), journal_(journal) {}

  /// The time now, by both clocks. Times in memory move at once where the calendar was set.
  void note(SteadyTime now, std::int64_t utc_ms);
  /// True if times in the file have to move.
  bool was_set() const { return unmoved_ms_ != 0; }
  /// Commits the same for the times in the file, where that is still to be done.
  void move_stored_times();

  void load(SQLite::Database& /*database*/) override {}
  /// Times that were lost need not move.
  void unload(Rows rows) override {
    if (rows == Rows::lost) unmoved_ms_ = 0;
  }

 private:
  StoreDisk& disk_;
  StoredSamples& samples_;
  StoredJournal& journal_;
  std::optional<SteadyTime> at_;  ///< when the disk was told the time last
  std::int64_t unmoved_ms_ = 0;   ///< what the calendar was set by, not yet written to the file
};

}  // namespace fxagent
