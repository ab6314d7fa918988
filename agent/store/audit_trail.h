// The audit trail: appends, prunes and reads the records of audit_chain.h, and holds those that are
// not written yet. Its records join the commits of the other parts. Only pruning, and records that
// wait for 200 ms without another commit, need one of their own. The store's thread.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

#include "agent/steady_time.h"
#include "agent/store/audit_chain.h"
#include "agent/store/disk/store_disk.h"

namespace fxagent {

class AuditTrail final : public StorePart {
 public:
  // Limits of records in memory: 10,000 commands, their results and their PUBACKs.
  static constexpr std::size_t kMostWaiting = 30000;
  static constexpr std::size_t kMostWaitingBytes = std::size_t{8} << 20;

  /// Bodies of records in memory, within these limits.
  struct Waiting {
    std::deque<std::string> bodies;
    std::size_t bytes = 0;
    std::uint64_t lost = 0;  ///< records that found no room

    /// Adds a body unless it is empty. Above the limits it is only counted as lost.
    void note(std::string body);
  };

  AuditTrail(const StoreConfig& config, StoreDisk& disk) : config_(config), disk_(disk) {}

  /// Returns the number for a command that has just arrived. May run on the uplink's thread while
  /// the disk's thread commits.
  std::uint64_t next_command_number() { return ++last_command_number_; }
  std::uint64_t last_command_number() const { return last_command_number_; }
  /// Without a file, numbers start here: above those of a later file, unless the clock went back.
  void count_from(std::uint64_t command_number) { last_command_number_ = command_number; }
  /// Numbers continue above this one.
  void count_above(std::uint64_t command_number);

  /// Adds a record's body. It is written within 200 ms, or once the disk accepts it.
  void note(std::string body) { waiting_.note(std::move(body)); }
  /// Counts records that found no room elsewhere, for the next `lost` record.
  void lose(std::uint64_t records) { waiting_.lost += records; }
  /// The head as stored in the file.
  audit::Head head() const { return kept_.head; }
  std::uint64_t bytes() const { return kept_.bytes; }

  /// Within a commit: appends the next record. Does nothing if `body` is empty. Throws
  /// SQLite::Exception.
  void append(std::string_view body);
  /// Within a commit: deletes the oldest records. By size: more than a tenth above `max_bytes`,
  /// down to `max_bytes`. By age: records from before `oldest_ms` (UTC) with a number up to
  /// `may_age`. The last record always stays. Appends a `pruned` record if any were deleted. Throws
  /// SQLite::Exception.
  void prune(std::uint64_t max_bytes, std::int64_t oldest_ms, std::uint64_t may_age);
  /// True if prune_to_limits() would delete records for their size.
  bool is_too_large() const {
    return kept_.bytes > config_.audit_max_bytes + config_.audit_max_bytes / 10;
  }
  /// Prunes to the limits of the config in a commit: by size at each call, by age once an hour.
  /// `running_since`: the first upkeep of this run.
  void prune_to_limits(SteadyTime now, SteadyTime running_since);

  void load(SQLite::Database& database) override;
  void unload(Rows rows) override;
  void set_aside(const std::string& name) override { note(audit::begun(name, disk_.utc_ms())); }
  bool has_pending() const override { return !waiting_.bodies.empty() || waiting_.lost != 0; }
  void begin_commit() override;
  bool write_pending(std::size_t at_most) override;
  void end_commit() override;
  void committed() override;

  /// Reason why an audit could not be read.
  struct Unread {
    std::string why;
    bool is_damaged = false;  ///< SQLite reports the file damaged, or not a database
  };
  /// Passes every record of the file at `path` to `take`, in the order of their numbers, and fills
  /// `head` from the stored head. An agent may be writing to the file. Returns nullopt on success.
  /// Any thread.
  static std::optional<Unread> read(const std::string& path,
                                    const std::function<void(audit::Record)>& take,
                                    audit::Head& head);

 private:
  struct Statements {
    explicit Statements(SQLite::Database& database);
    SQLite::Statement insert;
    SQLite::Statement update;
  };
  struct State {
    audit::Head head;
    std::uint64_t bytes = 0;
    std::uint64_t arrivals = 0;
  };

  const StoreConfig config_;
  StoreDisk& disk_;
  std::optional<Statements> sql_;
  State kept_;  ///< in the file
  State next_;  ///< as the open commit will leave it
  std::atomic<std::uint64_t> last_command_number_ = 0;
  std::uint64_t first_of_run_ = 1;  ///< the first record of this run
  Waiting waiting_;                 ///< not in the file yet
  std::size_t written_ = 0;         ///< of its bodies, in the open commit
  bool is_loss_written_ = false;    ///< in the open commit
  SteadyTime prune_at_{};           ///< next time by age
};

}  // namespace fxagent
