#include "agent/store/audit_trail.h"

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <system_error>
#include <utility>

namespace fxagent {
namespace {

using sqlite::from_sql;

constexpr std::chrono::hours kAgeEvery{1};
constexpr int kPatienceMs = 2000;

// Bytes of a record besides its text: number, hash, and SQLite's overhead.
constexpr std::uint64_t kOverhead = 64;

/// Returns the head in the row of a statement that begins with its records and hash.
audit::Head head_of(const SQLite::Statement& row) {
  audit::Head head{.records = from_sql(sqlite::number(row, 0))};
  const ByteView hash = sqlite::bytes(row, 1);
  std::copy_n(hash.begin(), std::min(hash.size(), head.hash.size()), head.hash.begin());
  return head;
}

/// Opens the file also on a read-only disk, unless its newest records are only in a WAL that cannot
/// be read there.
SQLite::Database open_audit(const std::string& path) {
  try {
    SQLite::Database database(path, SQLite::OPEN_READONLY | SQLite::OPEN_NOMUTEX, kPatienceMs);
    database.execAndGet("PRAGMA schema_version");  // the first read opens the WAL
    return database;
  } catch (const SQLite::Exception&) {
    std::error_code none;
    const auto bytes = std::filesystem::file_size(path + "-wal", none);
    if (!none && bytes > 0) throw;
  }
  return sqlite::open_read_only(path);
}

}  // namespace

AuditTrail::Statements::Statements(SQLite::Database& database)
    : insert(database, "INSERT INTO audit VALUES(?, ?, ?)"),
      update(database, "INSERT OR REPLACE INTO audit_head VALUES(1, ?, ?, ?, ?)") {}

void AuditTrail::load(SQLite::Database& database) {
  sql_.emplace(database);
  kept_ = {};
  SQLite::Statement head(database, "SELECT records, hash, arrivals, bytes FROM audit_head");
  sqlite::each(head, [this](const SQLite::Statement& row) {
    kept_.head = head_of(row);
    kept_.arrivals = from_sql(sqlite::number(row, 2));
    kept_.bytes = from_sql(sqlite::number(row, 3));
  });
  // If the stored head was set back, the chain continues after the last record, and verification
  // finds the break.
  const auto last = from_sql(database.execAndGet("SELECT max(n) FROM audit").getInt64());
  kept_.head.records = std::max(kept_.head.records, last);
  count_above(kept_.arrivals);
  first_of_run_ = kept_.head.records + 1;
}

void AuditTrail::count_above(std::uint64_t command_number) {
  std::uint64_t given = last_command_number_;
  while (given < command_number &&
         !last_command_number_.compare_exchange_weak(given, command_number)) {
  }
}

void AuditTrail::unload(Rows) {
  sql_.reset();
  kept_ = {};
}

void AuditTrail::Waiting::note(std::string body) {
  if (body.empty()) return;
  if (bodies.size() >= kMostWaiting || bytes >= kMostWaitingBytes) {
    ++lost;
    return;
  }
  bytes += body.size();
  bodies.push_back(std::move(body));
}

void AuditTrail::begin_commit() {
  next_ = kept_;
  written_ = 0;
  is_loss_written_ = false;
}

void AuditTrail::append(std::string_view body) {
  if (body.empty()) return;
  const audit::Record record = audit::seal(next_.head, body);
  next_.bytes += record.text.size() + kOverhead;
  sqlite::run(sql_->insert, record.number, record.text, ByteView(record.hash));
}

bool AuditTrail::write_pending(std::size_t at_most) {
  const auto& bodies = waiting_.bodies;
  for (; written_ < std::min(at_most, bodies.size()); ++written_) append(bodies[written_]);
  if (written_ < bodies.size()) return true;
  if (waiting_.lost != 0) append(audit::lost(waiting_.lost, disk_.utc_ms()));
  is_loss_written_ = true;
  return false;
}

void AuditTrail::end_commit() {
  if (next_.head.records == kept_.head.records) return;
  next_.arrivals = std::max(next_.arrivals, last_command_number_.load());
  sqlite::run(sql_->update, next_.head.records, ByteView(next_.head.hash), next_.arrivals,
              next_.bytes);
}

void AuditTrail::committed() {
  kept_ = next_;
  for (; written_ > 0; --written_) {
    waiting_.bytes -= waiting_.bodies.front().size();
    waiting_.bodies.pop_front();
  }
  if (is_loss_written_) waiting_.lost = 0;
}

void AuditTrail::prune(std::uint64_t max_bytes, std::int64_t oldest_ms, std::uint64_t may_age) {
  const bool full = next_.bytes > max_bytes + max_bytes / 10;
  std::uint64_t freed = 0;
  std::uint64_t up_to = 0;
  Bytes hash;
  SQLite::Statement oldest(disk_.database(), "SELECT n, text, hash FROM audit ORDER BY n");
  sqlite::each(oldest, [&](const SQLite::Statement& row) {
    const std::uint64_t number = from_sql(sqlite::number(row, 0));
    // The last record stays: the chain needs an end.
    if (number >= next_.head.records) return false;
    const std::string_view text = sqlite::text(row, 1);
    const bool too_much = full && next_.bytes > max_bytes + freed;
    if (!too_much && (number > may_age || audit::time_of(text) >= oldest_ms)) return false;
    up_to = number;
    freed += text.size() + kOverhead;
    const ByteView kept = sqlite::bytes(row, 2);
    hash.assign(kept.begin(), kept.end());
    return true;
  });
  if (up_to == 0) return;
  SQLite::Statement remove(disk_.database(), "DELETE FROM audit WHERE n <= ?");
  sqlite::run(remove, up_to);
  next_.bytes -= std::min(next_.bytes, freed);
  append(audit::pruned(up_to, hash, disk_.utc_ms()));
}

void AuditTrail::prune_to_limits(SteadyTime now, SteadyTime running_since) {
  if (!disk_.is_writable()) return;
  const bool by_age = now >= prune_at_;
  if (by_age) prune_at_ = now + kAgeEvery;
  // A record of this run is not older than the run, whatever its timestamp.
  const bool long_run = now - running_since > config_.audit_max_age;
  const std::uint64_t may_age = !by_age ? 0 : long_run ? kept_.head.records : first_of_run_ - 1;
  const std::int64_t oldest_ms =
      disk_.utc_ms() - std::chrono::milliseconds(config_.audit_max_age).count();
  disk_.commit("audit", [&] { prune(config_.audit_max_bytes, oldest_ms, may_age); });
}

std::optional<AuditTrail::Unread> AuditTrail::read(const std::string& path,
                                                   const std::function<void(audit::Record)>& take,
                                                   audit::Head& head) {
  head = {};
  const auto fault = sqlite::attempt([&] {
    SQLite::Database database = open_audit(path);
    // One transaction: head and records match even if the agent writes at the same time.
    const SQLite::Transaction transaction(database);
    SQLite::Statement kept(database, "SELECT records, hash FROM audit_head");
    sqlite::each(kept, [&](const SQLite::Statement& row) { head = head_of(row); });
    SQLite::Statement all(database, "SELECT n, text, hash FROM audit ORDER BY n");
    sqlite::each(all, [&](const SQLite::Statement& row) {
      const ByteView hash = sqlite::bytes(row, 2);
      take({from_sql(sqlite::number(row, 0)), std::string(sqlite::text(row, 1)),
            Bytes(hash.begin(), hash.end())});
    });
  });
  if (!fault) return std::nullopt;
  return Unread{fault->text, fault->code == SQLITE_CORRUPT || fault->code == SQLITE_NOTADB};
}

}  // namespace fxagent
