// Writes batches to PostgreSQL. One thread.
#pragma once

#include <libpq-fe.h>

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

namespace fxagent::history {

/// stored: committed. wrong_data: the database refuses a value of the batch, and would again.
/// unavailable: try again later; it may have been committed.
enum class PutState : std::uint8_t { stored, wrong_data, unavailable };

/// Reason of a failure in one line, and its cure.
struct DatabaseFault {
  std::string why;
  std::string cure;
};

struct Put {
  PutState state = PutState::unavailable;
  std::uint64_t stored = 0;    ///< new samples
  std::uint64_t repeated = 0;  ///< samples that were stored before
  DatabaseFault fault;
};

/// When a commit returns. on: it is on the server's disk. off: a crash of the server may lose it.
enum class SynchronousCommit : std::uint8_t { on, off };

/// Returns the reason why libpq cannot parse a connection string, or an empty text.
std::string fault_of_target(const std::string& target);

/// Returns the cure of a failed statement. `sqlstate` is empty if the server did not answer.
std::string cure_of(std::string_view sqlstate);

class Database final {
 public:
  /// `target` is a conninfo string or URI of libpq. When `stop` is readable, a call waits at most 5
  /// s more for each answer. Calls `idle` at least once a second while it waits. While libpq
  /// connects, it ignores both.
  Database(std::string target, SynchronousCommit commit, int stop, std::function<void()> idle);

  /// Commits a batch (Batch::text()) in one transaction. Connects first if needed.
  Put put(const std::string& batch);
  /// Makes the partitions of the next days and deletes days older than `keep_days` (0: none).
  /// Returns the failure, if any.
  std::optional<DatabaseFault> maintain(int keep_days);

 private:
  struct Close {
    void operator()(PGconn* connection) const { PQfinish(connection); }
    void operator()(PGresult* result) const { PQclear(result); }
  };
  using Connection = std::unique_ptr<PGconn, Close>;
  using Result = std::unique_ptr<PGresult, Close>;

  bool connect(DatabaseFault& fault);
  Result run(const char* statement, const char* argument);
  DatabaseFault fault_of(const PGresult* result) const;

  const std::string target_;
  const SynchronousCommit commit_;
  const int stop_;
  const std::function<void()> idle_;
  Connection connection_;
};

}  // namespace fxagent::history
