#include "agent/store/disk/store_disk.h"

#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <system_error>
#include <utility>

#include "agent/log/log.h"

namespace fxagent {
namespace {

using std::chrono::milliseconds;

constexpr std::size_t kFlushedAtOnce = 500;
// The calendar counts as set when it moves this far against the steady clock. Neither drifts that
// much.
constexpr milliseconds kClockSet{60'000};

/// True for codes after which the file cannot be trusted. SQLITE_SCHEMA: a newer program wrote it,
/// or the schema is not ours, as after truncation. SQLITE_NOMEM and SQLITE_TOOBIG: it contains
/// false lengths; an agent that is really out of memory does not get here. SQLITE_CONSTRAINT and
/// SQLITE_MISMATCH: it contains a row that cannot have been written.
bool is_damage(int code) {
  return code == SQLITE_CORRUPT || code == SQLITE_NOTADB || code == SQLITE_SCHEMA ||
         code == SQLITE_NOMEM || code == SQLITE_TOOBIG || code == SQLITE_CONSTRAINT ||
         code == SQLITE_MISMATCH;
}

/// Same at open, and two codes more. SQLITE_ERROR: the schema cannot be created because something
/// else has the name. SQLITE_READONLY, if the system lets us write all its files: the file claims a
/// later format, which SQLite only reads.
bool is_damage_at_open(int code, const std::string& path) {
  if (code != SQLITE_READONLY) return is_damage(code) || code == SQLITE_ERROR;
  const auto may_write = [](const std::string& name) {
    return ::access(name.c_str(), W_OK) == 0 || errno == ENOENT;
  };
  return may_write(path) && may_write(path + "-wal") && may_write(path + "-shm") &&
         may_write(std::filesystem::path(path).parent_path().string());
}

}  // namespace

std::string StoreDisk::lock(milliseconds patience) {
  is_in_use_ = false;
  std::string why = make_store_directory(config_.path);
  if (lock_ && (!why.empty() || lock_->is_in_place())) return why;
  if (!why.empty()) {
    // A root user may start an agent while that of the service, whose directory it is, runs.
    const std::string used = refused_in_use(config_.path, patience);
    is_in_use_ = !used.empty();
    if (is_in_use_) was_open_ = false;
    return is_in_use_ ? used : why;
  }
  // Two agents with one store would publish and journal each other's data.
  lock_ = std::make_unique<DirectoryLock>(config_.path, patience);
  is_in_use_ = lock_->is_in_use();
  if (is_in_use_) was_open_ = false;  // the other process may write commands of its own
  why = lock_->fault();
  if (!why.empty()) lock_.reset();
  return why;
}

void StoreDisk::open() {
  const std::string path = store_file_path(config_.path);
  // The second round follows a damaged file that was set aside.
  for (int round = 0; round < 2 && !writable_; ++round) {
    std::string why = lock();
    if (why.empty()) why = make_store_file(config_.path);
    if (!why.empty()) return refused(why);
    const auto fault = sqlite::attempt([&] {
      file_ = std::make_unique<StoreFile>(path, config_.sync_always);
      each(&StorePart::load, file_->db);
    });
    if (!fault) {
      writable_ = was_open_ = true;
      last_failure_.clear();
    } else if (is_damage_at_open(fault->code, path) && round == 0) {
      start_anew(fault->text);
    } else {
      failed("open", *fault);
      let_go(StorePart::Rows::unread);
      return;
    }
  }
}

void StoreDisk::try_to_write() {
  if (const auto fault = file_->why_not_writable()) return failed("write", *fault);
  writable_ = true;
  last_failure_.clear();
}

bool StoreDisk::abandon_misplaced() {
  if (!writable_ || (file_->is_in_place() && lock_->is_in_place())) return false;
  log::error("store", {{"state", "memory"},
                       {"path", config_.path},
                       {"reason", "its files were deleted or replaced while the agent ran"},
                       {"samples_lost", std::to_string(rows())}});
  // Another file may belong to another run. Another lock may be that of an agent that has ended.
  was_open_ = file_->has_its_name() && !lock_->is_replaced();
  let_go(StorePart::Rows::lost);
  lock_.reset();
  return true;
}

void StoreDisk::close() {
  if (writable_) file_->db.tryExec("PRAGMA wal_checkpoint(TRUNCATE)");
  let_go(StorePart::Rows::kept);
}

void StoreDisk::let_go(StorePart::Rows rows) {
  each(&StorePart::unload, rows);
  if (rows == StorePart::Rows::lost) unmoved_ms_ = 0;  // lost rows need no shift
  file_.reset();
  writable_ = false;
}

void StoreDisk::start_anew(const std::string& why) {
  const std::string path = store_file_path(config_.path);
  const std::string first = path + ".corrupt-" + std::to_string(utc_ms_);
  const std::uint64_t lost = rows();
  let_go(StorePart::Rows::lost);
  std::error_code fault;
  std::string aside = first;
  for (int n = 2; std::filesystem::exists(aside, fault); ++n)
    aside = first + "-" + std::to_string(n);
  fault.clear();
  std::filesystem::rename(path, aside, fault);
  for (const char* suffix : {"-wal", "-shm"}) {
    std::error_code none;
    std::filesystem::rename(path + suffix, aside + suffix, none);
  }
  log::error("store", {{"state", "damaged"},
                       {"reason", why},
                       {"set_aside", fault ? "failed: " + fault.message() : aside},
                       {"samples_lost", std::to_string(lost)}});
  if (!fault) set_aside_ = std::filesystem::path(aside).filename().string();
  each(&StorePart::set_aside, set_aside_);
}

void StoreDisk::failed(std::string_view doing, const sqlite::Fault& fault) {
  // If a file was set aside before, a row that cannot be there may be a bug of ours.
  const bool is_row = fault.code == SQLITE_CONSTRAINT || fault.code == SQLITE_MISMATCH;
  const bool is_file = is_damage(fault.code) && (!is_row || set_aside_.empty());
  // Once: if the disk damages the fresh file too, give up until the next try.
  if (is_file && writable_ && !std::exchange(mending_, true)) {
    start_anew(fault.text);
    open();
    each(&StorePart::replaced);
    mending_ = false;
    return;
  }
  refused(std::string(doing) + ": " + fault.text);
}

void StoreDisk::refused(const std::string& why) {
  if (failures_ == Failures::logged && (writable_ || why != last_failure_))
    log::error("store", {{"state", "memory"},
                         {"path", config_.path},
                         {"reason", why},
                         {"note",
                          "commands are carried out, but samples and audit records are in "
                          "memory only: free or repair the disk, and do not restart before"}});
  last_failure_ = why;
  writable_ = false;
}

bool StoreDisk::commit(std::string_view doing, Sync sync, const Work& work) {
  if (!writable_) return false;
  if (sync == Sync::full) file_->synchronise(true);
  const auto fault = sqlite::attempt([&] {
    SQLite::Transaction transaction(file_->db, SQLite::TransactionBehavior::IMMEDIATE);
    each(&StorePart::begin_commit);
    work();
    each(&StorePart::end_commit);
    transaction.commit();
  });
  if (sync == Sync::full) file_->synchronise(false);
  if (fault) {
    failed(doing, *fault);
    return false;
  }
  each(&StorePart::committed);
  return true;
}

bool StoreDisk::attempt(std::string_view doing, const Work& work) {
  const auto fault = sqlite::attempt(work);
  if (fault) failed(doing, *fault);
  return !fault;
}

bool StoreDisk::read(const Work& work) {
  const auto fault = sqlite::attempt(work);
  if (!fault) return true;
  if (is_damage(fault->code))
    failed("read", *fault);
  else
    log::error("store", {{"path", config_.path}, {"reason", "read: " + fault->text}});
  return false;
}

void StoreDisk::note_time(SteadyTime now, std::int64_t utc_ms) {
  if (noted_at_) {
    const std::int64_t passed = std::chrono::duration_cast<milliseconds>(now - *noted_at_).count();
    const std::int64_t set_by = utc_ms - utc_ms_ - passed;
    if (std::abs(set_by) >= kClockSet.count()) {
      log::warn("clock_set", {{"by_ms", std::to_string(set_by)}});
      unmoved_ms_ += set_by;
      each(&StorePart::move_waiting_times, set_by);
    }
  }
  noted_at_ = now;
  utc_ms_ = utc_ms;
}

std::int64_t StoreDisk::machine_start_ms() const {
  const auto since = noted_at_.value_or(SteadyTime{}).time_since_epoch();
  return utc_ms_ - std::chrono::duration_cast<milliseconds>(since).count();
}

void StoreDisk::move_stored_times() {
  if (unmoved_ms_ == 0) return;
  if (commit("clock", [this] { each(&StorePart::move_stored_times, unmoved_ms_); }))
    unmoved_ms_ = 0;
}

bool StoreDisk::write_pending(std::size_t at_most) {
  bool is_left = false;
  for (StorePart* part : parts_) is_left = part->write_pending(at_most) || is_left;
  return is_left;
}

std::uint64_t StoreDisk::rows() const {
  std::uint64_t rows = 0;
  for (const StorePart* part : parts_) rows += part->rows();
  return rows;
}

bool StoreDisk::flush() {
  if (!has_pending()) return writable_;
  // A second round if a fresh file has replaced a damaged one.
  for (int round = 0; round < 2 && writable_; ++round) {
    // In pieces: after hours without a disk there may be more than live samples can wait for, or
    // more than fits.
    bool is_done = true;
    for (bool is_left = true; is_done && is_left;)
      is_done = commit("write", [&] { is_left = write_pending(kFlushedAtOnce); });
    if (is_done) return true;
  }
  return false;
}

}  // namespace fxagent
