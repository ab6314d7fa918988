#include "agent/store/audit_trail.h"

#include <algorithm>

namespace fxagent {
namespace {

using sqlite::from_sql;
using sqlite::Statement;
using sqlite::to_sql;

// What a record costs beside its text: number, hash, and the file's own.
constexpr std::uint64_t kOverhead = 64;

void take_digest(ByteView kept, Digest& digest) {
  digest.fill(0);
  std::copy_n(kept.begin(), std::min(kept.size(), digest.size()), digest.begin());
}

}  // namespace

AuditTrail::AuditTrail(sqlite::Database& database)
    : database_(&database),
      insert_(database, "INSERT INTO audit VALUES(?, ?, ?)"),
      update_(database, "INSERT OR REPLACE INTO audit_head VALUES(1, ?, ?, ?, ?)") {}

bool AuditTrail::load() {
  kept_ = {};
  Statement head(*database_, "SELECT records, hash, arrivals, bytes FROM audit_head");
  if (head.step() == Statement::Step::row) {
    kept_.head.records = from_sql(head.number(0));
    take_digest(head.bytes(1), kept_.head.hash);
    kept_.arrivals = from_sql(head.number(2));
    kept_.bytes = from_sql(head.number(3));
  }
  head.reset();
  // Where somebody has put the head back, the chain goes on behind it and verify finds the break.
  const auto last = from_sql(database_->number("SELECT max(n) FROM audit"));
  kept_.head.records = std::max(kept_.head.records, last);
  return database_->fault().code == SQLITE_OK;
}

bool AuditTrail::append(std::string_view body) {
  const audit::Record record = audit::seal(next_.head, body);
  next_.bytes += record.text.size() + kOverhead;
  return insert_.bind(1, to_sql(record.number))
      .bind(2, record.text)
      .bind(3, ByteView(record.hash))
      .run();
}

bool AuditTrail::prune(std::uint64_t max_bytes, std::int64_t oldest_ms, std::uint64_t may_age,
                       std::int64_t now_ms) {
  const bool full = next_.bytes > max_bytes + max_bytes / 10;
  std::uint64_t freed = 0;
  std::uint64_t up_to = 0;
  Bytes hash;
  Statement oldest(*database_, "SELECT n, text, hash FROM audit ORDER BY n");
  auto step = oldest.step();
  for (; step == Statement::Step::row; step = oldest.step()) {
    const std::uint64_t number = from_sql(oldest.number(0));
    if (number >= next_.head.records) break;  // the last one stays, so that the chain has an end
    const bool too_much = full && next_.bytes > max_bytes + freed;
    if (!too_much && (number > may_age || audit::time_of(oldest.text(1)) >= oldest_ms)) break;
    up_to = number;
    hash.assign(oldest.bytes(2).begin(), oldest.bytes(2).end());
    freed += oldest.text(1).size() + kOverhead;
  }
  oldest.reset();
  if (step == Statement::Step::failed) return false;
  if (up_to == 0) return true;
  Statement remove(*database_, "DELETE FROM audit WHERE n <= ?");
  if (!remove.bind(1, to_sql(up_to)).run()) return false;
  next_.bytes -= std::min(next_.bytes, freed);
  return append(audit::pruned(up_to, hash, now_ms));
}

bool AuditTrail::end(std::uint64_t arrivals) {
  if (next_.head.records == kept_.head.records) return true;
  next_.arrivals = std::max(next_.arrivals, arrivals);
  return update_.bind(1, to_sql(next_.head.records))
      .bind(2, ByteView(next_.head.hash))
      .bind(3, to_sql(next_.arrivals))
      .bind(4, to_sql(next_.bytes))
      .run();
}

bool AuditTrail::read(sqlite::Database& database, const std::function<void(audit::Record)>& take,
                      audit::Head& head) {
  // One transaction: the head belongs to these records, whatever the agent writes meanwhile.
  if (!database.execute("BEGIN")) return false;
  database.clear_fault();
  head = {};
  Statement kept(database, "SELECT records, hash FROM audit_head");
  if (kept.step() == Statement::Step::row) {
    head.records = from_sql(kept.number(0));
    take_digest(kept.bytes(1), head.hash);
  }
  kept.reset();
  Statement all(database, "SELECT n, text, hash FROM audit ORDER BY n");
  while (all.step() == Statement::Step::row) {
    audit::Record record;
    record.number = from_sql(all.number(0));
    record.text = all.text(1);
    const ByteView hash = all.bytes(2);
    record.hash.assign(hash.begin(), hash.end());
    take(std::move(record));
  }
  const bool whole = database.fault().code == SQLITE_OK;
  database.execute("COMMIT");
  return whole;
}

}  // namespace fxagent
