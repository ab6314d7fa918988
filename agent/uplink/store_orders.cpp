// What the store keeps of commands: the journal of orders, the memory of ids, and the audit trail.
#include <algorithm>
#include <utility>

#include "agent/log.h"
#include "agent/uplink/store.h"

namespace fxagent {
namespace {

using sqlite::from_sql;
using sqlite::Statement;
using sqlite::to_sql;
using sqlite::Transaction;
using std::chrono::milliseconds;

constexpr std::size_t kMostUnrecorded = 10000;
constexpr std::size_t kMostUnaudited = 3 * kMostUnrecorded;  // an order, its result, its PUBACK
// The field asks for the first results of all ids that it still knows.
constexpr std::chrono::hours kLongerThanKnown{1};
constexpr std::chrono::hours kAgeAuditEvery{1};
constexpr std::int64_t kLatestMs = 7258118400000;  // the year 2200: later is damage

/// What an order and its result have in common, the first seven columns.
Statement& bind_entry(Statement& statement, const JournalEntry& entry) {
  return statement.bind(1, entry.device)
      .bind(2, entry.id)
      .bind(3, entry.received_ms)
      .bind(4, entry.deadline_ms)
      .bind(5, entry.op)
      .bind(6, entry.response_topic)
      .bind(7, ByteView(entry.correlation));
}

std::int64_t moment(std::int64_t utc_ms) { return std::clamp<std::int64_t>(utc_ms, 0, kLatestMs); }

constexpr std::string_view kEntry =
    "SELECT device, id, received_ms, deadline_ms, op, response_topic, correlation, result, told,"
    " arrival, payload";

/// The row that a statement which begins with kEntry stands on.
JournalEntry entry_of(Statement& row) {
  JournalEntry entry;
  entry.device = row.text(0);
  entry.id = row.text(1);
  entry.received_ms = moment(row.number(2));
  entry.deadline_ms = moment(row.number(3));
  entry.op = row.text(4);
  entry.response_topic = row.text(5);
  const ByteView correlation = row.bytes(6);
  entry.correlation.assign(correlation.begin(), correlation.end());
  entry.result = row.text(7);
  entry.told = row.number(8) != 0;
  entry.arrival = from_sql(row.number(9));
  entry.payload = row.text(10);
  return entry;
}

}  // namespace

bool Store::journal(std::span<const JournalEntry> orders) {
  if (writable_ && write_orders(orders)) return true;
  for (const JournalEntry& order : orders) keep_unrecorded(order);
  return writable_ && settle();  // a damaged file has made room for a fresh one
}

/// Until the disk takes it. As in the file, a result belongs to the order with its number, and a
/// later command that uses the id anew takes its place.
void Store::keep_unrecorded(JournalEntry entry) {
  note(std::exchange(entry.audit, {}));
  auto& by_id = unrecorded_.get<1>();
  if (const auto kept = by_id.find(boost::make_tuple(entry.device, entry.id));
      kept != by_id.end()) {
    if (entry.arrival < kept->arrival + (kept->result.empty() ? 0 : 1)) return;
    if (entry.arrival == kept->arrival)
      entry.deadline_ms = std::max(entry.deadline_ms, kept->deadline_ms);
    by_id.erase(kept);
  }
  unrecorded_.push_back(std::move(entry));
  if (unrecorded_.size() <= kMostUnrecorded) return;
  auto oldest = std::find_if(unrecorded_.begin(), unrecorded_.end(),
                             [](const JournalEntry& kept) { return !kept.result.empty(); });
  if (oldest == unrecorded_.end()) oldest = unrecorded_.begin();
  if (!std::exchange(forgot_results_, true))
    log::error("results_not_kept", {{"device", oldest->device}, {"first_id", oldest->id}});
  unrecorded_.erase(oldest);
}

bool Store::write_order(const JournalEntry& entry) {
  return bind_entry(file_->order, entry)
             .bind(8, to_sql(entry.arrival))
             .bind(9, entry.payload)
             .run() &&
         write_audit(entry.audit);
}

bool Store::write_entry(const JournalEntry& entry) {
  return entry.result.empty() ? write_order(entry) : write_record(entry);
}

bool Store::write_orders(std::span<const JournalEntry> orders) {
  {
    Transaction transaction(file_->db);
    file_->trail.begin();
    const bool written = transaction.begun() &&
                         std::all_of(orders.begin(), orders.end(),
                                     [this](const JournalEntry& e) { return write_order(e); });
    if (written && commit(transaction)) return true;
  }
  failed("journal");
  return false;
}

void Store::record(JournalEntry entry) {
  // An order that has found no disk so far goes there with its result.
  const bool order_waits =
      unrecorded_.get<1>().count(boost::make_tuple(entry.device, entry.id)) != 0;
  if (writable_ && !order_waits) {
    {
      Transaction transaction(file_->db);
      file_->trail.begin();
      if (transaction.begun() && write_record(entry) && commit(transaction)) return;
    }
    failed("journal");
  }
  keep_unrecorded(std::move(entry));
  if (writable_) settle();
}

bool Store::write_record(const JournalEntry& entry) {
  return bind_entry(file_->record, entry)
             .bind(8, entry.result)
             .bind(9, to_sql(entry.arrival))
             .run() &&
         write_audit(entry.audit);
}

void Store::told(std::string device, std::string id, std::uint64_t arrival) {
  if (untold_.size() < kMostUnrecorded)
    untold_.push_back({std::move(device), std::move(id), arrival});
}

std::optional<JournalEntry> Store::find(const std::string& device, const std::string& id) {
  const auto& by_id = unrecorded_.get<1>();
  const auto kept = by_id.find(boost::make_tuple(device, id));
  if (kept != by_id.end()) return *kept;
  if (!file_) return std::nullopt;
  Statement one(file_->db, std::string(kEntry) + " FROM orders WHERE device = ? AND id = ?");
  const auto step = one.bind(1, device).bind(2, id).step();
  if (step == Statement::Step::row) return entry_of(one);
  if (step == Statement::Step::failed) unreadable();
  return std::nullopt;
}

std::vector<Store::KnownId> Store::known_ids() {
  std::vector<KnownId> ids;
  if (!file_) return ids;
  Statement all(file_->db,
                "SELECT device, id, arrival, received_ms, deadline_ms FROM"
                " (SELECT *, row_number() OVER (PARTITION BY device ORDER BY arrival DESC,"
                " received_ms DESC) AS place FROM orders)"
                " WHERE (result IS NOT '' OR told IS 1) AND (place <= ?1 OR received_ms <= ?2 AND"
                " deadline_ms >= ?2) ORDER BY arrival, received_ms");
  all.bind(1, std::int64_t{kRememberedIds}).bind(2, utc_ms_);
  auto step = all.step();
  for (; step == Statement::Step::row; step = all.step())
    ids.push_back({std::string(all.text(0)), std::string(all.text(1)), from_sql(all.number(2)),
                   moment(all.number(3)), moment(all.number(4))});
  if (step == Statement::Step::failed) failed("read");
  return ids;
}

std::vector<JournalEntry> Store::unsettled() {
  std::vector<JournalEntry> entries;
  if (!file_) return entries;
  Statement all(file_->db,
                std::string(kEntry) +
                    " FROM (SELECT *, row_number() OVER (PARTITION BY device ORDER BY arrival DESC,"
                    " received_ms DESC) AS place FROM orders WHERE told IS NOT 1)"
                    " WHERE result = '' OR place <= ?1 ORDER BY arrival, received_ms");
  all.bind(1, std::int64_t{kRememberedIds});
  auto step = all.step();
  for (; step == Statement::Step::row; step = all.step()) entries.push_back(entry_of(all));
  if (step == Statement::Step::failed) failed("read");
  return entries;
}

void Store::drop_old_ids() {
  if (!writable_) return;
  const std::int64_t day = milliseconds(kRememberedFor + kLongerThanKnown).count();
  const std::int64_t age = std::max(day, milliseconds(config_.max_age).count());
  // What nobody could be told is kept as long as a sample is.
  Statement old(file_->db,
                "DELETE FROM orders WHERE deadline_ms < ?1"
                " AND (told = 1 AND received_ms < ?2 OR received_ms < ?3)");
  Statement many(
      file_->db,
      "DELETE FROM orders WHERE told = 1 AND deadline_ms < ?1 AND (device, id) IN"
      " (SELECT device, id FROM (SELECT device, id, row_number() OVER"
      " (PARTITION BY device ORDER BY arrival DESC, received_ms DESC) AS place FROM orders)"
      " WHERE place > ?2)");
  // A broker that refuses results for good must not fill the disk.
  Statement untold(file_->db,
                   "DELETE FROM orders WHERE deadline_ms < ?1 AND (device, id) IN"
                   " (SELECT device, id FROM (SELECT device, id, row_number() OVER"
                   " (PARTITION BY device ORDER BY arrival DESC, received_ms DESC) AS place"
                   " FROM orders WHERE told = 0 AND result <> '') WHERE place > ?2)");
  const bool done = old.bind(1, utc_ms_).bind(2, utc_ms_ - day).bind(3, utc_ms_ - age).run() &&
                    many.bind(1, utc_ms_).bind(2, std::int64_t{kRememberedIds}).run() &&
                    untold.bind(1, utc_ms_).bind(2, std::int64_t{kRememberedIds}).run();
  if (!done) failed("delete");
}

// ---- the audit ----------------------------------------------------------------------------------

void Store::note(std::string body) {
  if (body.empty()) return;
  if (unaudited_.size() < kMostUnaudited)
    unaudited_.push_back(std::move(body));
  else
    ++audit_lost_;
}

bool Store::write_audit(std::string_view body) { return body.empty() || file_->trail.append(body); }

bool Store::write_unaudited() {
  for (const std::string& body : unaudited_)
    if (!write_audit(body)) return false;
  return audit_lost_ == 0 || write_audit(audit::lost(audit_lost_, utc_ms_));
}

bool Store::commit(Transaction& transaction) {
  if (!file_->trail.end(arrivals_) || !transaction.commit()) return false;
  file_->trail.committed();
  return true;
}

void Store::prune_audit() {
  if (!writable_) return;
  const bool by_age = !prune_at_ || clean_up_at_ >= prune_at_;
  if (by_age) prune_at_ = *clean_up_at_ + kAgeAuditEvery;
  // A record of this run is not older than the run, whatever the clock was at the time.
  const bool long_run = running_since_ && *clock_at_ - *running_since_ > config_.audit_max_age;
  const std::uint64_t last = file_->trail.head().records;
  const std::uint64_t may_age = !by_age ? 0 : long_run ? last : first_audit_of_run_ - 1;
  const std::int64_t oldest_ms = utc_ms_ - milliseconds(config_.audit_max_age).count();
  {
    Transaction transaction(file_->db);
    file_->trail.begin();
    if (transaction.begun() &&
        file_->trail.prune(config_.audit_max_bytes, oldest_ms, may_age, utc_ms_) &&
        commit(transaction))
      return;
  }
  failed("audit");
}

}  // namespace fxagent
