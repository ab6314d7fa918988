// Writes batches to PostgreSQL. One thread.
#pragma once

#include <libpq-fe.h>

#include <cstdint>
#include <memory>
#include <string>

namespace fxagent::history {

/// stored: committed. wrong_data: the database refuses a value of the batch, and would again.
/// unavailable: try again later; it may have been committed.
enum class PutState : std::uint8_t { stored, wrong_data, unavailable };

struct Put {
  PutState state = PutState::unavailable;
  std::uint64_t stored = 0;    ///< new samples
  std::uint64_t repeated = 0;  ///< samples that were stored before
  std::string why;             ///< of a failure, one line
};

/// Says when a commit returns. on: it is on the disk of the server. off: a crash of the server may
/// lose it.
enum class SynchronousCommit : std::uint8_t { on, off };

class Database final {
 public:
  /// `target` is a conninfo string or URI of libpq. A call ends early when `stop` is readable.
  Database(std::string target, SynchronousCommit commit, int stop);

  /// Commits a batch (Batch::text()) in one transaction. Connects first if needed.
  Put put(const std::string& batch);
  /// Makes the partitions of the next days and deletes days older than `keep_days` (0: none).
  /// Returns an empty text, or the reason of the failure.
  std::string maintain(int keep_days);

 private:
  struct Close {
    void operator()(PGconn* connection) const { PQfinish(connection); }
    void operator()(PGresult* result) const { PQclear(result); }
  };
  using Connection = std::unique_ptr<PGconn, Close>;
  using Result = std::unique_ptr<PGresult, Close>;

  bool connect(std::string& why);
  Result run(const char* statement, const char* argument);

  const std::string target_;
  const SynchronousCommit commit_;
  const int stop_;
  Connection connection_;
};

}  // namespace fxagent::history
