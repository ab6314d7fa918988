// The audit trail: appends, prunes and reads the records of audit_chain.h, and keeps what could not
// be written yet. It commits nothing of its own but what it prunes: its records go into the commits
// of the other parts, so that none costs a commit. The store's thread.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <optional>
#include <string>
#include <string_view>

#include "agent/messages.h"
#include "agent/store/audit_chain.h"
#include "agent/store/store_disk.h"

namespace fxagent {

class AuditTrail final : public StorePart {
 public:
  // Records in memory: 10,000 commands, their results and their PUBACKs.
  static constexpr std::size_t kMostWaiting = 30000;
  static constexpr std::size_t kMostWaitingBytes = std::size_t{8} << 20;

  AuditTrail(const StoreConfig& config, StoreDisk& disk) : config_(config), disk_(disk) {}

  /// The number of a command that has just come. Also while a commit is under way.
  std::uint64_t next_command_number() { return ++last_command_number_; }
  std::uint64_t last_command_number() const { return last_command_number_; }
  /// Without a file: above those of one that opens later, unless the clock went back.
  void count_from(std::uint64_t command_number) { last_command_number_ = command_number; }

  /// A record's body, written within 200 ms, or once the disk takes it.
  void note(std::string body);
  /// Counts records that found no room elsewhere: the record `lost` says how many.
  void lose(std::uint64_t records) { lost_ += records; }
  /// As it is in the file.
  audit::Head head() const { return kept_.head; }
  std::uint64_t bytes() const { return kept_.bytes; }

  /// Within a commit: the next record. Empty: none. Throws SQLite::Exception.
  void append(std::string_view body);
  /// Within a commit: lets the oldest records go: of what is above `max_bytes` and a tenth more,
  /// and those of before `oldest_ms` with a number up to `may_age`. Says so in a record where any
  /// went. Throws SQLite::Exception.
  void prune(std::uint64_t max_bytes, std::int64_t oldest_ms, std::uint64_t may_age);
  /// Whether prune() would let records go for their bytes.
  bool is_over(std::uint64_t max_bytes) const { return kept_.bytes > max_bytes + max_bytes / 10; }
  /// Commits a pruning to the limits of the config: for the bytes at each call, for the age once an
  /// hour. `running_since`: the first upkeep of this run.
  void prune_to_limits(SteadyTime now, SteadyTime running_since);

  void load(SQLite::Database& database) override;
  void unload(Rows rows) override;
  void set_aside(const std::string& name) override { note(audit::begun(name, disk_.utc_ms())); }
  bool has_pending() const override { return !waiting_.empty() || lost_ != 0; }
  void begin_commit() override;
  bool write_pending(std::size_t at_most) override;
  void end_commit() override;
  void committed() override;

  /// Why an audit could not be read.
  struct Unread {
    std::string why;
    bool is_damaged = false;  ///< SQLite finds the file damaged, or no database
  };
  /// Every record of the file at `path` in the order of their numbers, and the head kept apart from
  /// them, while an agent may be writing there. Nothing: they were read. Any thread.
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
  State next_;  ///< as the commit that is open will leave it
  std::atomic<std::uint64_t> last_command_number_ = 0;
  std::uint64_t first_of_run_ = 1;   ///< the first record of this run
  std::deque<std::string> waiting_;  ///< bodies that are not in the file
  std::size_t waiting_bytes_ = 0;
  std::uint64_t lost_ = 0;        ///< bodies that found no room there, not reported yet
  std::size_t written_ = 0;       ///< of those that wait, in the commit that is open
  bool is_loss_written_ = false;  ///< in the commit that is open
  std::optional<SteadyTime> prune_at_;
};

}  // namespace fxagent
