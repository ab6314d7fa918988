#include "agent/store/journal/stored_journal.h"

#include <algorithm>
#include <chrono>
#include <iterator>
#include <utility>

namespace fxagent {
namespace {

using Sync = StoreDisk::Sync;

// Commands may take 1 / kShareOfJournal of max_bytes; samples have at least the rest.
constexpr std::uint64_t kShareOfJournal = 2;

}  // namespace

bool StoredJournal::journal(std::span<const JournalEntry> entries) {
  const bool written = disk_.commit("journal", Sync::as_configured, [&] {
    for (const JournalEntry& entry : entries) rows_.write_command(entry);
  });
  if (written) return true;
  for (const JournalEntry& entry : entries) rows_.keep(entry);
  // A fresh file may have replaced a damaged one.
  return disk_.is_writable() && disk_.flush();
}

void StoredJournal::record(std::vector<JournalEntry> entries) {
  if (entries.empty()) return;
  // A command that is not on disk yet is written together with its result.
  const bool command_waits =
      std::any_of(entries.begin(), entries.end(), [this](const JournalEntry& entry) {
        return rows_.waiting(entry.device, entry.id) != nullptr;
      });
  const auto write = [&] {
    for (const JournalEntry& entry : entries) rows_.write_result(entry);
  };
  if (!command_waits && disk_.commit("journal", Sync::as_configured, write)) return;
  for (JournalEntry& entry : entries) rows_.keep(std::move(entry));
  if (disk_.is_writable()) disk_.flush();
}

void StoredJournal::acknowledge(std::string device, std::string id, std::uint64_t number,
                                std::string total_ms) {
  rows_.acknowledge(std::move(device), std::move(id), number, std::move(total_ms));
}

std::optional<JournalEntry> StoredJournal::find(const std::string& device, const std::string& id) {
  if (const JournalEntry* kept = rows_.waiting(device, id)) return *kept;
  std::optional<JournalEntry> found;
  if (rows_.table()) disk_.read([&] { found = rows_.table()->find(device, id); });
  return found;
}

std::vector<KnownId> StoredJournal::known_ids(const std::string& device) {
  std::vector<KnownId> ids;
  if (rows_.table()) disk_.attempt("read", [&] { ids = rows_.table()->known_ids(device); });
  return ids;
}

std::vector<JournalEntry> StoredJournal::unacknowledged(const std::string& device) {
  std::vector<JournalEntry> entries;
  if (rows_.table())
    disk_.attempt("read", [&] { entries = rows_.table()->unacknowledged(device); });
  for (JournalEntry& entry : entries)
    entry.surely_not_sent = entry.result.empty() && started_.surely_not_sent(entry.number);
  return entries;
}

std::vector<JournalEntry> StoredJournal::unwritten() {
  std::vector<JournalEntry> entries;
  auto acknowledged = rows_.acknowledged_ids();
  for (const JournalEntry& entry : rows_.waiting()) {
    entries.push_back(entry);
    entries.back().acknowledged = acknowledged.erase({entry.device, entry.id}) != 0;
  }
  for (const auto& [device, id] : acknowledged) {
    auto entry = find(device, id);
    if (!entry) continue;
    entry->acknowledged = true;
    entries.push_back(*std::move(entry));
  }
  return entries;
}

void StoredJournal::shrink() {
  const std::uint64_t most = std::max(config_.max_bytes / kShareOfJournal, not_to_be_shrunk_);
  if (!disk_.is_writable() || rows_.bytes() <= most) return;
  not_to_be_shrunk_ = 0;
  disk_.commit("shrink", Sync::as_configured, [&] {
    if (!rows_.table()->shrink()) not_to_be_shrunk_ = rows_.bytes();
  });
}

void StoredJournal::drop_old() {
  if (!disk_.is_writable()) return;
  const auto max_age = std::chrono::milliseconds(config_.max_age);
  // One commit: a fault in the middle changes neither the rows nor their counted size.
  disk_.commit("delete", Sync::as_configured,
               [&] { rows_.table()->drop_old(disk_.utc_ms(), max_age.count()); });
}

void StoredJournal::age_earlier_runs() {
  disk_.attempt("write", [&] { rows_.table()->age_acknowledged(first_of_run_); });
}

void StoredJournal::move_stored_times(std::int64_t by_ms) {
  rows_.table()->move_times(by_ms, first_of_run_, disk_.utc_ms() - by_ms);
}

}  // namespace fxagent
