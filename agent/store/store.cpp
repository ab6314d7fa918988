#include "agent/store/store.h"

#include <algorithm>
#include <iterator>
#include <stdexcept>

#include "agent/log/log.h"

namespace fxagent {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

constexpr milliseconds kFlushEvery{200};
constexpr std::size_t kRemovedAtOnce = 200;  // takes about 1 ms, which live samples can wait
constexpr seconds kCleanUpEvery{60};

/// A second agent of the same config would also share links and client id with the first one. Other
/// faults of the lock are left to StoreDisk::open().
void lock_or_throw(StoreDisk& disk, milliseconds patience) {
  if (const std::string why = disk.lock(patience); disk.is_in_use())
    throw std::runtime_error("cannot start: " + why);
}

}  // namespace

Store::Store(const StoreConfig& config, std::int64_t utc_ms)
    : config_(config), disk_(config, utc_ms) {
  lock_or_throw(disk_, kJustEnds);
  // Waiting audit records are older than waiting commands, and are written before them.
  disk_.set_parts({&samples_, &audit_, &journal_, &numbers_});
  disk_.open();
  samples_.begin_run();
  if (!disk_.is_open()) audit_.count_from(static_cast<std::uint64_t>(utc_ms));
  if (disk_.is_locked() && !disk_.is_open()) journal_.read_earlier_runs();
  if (disk_.is_locked()) journal_.open_unrecorded_file();
  journal_.begin_run(audit_.last_command_number() + 1);
  started_.begin_run(audit_.last_command_number() + 1);
  if (disk_.is_locked()) started_.go_on();
  if (is_writable())
    log::info("store", {{"state", "disk"},
                        {"path", config_.path},
                        {"rows", std::to_string(samples_.rows())},
                        {"bytes", std::to_string(samples_.streams().bytes())}});
}

bool await_other_agent(const StoreConfig& config, milliseconds patience) {
  StoreDisk disk(config, 0);
  const std::string why = disk.lock(milliseconds(0));
  if (!disk.is_in_use()) return false;
  log::info("store", {{"state", "waiting"}, {"reason", why}});
  lock_or_throw(disk, patience);
  return true;
}

/// Opens a file that was missing at the start or in use by another agent. Reads it before this
/// run's numbers and commands are in it.
void Store::open_late() {
  const bool is_own = disk_.was_open();  // only its lock or log is gone, or it was set aside
  disk_.open();
  if (!is_writable()) return;
  if (!is_own) found_late_.reset();
  find_unrecorded();
  started_.begin_anew(audit_.last_command_number() + 1);
  if (is_own) return;
  samples_.begin_run();
  // If the clock started in the past, commands of this run have lower numbers than earlier ones.
  journal_.age_earlier_runs();
  find_commands();
  if (disk_.is_open()) found_late_->numbers = numbers_.above_ours();  // closed if damaged
}

void Store::find_commands() {
  disk_.move_stored_times();  // otherwise ids from before the clock was set seem old
  if (!found_late_) found_late_.emplace();
  std::ranges::move(journal_.known_ids(), std::back_inserter(found_late_->ids));
  std::ranges::move(journal_.unacknowledged_in_file(),
                    std::back_inserter(found_late_->unacknowledged));
}

void Store::find_unrecorded() {
  for (JournalEntry& entry : journal_.open_unrecorded_file()) {
    if (!found_late_) found_late_.emplace();
    found_late_->ids.push_back(entry);
    if (!entry.acknowledged) found_late_->unacknowledged.push_back(std::move(entry));
  }
}

/// An open file that has lost its name accepts writes, but no later run finds them.
void Store::look_for_the_files() {
  if (!disk_.abandon_misplaced()) return;
  open_late();
  if (!is_writable()) return;
  if (audit_.head().records == 0) audit_.set_aside({});
  numbers_.write_all();
  log::info("store", {{"state", "disk"}, {"rows", std::to_string(samples_.rows())}});
}

bool Store::try_the_disk(SteadyTime now) {
  if (!try_at_) try_at_ = now + kTryAgain;
  if (now < *try_at_) return false;
  try_at_ = now + kTryAgain;
  disk_.is_open() ? disk_.try_to_write() : open_late();
  // This run's commands still wait in memory.
  if (is_writable() && journal_.take_unread()) find_commands();
  numbers_.write_all();
  disk_.move_stored_times();
  if (!disk_.flush()) return false;
  log::info("store", {{"state", "disk"}, {"rows", std::to_string(samples_.rows())}});
  return true;
}

bool Store::note_time(SteadyTime now, std::int64_t utc_ms) {
  disk_.note_time(now, utc_ms);
  if (!running_since_) running_since_ = now;
  if (!is_writable()) return !try_at_ || now >= *try_at_ || journal_.has_unkept();
  return is_flush_due(now) || now >= clean_up_at_ || disk_.has_times_to_move() ||
         audit_.is_too_large();
}

bool Store::is_flush_due(SteadyTime now) const {
  return now >= flush_at_ || samples_.removed() >= kRemovedAtOnce;
}

void Store::upkeep(SteadyTime now, std::int64_t utc_ms) {
  if (!note_time(now, utc_ms)) return;
  if (!is_writable()) journal_.keep_unrecorded();
  if (!is_writable() && !try_the_disk(now)) return;
  try_at_.reset();
  disk_.move_stored_times();
  if (is_flush_due(now)) {
    flush_at_ = now + kFlushEvery;
    disk_.flush();
    if (numbers_.is_short()) numbers_.reserve();
    journal_.shrink();
    samples_.drop_excess();
  }
  const bool is_clean_up_due = now >= clean_up_at_;
  if (is_clean_up_due) {
    clean_up_at_ = now + kCleanUpEvery;
    look_for_the_files();
    // The file was deleted or replaced, or there is room for it now. It may be another agent's.
    if (disk_.is_locked()) find_unrecorded();
    samples_.drop_old();
    journal_.drop_old();
  }
  if (is_clean_up_due || audit_.is_too_large()) audit_.prune_to_limits(now, *running_since_);
}

bool Store::has_pending() const {
  return is_writable() && (disk_.has_pending() || numbers_.is_short());
}

void Store::close() {
  // Marks and UnrecordedFile stay for the next start if the database does not have all commands.
  if (!is_writable() || !disk_.flush()) return journal_.keep_unrecorded();
  numbers_.write_last();
  // The standby of a pair may close it with commands that have no result: the marks tell of them.
  const auto has_result = [](const JournalEntry& entry) { return !entry.result.empty(); };
  if (std::ranges::all_of(journal_.unacknowledged({}), has_result)) started_.close();
  disk_.close();
}

std::vector<std::uint64_t> first_numbers(const Config& config, Store* store, std::int64_t utc_ms) {
  if (store == nullptr)
    return std::vector<std::uint64_t>(config.devices.size(), static_cast<std::uint64_t>(utc_ms));
  std::vector<std::string> names;
  for (const DeviceConfig& device : config.devices) names.push_back(device.name);
  return store->numbers().join(names, utc_ms);
}

}  // namespace fxagent
