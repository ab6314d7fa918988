#include "agent/store/samples/sequence_numbers.h"

#include <unistd.h>

#include <algorithm>
#include <utility>

namespace fxagent {

using sqlite::from_sql;

void SequenceNumbers::load(SQLite::Database& database) {
  // A number decreases only from the end of its block to the exact last one.
  insert_.emplace(database,
                  "INSERT INTO devices VALUES(?, ?, ?) ON CONFLICT DO UPDATE SET last_seq ="
                  " CASE excluded.clean WHEN 1 THEN excluded.last_seq"
                  " ELSE max(last_seq, excluded.last_seq) END, clean = excluded.clean");
  is_behind_ = ::access(behind_.path().c_str(), F_OK) == 0;
  is_mark_refused_ = false;
  found_.clear();
  SQLite::Statement all(database, "SELECT name, last_seq, clean FROM devices");
  sqlite::each(all, [this](const SQLite::Statement& row) {
    const std::uint64_t written = from_sql(sqlite::number(row, 1));
    const bool exact = sqlite::number(row, 2) != 0 || config_.sync_always;
    found_[std::string(sqlite::text(row, 0))] = {is_behind_ ? written + kUnknown : written,
                                                 exact && !is_behind_};
  });
}

std::vector<std::uint64_t> SequenceNumbers::join(std::span<const std::string> devices,
                                                 std::int64_t utc_ms) {
  const std::size_t before = numbers_.size();
  std::vector<std::uint64_t> begun;
  for (const std::string& device : devices) begun.push_back(add(device, utc_ms));
  if (numbers_.size() != before) write_all();
  return begun;
}

std::uint64_t SequenceNumbers::add(const std::string& device, std::int64_t utc_ms) {
  if (const auto known = numbers_.find(device); known != numbers_.end()) return known->second.last;
  // If nothing is known, start at the clock: it is above every number of an earlier boot.
  std::uint64_t last = from_sql(utc_ms);
  if (const auto found = found_.find(device); found != found_.end())
    last = found->second.exact ? found->second.last : std::max(last, found->second.last);
  numbers_[device] = {last, config_.sync_always ? last : last + kBlock};
  return last;
}

void SequenceNumbers::used(const std::string& device, std::uint64_t seq) {
  Numbers& numbers = numbers_[device];
  numbers.last = std::max(numbers.last, seq);
  if (config_.sync_always) {  // each commit of samples writes their numbers
    if (asks_disk(device, seq)) refused();
    return;
  }
  if (seq + kBlock / 2 <= numbers.reserved) return;
  is_short_ = true;  // upkeep() reserves for all devices at once, before the other half is used
  if (seq >= numbers.reserved) reserve();
}

bool SequenceNumbers::asks_disk(const std::string& device, std::uint64_t seq) const {
  if (config_.sync_always) return !disk_.is_writable() && !is_behind_ && !is_mark_refused_;
  const auto known = numbers_.find(device);
  return known == numbers_.end() || seq >= known->second.reserved;
}

void SequenceNumbers::reserve() {
  is_short_ = false;
  std::map<std::string, std::uint64_t> reserved;
  for (auto& [device, numbers] : numbers_) {
    if (numbers.last + kBlock / 2 <= numbers.reserved) continue;
    numbers.reserved = numbers.last + kBlock;
    reserved[device] = numbers.reserved;
  }
  if (!write(reserved, Meaning::reserved)) refused();
}

/// Synchronised with the disk: a power cut must not bring a number back.
bool SequenceNumbers::write(const std::map<std::string, std::uint64_t>& numbers, Meaning meaning) {
  return disk_.commit("numbers", StoreDisk::Sync::full, [&] {
    for (const auto& [device, number] : numbers)
      sqlite::run(*insert_, device, number, meaning == Meaning::exact ? 1 : 0);
  });
}

void SequenceNumbers::write_all() {
  // The marker counts for every device of the file, and is removed here.
  if (is_behind_)
    for (const auto& [device, found] : found_) add(device, disk_.utc_ms());
  std::map<std::string, std::uint64_t> all;
  for (const auto& [device, numbers] : numbers_)
    all[device] = config_.sync_always ? numbers.last : numbers.reserved;
  if (!write(all, Meaning::reserved)) return refused();
  if (std::exchange(is_behind_, false)) behind_.remove();
  is_mark_refused_ = false;
}

void SequenceNumbers::write_last() {
  std::map<std::string, std::uint64_t> last;
  for (const auto& [device, numbers] : numbers_) last[device] = numbers.last;
  write(last, Meaning::exact);
}

void SequenceNumbers::write_with_samples(const std::map<std::string, std::uint64_t>& highest) {
  if (!config_.sync_always) return;
  for (const auto& [device, seq] : highest) sqlite::run(*insert_, device, seq, 0);
}

void SequenceNumbers::refused() {
  if (is_behind_ || disk_.is_writable() || !(config_.sync_always || disk_.is_open())) return;
  // An empty file has room even on a full disk.
  is_behind_ = behind_.write({}).empty();
  is_mark_refused_ = !is_behind_;
}

std::map<std::string, std::uint64_t> SequenceNumbers::above_ours() {
  std::map<std::string, std::uint64_t> above;
  for (auto& [device, own] : numbers_) {
    const auto found = found_.find(device);
    if (found == found_.end() || found->second.last <= own.last) continue;
    above[device] = own.last = found->second.last;
    own.reserved = std::max(own.reserved, own.last);
  }
  return above;
}

}  // namespace fxagent
