// What the store keeps of commands: the journal, the memory of ids, and the audit trail.
#include <algorithm>
#include <utility>

#include "agent/log/log.h"
#include "agent/store/store.h"

namespace fxagent {
namespace {

using sqlite::from_sql;
using sqlite::Statement;
using sqlite::to_sql;
using sqlite::Transaction;
using std::chrono::milliseconds;

constexpr std::size_t kMostUnrecorded = 10000;
constexpr std::size_t kMostUnaudited = 3 * kMostUnrecorded;  // a command, its result, its PUBACK
constexpr std::size_t kMostUnrecordedBytes = std::size_t{8} << 20;
constexpr std::size_t kMostUnauditedBytes = std::size_t{8} << 20;
constexpr std::uint64_t kMostRefused = 10000;  // rows of commands that were not admitted
constexpr std::uint64_t kRefusedAtOnce = 200;
// Of max_bytes, for commands; samples have the rest at least.
constexpr std::uint64_t kShareOfJournal = 2;
constexpr std::int64_t kShrunkAtOnce = 200;
// The field asks for the first results of all ids that it still knows.
constexpr std::chrono::hours kLongerThanKnown{1};
constexpr std::chrono::hours kAgeAuditEvery{1};
constexpr std::int64_t kLatestMs = 7258118400000;  // the year 2200: later is damage

/// What a command and its result have in common, the first seven columns.
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
    " arrival, payload, refused";

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
  entry.acknowledged = row.number(8) != 0;
  entry.number = from_sql(row.number(9));
  entry.payload = row.text(10);
  entry.refused = row.number(11) != 0;
  return entry;
}

}  // namespace

void Store::begin_changes() {
  file_->trail.begin();
  journal_size_changed_ = journal_size_;
}

/// Once at the start, and after what deletes many.
bool Store::measure_journal() {
  Statement& sum = file_->measure_journal;
  if (sum.step() != Statement::Step::row) return false;
  journal_size_.rows = from_sql(sum.number(0));
  journal_size_.bytes = from_sql(sum.number(1));
  journal_size_.refused = from_sql(sum.number(2));
  sum.reset();
  return true;
}

bool Store::change_command(const std::string& device, const std::string& id,
                           const std::function<bool()>& change) {
  Statement& cost = file_->command_cost;
  const auto look = [&] {
    JournalSize found;
    if (cost.bind(1, device).bind(2, id).step() == Statement::Step::row) {
      found.rows = 1;
      found.bytes = from_sql(cost.number(0));
      found.refused = cost.number(1) != 0 ? 1 : 0;
      cost.reset();
    }
    return found;
  };
  const JournalSize before = look();
  if (!change()) return false;
  const JournalSize after = look();
  journal_size_changed_.rows += after.rows - before.rows;
  journal_size_changed_.bytes += after.bytes - before.bytes;
  journal_size_changed_.refused += after.refused - before.refused;
  return true;
}

/// The oldest of them go: a flood of commands that are refused must not fill the file.
bool Store::make_room_for_refused() {
  if (journal_size_changed_.refused < kMostRefused) return true;
  Statement& drop = file_->drop_refused;
  drop.bind(1, to_sql(kRefusedAtOnce));
  auto step = drop.step();
  for (; step == Statement::Step::row; step = drop.step()) {
    --journal_size_changed_.rows;
    --journal_size_changed_.refused;
    journal_size_changed_.bytes -= from_sql(drop.number(0));
  }
  return step == Statement::Step::done;
}

/// Where commands take more than their share: what was refused goes first, then the results that
/// were told, the oldest first; their ids stay. The samples beside them make room in append().
void Store::shrink_journal() {
  const std::uint64_t most = std::max(config_.max_bytes / kShareOfJournal, not_to_be_shrunk_);
  if (!writable_ || journal_size_.bytes <= most) return;
  not_to_be_shrunk_ = 0;
  bool done = false;
  {
    Transaction transaction(file_->db);
    begin_changes();
    Statement oldest(file_->db,
                     "SELECT device, id FROM orders WHERE refused = 1 OR told = 1 AND result <> ''"
                     " ORDER BY refused DESC, arrival LIMIT ?");
    Statement remove(file_->db, "DELETE FROM orders WHERE device = ? AND id = ? AND refused = 1");
    Statement clear(file_->db, "UPDATE orders SET result = '' WHERE device = ? AND id = ?");
    std::vector<std::pair<std::string, std::string>> found;
    auto step = oldest.bind(1, kShrunkAtOnce).step();
    for (; step == Statement::Step::row; step = oldest.step())
      found.emplace_back(oldest.text(0), oldest.text(1));
    if (found.empty()) not_to_be_shrunk_ = journal_size_.bytes;
    done = transaction.begun() && step == Statement::Step::done &&
           std::all_of(found.begin(), found.end(),
                       [&](const auto& row) {
                         return change_command(row.first, row.second, [&] {
                           return remove.bind(1, row.first).bind(2, row.second).run() &&
                                  clear.bind(1, row.first).bind(2, row.second).run();
                         });
                       }) &&
           commit(transaction);
  }
  if (!done) failed("shrink");
}

