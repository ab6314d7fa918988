// The numbers that each device has reached: reserved ahead of their use, and marked where the disk
// does not know them.
#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <system_error>
#include <utility>

#include "agent/store/store.h"

namespace fxagent {
namespace {

using sqlite::from_sql;
using sqlite::Statement;
using sqlite::to_sql;
using sqlite::Transaction;

}  // namespace

std::vector<std::uint64_t> Store::begin_numbers(std::span<const std::string> devices,
                                                std::int64_t utc_ms) {
  numbers_behind_ = ::access(numbers_behind_path().c_str(), F_OK) == 0;
  std::vector<std::uint64_t> begun;
  std::vector<NumberRow> rows;
  for (const std::string& device : devices) {
    // Where nothing is known, the clock is above every number of an earlier boot.
    std::uint64_t last = from_sql(utc_ms);
    if (file_) {
      Statement known(file_->db, "SELECT last_seq, clean FROM devices WHERE name = ?");
      if (known.bind(1, device).step() == Statement::Step::row) {
        const std::uint64_t written = from_sql(known.number(0));
        const bool exact = known.number(1) != 0 || config_.sync_always;
        if (numbers_behind_)
          last = std::max(last, written + kUnknownNumbers);
        else
          last = exact ? written : std::max(last, written);
      }
    }
    begun.push_back(last);
    numbers_[device] = {last, config_.sync_always ? last : last + kSequenceBlock};
    rows.push_back({device, numbers_[device].reserved});
  }
  if (write_numbers(rows, false)) numbers_are_known();
  return begun;
}

void Store::used_seq(const std::string& device, std::uint64_t seq) {
  Numbers& numbers = numbers_[device];
  numbers.last = std::max(numbers.last, seq);
  if (config_.sync_always) {  // each sample brings its number to the disk itself
    if (!writable_) numbers_are_behind();
    return;
  }
  if (seq + kSequenceBlock / 2 <= numbers.reserved) return;
  numbers_short_ = true;  // upkeep() does it for all devices at once, while the other half lasts
  if (seq >= numbers.reserved) reserve_numbers();
}

void Store::reserve_numbers() {
  numbers_short_ = false;
  std::vector<NumberRow> rows;
  for (auto& [device, numbers] : numbers_) {
    if (numbers.last + kSequenceBlock / 2 <= numbers.reserved) continue;
    numbers.reserved = numbers.last + kSequenceBlock;
    rows.push_back({device, numbers.reserved});
  }
  write_numbers(rows, false);
}

/// In one transaction that is synchronised with the disk: no power cut may bring a number back.
bool Store::write_numbers(const std::vector<NumberRow>& rows, bool clean) {
  if (!writable_) return false;
  const auto write = [&] {
    Transaction transaction(file_->db);
    return transaction.begun() &&
           std::all_of(rows.begin(), rows.end(),
                       [&](const NumberRow& row) {
                         return file_->numbers.bind(1, row.device)
                             .bind(2, to_sql(row.last))
                             .bind(3, clean ? 1 : 0)
                             .run();
                       }) &&
           transaction.commit();
  };
  file_->synchronise(true);
  const bool written = write();
  file_->synchronise(false);
  if (!written) failed("numbers");
  return written;
}

void Store::write_all_numbers() {
  std::vector<NumberRow> rows;
  for (const auto& [device, numbers] : numbers_)
    rows.push_back({device, config_.sync_always ? numbers.last : numbers.reserved});
  if (write_numbers(rows, false)) numbers_are_known();
}

std::string Store::numbers_behind_path() const { return config_.path + "/fxagent.db.behind"; }

/// The disk refuses rows, and the numbers with them; an empty file finds room where it is full.
void Store::numbers_are_behind() {
  if (std::exchange(numbers_behind_, true)) return;
  const int mark =
      ::open(numbers_behind_path().c_str(), O_WRONLY | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0600);
  if (mark < 0) return;
  ::fsync(mark);
  ::close(mark);
}

void Store::numbers_are_known() {
  if (!std::exchange(numbers_behind_, false)) return;
  std::error_code none;
  std::filesystem::remove(numbers_behind_path(), none);
}

}  // namespace fxagent
