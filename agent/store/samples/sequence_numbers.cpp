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
}

std::vector<std::uint64_t> SequenceNumbers::begin(std::span<const std::string> devices,
                                                  std::int64_t utc_ms) {
  is_behind_ = ::access(behind_.path().c_str(), F_OK) == 0;
  std::map<std::string, std::uint64_t> reserved;
  auto begun = add(devices, utc_ms, reserved);
  // The mark counts for devices that have left the config too, and is removed here.
  if (is_behind_) add(names_on_disk(), utc_ms, reserved);
  if (write(reserved, Meaning::reserved))
    mark_as_known();
  else if (!config_.sync_always)  // else no number is in use yet
    refused();
  return begun;
}

std::vector<std::string> SequenceNumbers::names_on_disk() {
  std::vector<std::string> names;
  if (!disk_.is_open()) return names;
  disk_.read([&] {
    SQLite::Statement known(disk_.database(), "SELECT name FROM devices");
    sqlite::each(known,
                 [&](const SQLite::Statement& row) { names.emplace_back(sqlite::text(row, 0)); });
  });
  return names;
}

std::vector<std::uint64_t> SequenceNumbers::join(std::span<const std::string> devices,
                                                 std::int64_t utc_ms) {
  std::map<std::string, std::uint64_t> reserved;
  auto begun = add(devices, utc_ms, reserved);
  if (!reserved.empty()) write(reserved, Meaning::reserved);
  return begun;
}

std::vector<std::uint64_t> SequenceNumbers::add(std::span<const std::string> devices,
                                                std::int64_t utc_ms,
                                                std::map<std::string, std::uint64_t>& reserved) {
  std::vector<std::uint64_t> begun;
  for (const std::string& device : devices) {
    if (const auto known = numbers_.find(device); known != numbers_.end()) {
      begun.push_back(known->second.last);
      continue;
    }
    // If nothing is known, start at the clock: it is above every number of an earlier boot.
    std::uint64_t last = from_sql(utc_ms);
    const auto known = [&](const SQLite::Statement& row) {
      const std::uint64_t written = from_sql(sqlite::number(row, 0));
      const bool exact = sqlite::number(row, 1) != 0 || config_.sync_always;
      if (is_behind_)
        last = std::max(last, written + kUnknown);
      else
        last = exact ? written : std::max(last, written);
    };
    if (disk_.is_open())
      disk_.read([&] {
        SQLite::Statement one(disk_.database(),
                              "SELECT last_seq, clean FROM devices WHERE name = ?");
        sqlite::each(one, known, device);
      });
    begun.push_back(last);
    numbers_[device] = {last, config_.sync_always ? last : last + kBlock};
    reserved[device] = numbers_[device].reserved;
  }
  return begun;
}

void SequenceNumbers::used(const std::string& device, std::uint64_t seq) {
  Numbers& numbers = numbers_[device];
  numbers.last = std::max(numbers.last, seq);
  if (config_.sync_always) return refused();  // each commit of samples writes their numbers
  if (seq + kBlock / 2 <= numbers.reserved) return;
  is_short_ = true;  // upkeep() reserves for all devices at once, before the other half is used
  if (seq >= numbers.reserved) reserve();
}

bool SequenceNumbers::asks_disk(const std::string& device, std::uint64_t seq) const {
  if (config_.sync_always) return !disk_.is_writable() && !is_behind_;
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
  std::map<std::string, std::uint64_t> all;
  for (const auto& [device, numbers] : numbers_)
    all[device] = config_.sync_always ? numbers.last : numbers.reserved;
  if (write(all, Meaning::reserved)) mark_as_known();
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
  if ((config_.sync_always || disk_.is_open()) && !disk_.is_writable()) mark_as_behind();
}

std::map<std::string, std::uint64_t> SequenceNumbers::above_ours() {
  std::map<std::string, std::uint64_t> above;
  disk_.read([&] {
    SQLite::Statement known(disk_.database(), "SELECT name, last_seq FROM devices");
    sqlite::each(known, [&](const SQLite::Statement& row) {
      const auto own = numbers_.find(std::string(sqlite::text(row, 0)));
      const std::uint64_t last = from_sql(sqlite::number(row, 1));
      if (own != numbers_.end() && last > own->second.last) above[own->first] = last;
    });
  });
  return above;
}

/// Creates an empty marker file, which has room even on a full disk.
void SequenceNumbers::mark_as_behind() { is_behind_ = is_behind_ || behind_.write({}).empty(); }

void SequenceNumbers::mark_as_known() {
  if (std::exchange(is_behind_, false)) behind_.remove();
}

}  // namespace fxagent
