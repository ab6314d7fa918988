// The audit trail in the store's file: appends, prunes and reads the records of audit_chain.h. It
// has no transactions of its own: its records go into those of the store, so that none costs a
// commit. The store's thread.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <string_view>

#include "agent/store/audit_chain.h"
#include "agent/store/sqlite.h"

namespace fxagent {

class AuditTrail final {
 public:
  AuditTrail() = default;
  /// `database` outlives the trail.
  explicit AuditTrail(sqlite::Database& database);

  /// Reads where the chain ends. False: the file could not be read.
  bool load();

  /// Within a transaction of the caller: begin() first, then append() and prune(), then end().
  /// After its commit committed(); without one the next begin() starts again from what is in the
  /// file.
  void begin() { next_ = kept_; }
  bool append(std::string_view body);
  /// Lets the oldest records go: of what is above `max_bytes` and a tenth more, and those of before
  /// `oldest_ms` with a number up to `may_age`. Says so in a record where any went.
  bool prune(std::uint64_t max_bytes, std::int64_t oldest_ms, std::uint64_t may_age,
             std::int64_t now_ms);
  /// `arrivals`: the number of the last command that has come.
  bool end(std::uint64_t arrivals);
  void committed() { kept_ = next_; }

  const audit::Head& head() const { return kept_.head; }
  std::uint64_t bytes() const { return kept_.bytes; }
  /// Whether prune() would let records go for their bytes.
  bool is_over(std::uint64_t max_bytes) const { return kept_.bytes > max_bytes + max_bytes / 10; }
  std::uint64_t arrivals() const { return kept_.arrivals; }

  /// Every record in the order of their numbers, and the head kept apart from them. False: the file
  /// has no audit, or could not be read; the database's fault() says which.
  static bool read(sqlite::Database& database, const std::function<void(audit::Record)>& take,
                   audit::Head& head);

 private:
  struct State {
    audit::Head head;
    std::uint64_t bytes = 0;
    std::uint64_t arrivals = 0;
  };

  sqlite::Database* database_ = nullptr;
  sqlite::Statement insert_;
  sqlite::Statement update_;
  State kept_;  ///< in the file
  State next_;
};

}  // namespace fxagent
