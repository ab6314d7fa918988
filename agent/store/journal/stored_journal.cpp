#include "agent/store/journal/stored_journal.h"

#include <algorithm>
#include <chrono>
#include <map>
#include <set>
#include <string_view>
#include <tuple>
#include <utility>

namespace fxagent {
namespace {

// Commands may take 1 / kShareOfJournal of max_bytes; samples have at least the rest.
constexpr std::uint64_t kShareOfJournal = 2;

/// Returns the entry with what an acknowledgement changes, as CommandTable::acknowledge().
JournalEntry acknowledged(JournalEntry entry, const std::string& total_ms) {
  entry.acknowledged = true;
  entry.result = with_total(std::move(entry.result), total_ms);
  return entry;
}

using CommandKey = std::tuple<std::string, std::string, std::uint64_t>;  // device, id, number

CommandKey key_of(const JournalEntry& entry) { return {entry.device, entry.id, entry.number}; }

/// Returns the `total_ms` of a result; empty if it has none.
std::string total_ms_in(const std::string& result) {
  const auto at = result.rfind(kTotalKey);
  if (at == std::string::npos) return {};
  const auto begin = at + kTotalKey.size();
  return result.substr(begin, result.find_first_of(",}", begin) - begin);
}

/// Copies SQLite's log into the file, which synchronises both with the disk. Returns false if a
/// reader or the disk keeps it from copying all.
bool survives_power_cut(SQLite::Database& database) {
  int pages = 0;
  int copied = -1;
  return sqlite3_wal_checkpoint_v2(database.getHandle(), nullptr, SQLITE_CHECKPOINT_PASSIVE, &pages,
                                   &copied) == SQLITE_OK &&
         copied == pages;
}

}  // namespace

void StoredJournal::write(const JournalEntry& entry) {
  entry.result.empty() ? table_->insert(entry) : table_->record(entry);
  audit_.append(entry.audit);
}

/// What the parts have pending goes first: a result that the broker had acknowledged before a
/// command came is not published again after a crash.
bool StoredJournal::journal(std::span<const JournalEntry> entries) {
  const bool is_written = disk_.commit("journal", [&] {
    disk_.write_pending();
    for (const JournalEntry& entry : entries) write(entry);
  });
  if (is_written) return true;
  for (JournalEntry entry : entries) {
    audit_.note(std::exchange(entry.audit, {}));
    // An admitted command that expired stays admitted, as in the table.
    if (entry.refused)
      if (const auto known = find(entry.device, entry.id); known && known->number == entry.number)
        entry.refused = known->refused;
    waiting_.put(std::move(entry));
  }
  // A fresh file may have replaced a damaged one.
  if (disk_.is_writable() && disk_.flush()) return true;
  for (const JournalEntry& entry : entries)
    if (const JournalEntry* waits = waiting_.find(entry.device, entry.id)) keep(*waits);
  unrecorded_file_.synchronise();
  return false;
}

/// Refused commands may be forgotten, and a flood of them must not replace others.
void StoredJournal::keep(const JournalEntry& entry) {
  if (!entry.refused) unrecorded_file_.keep(entry);
}

void StoredJournal::record(std::vector<JournalEntry> entries) {
  if (!entries.empty()) journal(entries);
}

void StoredJournal::acknowledge(std::string device, std::string id, std::uint64_t number,
                                std::string total_ms) {
  if (to_acknowledge_.size() < UnrecordedCommands::kMost)
    to_acknowledge_.push_back({std::move(device), std::move(id), number, std::move(total_ms)});
}

std::optional<JournalEntry> StoredJournal::find(const std::string& device, const std::string& id) {
  if (const JournalEntry* kept = waiting_.find(device, id)) return *kept;
  if (earlier_) return earlier_->find(device, id);
  std::optional<JournalEntry> found;
  if (table_) disk_.read([&] { found = table_->find(device, id); });
  return found;
}

void StoredJournal::read(const std::string& device, const StoreDisk::Work& work) {
  // A damaged file is closed, or a fresh one has replaced it.
  was_read_ = !table_ || is_unread_ || disk_.attempt("read", work) || !disk_.is_open() ||
              disk_.is_writable();
  if (device.empty() && !was_read_) is_unread_ = true;
}

std::vector<KnownId> StoredJournal::known_ids(const std::string& device) {
  std::vector<KnownId> ids;
  if (earlier_)
    ids = earlier_->known_ids(device);
  else
    read(device, [&] { ids = table_->known_ids(device); });
  for (const JournalEntry& entry : unwritten(device))
    if (entry.acknowledged || !entry.result.empty()) ids.push_back(entry);
  return ids;
}

std::vector<JournalEntry> StoredJournal::unacknowledged(const std::string& device) {
  std::vector<JournalEntry> entries = unacknowledged_in_file(device);
  for (JournalEntry& entry : unwritten(device))
    if (!entry.acknowledged) entries.push_back(std::move(entry));
  return entries;
}

std::vector<JournalEntry> StoredJournal::unacknowledged_in_file(const std::string& device) {
  std::vector<JournalEntry> entries;
  read(device, [&] { entries = table_->unacknowledged(device); });
  std::set<CommandKey> newer;
  for (const JournalEntry& entry : unwritten(device)) newer.insert(key_of(entry));
  // unwritten() has none whose id a later command has.
  for (const Acknowledgement& each : to_acknowledge_)
    newer.insert({each.device, each.id, each.number});
  std::erase_if(entries, [&](const JournalEntry& entry) { return newer.contains(key_of(entry)); });
  for (JournalEntry& entry : entries)
    entry.surely_not_sent = entry.result.empty() && started_.surely_not_sent(entry.number);
  return entries;
}

std::vector<JournalEntry> StoredJournal::unwritten(const std::string& device) {
  std::vector<JournalEntry> entries;
  std::map<CommandKey, std::string> total_ms;
  for (const Acknowledgement& each : to_acknowledge_)
    if (device.empty() || each.device == device)
      total_ms[{each.device, each.id, each.number}] = each.total_ms;
  for (const JournalEntry& entry : waiting_) {
    if (!device.empty() && entry.device != device) continue;
    JournalEntry& added = entries.emplace_back(entry);
    if (const auto known = total_ms.extract(key_of(entry)))
      added = acknowledged(std::move(added), known.mapped());
    if (added.result.empty() && started_.surely_not_sent(added.number))
      added.surely_not_sent = true;
  }
  for (const auto& [key, time] : total_ms)
    if (auto entry = find(std::get<0>(key), std::get<1>(key)); entry && key_of(*entry) == key)
      entries.push_back(acknowledged(*std::move(entry), time));
  return entries;
}

std::vector<JournalEntry> StoredJournal::open_unrecorded_file() {
  std::vector<JournalEntry> left;
  if (!config_.keeps_commands) return left;
  for (JournalEntry& entry : unrecorded_file_.open()) {
    audit_.count_above(entry.number);
    const auto known = find(entry.device, entry.id);
    const bool is_result_new =
        known && known->number == entry.number && known->result.empty() && !entry.result.empty();
    if (!known || known->number < entry.number || is_result_new) {
      // Their records waited in memory.
      audit_.lose((is_result_new ? 0U : 1U) + (entry.result.empty() ? 0U : 1U));
      waiting_.put(entry);
    } else if (known->number > entry.number || known->acknowledged || !entry.acknowledged) {
      continue;
    }
    if (entry.acknowledged)
      acknowledge(entry.device, entry.id, entry.number, total_ms_in(entry.result));
    left.push_back(std::move(entry));
  }
  return left;
}

void StoredJournal::keep_unrecorded() {
  if (std::exchange(have_times_moved_, false))
    for (const JournalEntry& entry : unwritten()) keep(entry);
  for (; kept_ < to_acknowledge_.size(); ++kept_) {
    const Acknowledgement& each = to_acknowledge_[kept_];
    auto entry = find(each.device, each.id);
    if (entry && entry->number == each.number) keep(acknowledged(*entry, each.total_ms));
  }
  unrecorded_file_.synchronise();
}

void StoredJournal::move_waiting_times(std::int64_t by_ms) {
  // As in the table: a command of an earlier start of the machine came by a right clock.
  waiting_.move_times(by_ms, first_of_run_, disk_.machine_start_ms());
  have_times_moved_ = true;
}

void StoredJournal::shrink() {
  const std::uint64_t most = std::max(config_.max_bytes / kShareOfJournal, not_to_be_shrunk_);
  if (!disk_.is_writable() || bytes() <= most) return;
  not_to_be_shrunk_ = 0;
  disk_.commit("shrink", [&] {
    if (!table_->shrink()) not_to_be_shrunk_ = bytes();
  });
}

void StoredJournal::drop_old() {
  if (!disk_.is_writable()) return;
  const auto max_age = std::chrono::milliseconds(config_.max_age);
  // One commit: a fault in the middle changes neither the rows nor their counted size.
  disk_.commit("delete", [&] { table_->drop_old(disk_.utc_ms(), max_age.count()); });
}

void StoredJournal::age_earlier_runs() {
  disk_.attempt("write", [&] { table_->age_acknowledged(first_of_run_); });
}

void StoredJournal::move_stored_times(std::int64_t by_ms) {
  table_->move_times(by_ms, first_of_run_, disk_.machine_start_ms() - by_ms,
                     disk_.utc_ms() - by_ms);
}

bool StoredJournal::has_pending() const { return waiting_.size() != 0 || !to_acknowledge_.empty(); }

void StoredJournal::begin_commit() {
  table_->begin();
  written_ = 0;
  is_acknowledged_ = false;
}

bool StoredJournal::write_pending(std::size_t at_most) {
  const std::size_t count = std::min(at_most, waiting_.size());
  for (auto entry = waiting_.begin(); written_ < count; ++entry, ++written_) write(*entry);
  if (written_ < waiting_.size()) return true;
  // Acknowledgements follow their results.
  for (const auto& [device, id, number, total_ms] : to_acknowledge_)
    table_->acknowledge(device, id, number, total_ms);
  is_acknowledged_ = true;
  return false;
}

void StoredJournal::committed() {
  table_->committed();
  waiting_.drop_first(written_);
  if (is_acknowledged_) to_acknowledge_.clear();
  kept_ = std::min(kept_, to_acknowledge_.size());
  written_ = 0;
  if (!has_pending() && !unrecorded_file_.is_empty() && survives_power_cut(disk_.database()))
    unrecorded_file_.clear();
}

}  // namespace fxagent