bool Store::journal(std::span<const JournalEntry> entries) {
  if (writable_ && write_commands(entries)) return true;
  for (const JournalEntry& entry : entries) keep_unrecorded(entry);
  return writable_ && flush();  // a damaged file has made room for a fresh one
}

/// Until the disk takes it. As in the file, a result belongs to the command with its number, and a
/// later command that uses the id anew takes its place.
void Store::keep_unrecorded(JournalEntry entry) {
  note(std::exchange(entry.audit, {}));
  auto& by_id = unrecorded_.get<1>();
  if (const auto kept = by_id.find(boost::make_tuple(entry.device, entry.id));
      kept != by_id.end()) {
    if (entry.number < kept->number + (kept->result.empty() ? 0 : 1)) return;
    if (entry.number == kept->number)
      entry.deadline_ms = std::max(entry.deadline_ms, kept->deadline_ms);
    unrecorded_bytes_ -= bytes_of(*kept);
    by_id.erase(kept);
  }
  unrecorded_bytes_ += bytes_of(entry);
  unrecorded_.push_back(std::move(entry));
  while (unrecorded_.size() > kMostUnrecorded || unrecorded_bytes_ > kMostUnrecordedBytes) {
    auto oldest = std::find_if(unrecorded_.begin(), unrecorded_.end(),
                               [](const JournalEntry& kept) { return !kept.result.empty(); });
    if (oldest == unrecorded_.end()) oldest = unrecorded_.begin();
    if (!std::exchange(forgot_results_, true))
      log::error("results_not_kept", {{"device", oldest->device}, {"first_id", oldest->id}});
    unrecorded_bytes_ -= bytes_of(*oldest);
    unrecorded_.erase(oldest);
  }
}

bool Store::write_command(const JournalEntry& entry) {
  return change_command(entry.device, entry.id,
                        [&] {
                          return bind_entry(file_->insert_command, entry)
                              .bind(8, to_sql(entry.number))
                              .bind(9, entry.payload)
                              .run();
                        }) &&
         write_audit(entry.audit);
}

bool Store::write_entry(const JournalEntry& entry) {
  return entry.result.empty() ? write_command(entry) : write_record(entry);
}

bool Store::write_commands(std::span<const JournalEntry> entries) {
  {
    Transaction transaction(file_->db);
    begin_changes();
    const bool written = transaction.begun() &&
                         std::all_of(entries.begin(), entries.end(),
                                     [this](const JournalEntry& e) { return write_command(e); });
    if (written && commit(transaction)) return true;
  }
  failed("journal");
  return false;
}

void Store::record(JournalEntry entry) {
  std::vector<JournalEntry> entries;
  entries.push_back(std::move(entry));
  record(std::move(entries));
}

void Store::record(std::vector<JournalEntry> entries) {
  if (entries.empty()) return;
  // A command that has found no disk so far goes there with its result.
  const auto command_is_pending = [this](const JournalEntry& entry) {
    return unrecorded_.get<1>().count(boost::make_tuple(entry.device, entry.id)) != 0;
  };
  if (writable_ && std::none_of(entries.begin(), entries.end(), command_is_pending)) {
    {
      Transaction transaction(file_->db);
      begin_changes();
      if (transaction.begun() &&
          std::all_of(entries.begin(), entries.end(),
                      [this](const JournalEntry& entry) { return write_record(entry); }) &&
          commit(transaction))
        return;
    }
    failed("journal");
  }
  for (JournalEntry& entry : entries) keep_unrecorded(std::move(entry));
  if (writable_) flush();
}

bool Store::write_record(const JournalEntry& entry) {
  if (entry.refused && !make_room_for_refused()) return false;
  return change_command(entry.device, entry.id,
                        [&] {
                          return bind_entry(file_->record, entry)
                              .bind(8, entry.result)
                              .bind(9, to_sql(entry.number))
                              .bind(10, std::int64_t{entry.refused})
                              .run();
                        }) &&
         write_audit(entry.audit);
}

void Store::acknowledge(std::string device, std::string id, std::uint64_t number) {
  if (to_acknowledge_.size() < kMostUnrecorded)
    to_acknowledge_.push_back({std::move(device), std::move(id), number});
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

std::vector<KnownId> Store::known_ids() {
  std::vector<KnownId> ids;
  if (!file_) return ids;
  Statement all(file_->db,
                "SELECT device, id, arrival, received_ms, deadline_ms, refused FROM orders"
                " WHERE result IS NOT '' OR told IS 1 ORDER BY arrival, received_ms");
  auto step = all.step();
  for (; step == Statement::Step::row; step = all.step())
    ids.push_back({std::string(all.text(0)), std::string(all.text(1)), from_sql(all.number(2)),
                   moment(all.number(3)), moment(all.number(4)), all.number(5) != 0});
  if (step == Statement::Step::failed) failed("read");
  return ids;
}

std::vector<JournalEntry> Store::unacknowledged() {
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
  // Of the newest of each device the first results are kept too, of as many more the ids.
  Statement results(
      file_->db,
      "UPDATE orders SET result = '' WHERE told = 1 AND result <> '' AND (device, id) IN"
      " (SELECT device, id FROM (SELECT device, id, row_number() OVER"
      " (PARTITION BY device ORDER BY arrival DESC, received_ms DESC) AS place FROM orders)"
      " WHERE place > ?1)");
  Statement many(
      file_->db,
      "DELETE FROM orders WHERE told = 1 AND result = '' AND deadline_ms < ?1 AND (device, id) IN"
      " (SELECT device, id FROM orders WHERE told = 1 AND result = ''"
      " ORDER BY arrival DESC, received_ms DESC LIMIT -1 OFFSET ?2)");
  // A broker that refuses results for good must not fill the disk.
  Statement unacknowledged(file_->db,
                           "DELETE FROM orders WHERE deadline_ms < ?1 AND (device, id) IN"
                           " (SELECT device, id FROM (SELECT device, id, row_number() OVER"
                           " (PARTITION BY device ORDER BY arrival DESC, received_ms DESC) AS place"
                           " FROM orders WHERE told = 0 AND result <> '') WHERE place > ?2)");
  std::int64_t changed = 0;
  const auto run = [&](Statement& statement) {
    const bool done = statement.run();
    changed += file_->db.changes();
    return done;
  };
  // With few of them none can be one too many, and all of them need not be looked at.
  const bool few = journal_size_.rows <= kRememberedIds;
  const bool done =
      run(old.bind(1, utc_ms_).bind(2, utc_ms_ - day).bind(3, utc_ms_ - age)) &&
      (few || (run(results.bind(1, std::int64_t{kRememberedIds})) &&
               run(many.bind(1, utc_ms_).bind(2, std::int64_t{kFingerprints})) &&
               run(unacknowledged.bind(1, utc_ms_).bind(2, std::int64_t{kRememberedIds})))) &&
      (changed == 0 || measure_journal());
  if (!done) failed("delete");
}

// ---- the audit ----------------------------------------------------------------------------------

void Store::note(std::string body) {
  if (body.empty()) return;
  if (unaudited_.size() >= kMostUnaudited || unaudited_bytes_ >= kMostUnauditedBytes) {
    ++audit_lost_;
    return;
  }
  unaudited_bytes_ += body.size();
  unaudited_.push_back(std::move(body));
}

bool Store::write_audit(std::string_view body) { return body.empty() || file_->trail.append(body); }

bool Store::write_unaudited() {
  for (const std::string& body : unaudited_)
    if (!write_audit(body)) return false;
  return audit_lost_ == 0 || write_audit(audit::lost(audit_lost_, utc_ms_));
}

bool Store::commit(Transaction& transaction) {
  if (!file_->trail.end(last_command_number_) || !transaction.commit()) return false;
  file_->trail.committed();
  journal_size_ = journal_size_changed_;
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
    begin_changes();
    if (transaction.begun() &&
        file_->trail.prune(config_.audit_max_bytes, oldest_ms, may_age, utc_ms_) &&
        commit(transaction))
      return;
  }
  failed("audit");
}

}  // namespace fxagent
