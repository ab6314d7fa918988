#include "agent/store/store.h"

#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <filesystem>
#include <system_error>

#include "agent/failpoint.h"
#include "agent/log/log.h"
#include "agent/store/sqlite.h"

namespace fxagent {
namespace {

using sqlite::from_sql;
using sqlite::Statement;
using sqlite::to_sql;
using sqlite::Transaction;
using std::chrono::duration_cast;
using std::chrono::milliseconds;
using std::chrono::seconds;

constexpr milliseconds kFlushEvery{200};
constexpr std::size_t kFlushedAtOnce = 500;
constexpr std::size_t kRemovedAtOnce = 200;  // about a millisecond, which live samples may wait
constexpr seconds kCleanUpEvery{60};

/// How many of what waits go at once.
template <class Waiting>
std::ptrdiff_t piece_of(const Waiting& waiting) {
  return static_cast<std::ptrdiff_t>(std::min(waiting.size(), kFlushedAtOnce));
}

/// The codes after which the file is not to be trusted any more; SQLITE_SCHEMA: a newer program's,
/// or not what ours makes, as where the file was cut short. SQLITE_NOMEM and SQLITE_TOOBIG: it has
/// lengths that are not its own, since an agent that is really out of memory does not come here.
/// The last two: a row that is there is none that could have been written.
bool is_damage(int code) {
  return code == SQLITE_CORRUPT || code == SQLITE_NOTADB || code == SQLITE_SCHEMA ||
         code == SQLITE_NOMEM || code == SQLITE_TOOBIG || code == SQLITE_CONSTRAINT ||
         code == SQLITE_MISMATCH;
}

/// Beside that a schema that cannot be made, since something of that name is there: SQLITE_ERROR;
/// and a file that calls itself of a later format, which SQLite reads only, where the system lets
/// us write all that belongs to it.
bool is_damage_at_open(int code, const std::string& path) {
  if (code != SQLITE_READONLY) return is_damage(code) || code == SQLITE_ERROR;
  const auto may_write = [](const std::string& name) {
    return ::access(name.c_str(), W_OK) == 0 || errno == ENOENT;
  };
  return may_write(path) && may_write(path + "-wal") && may_write(path + "-shm") &&
         may_write(std::filesystem::path(path).parent_path().string());
}

}  // namespace

Store::Store(const StoreConfig& config, std::int64_t utc_ms) : config_(config), utc_ms_(utc_ms) {
  open(utc_ms);
  recovered_ = rows_;
  first_of_run_ = next_row_id_;
  // Above those of a file that opens later, unless the clock went back.
  if (!file_) last_command_number_ = static_cast<std::uint64_t>(utc_ms);
  first_command_of_run_ = last_command_number_ + 1;
  if (writable_)
    log::info("store", {{"state", "disk"},
                        {"path", config_.path},
                        {"rows", std::to_string(rows_)},
                        {"bytes", std::to_string(bytes_)}});
}

Store::~Store() = default;

void Store::open(std::int64_t utc_ms) {
  utc_ms_ = utc_ms;
  const std::string path = store_file_path(config_.path);
  // A second time, after a damaged file was set aside.
  for (int attempt = 0; attempt < 2 && !writable_; ++attempt) {
    std::string why = make_store_file(config_.path);
    if (why.empty() && !lock_) {
      // Two agents with one store would publish and journal for each other.
      lock_ = std::make_unique<DirectoryLock>(config_.path);
      why = lock_->fault();
      if (!why.empty()) lock_.reset();
    }
    if (!why.empty()) {
      if (why != last_failure_) log::error("store", {{"state", "memory"}, {"reason", why}});
      last_failure_ = why;
      return;
    }
    file_ = std::make_unique<StoreFile>(path, config_.sync_always);
    if (file_->is_usable() && load()) {
      writable_ = was_open_ = true;
    } else if (is_damage_at_open(file_->db.fault().code, path) && attempt == 0) {
      start_anew(file_->db.fault().text);
    } else {
      failed("open");
      file_.reset();
      forget_rows();
      return;
    }
  }
}

/// A file that was not there at the start, or another agent's. What is read of it is read before
/// this run's own numbers and commands are in it.
void Store::open_late(std::int64_t utc_ms) {
  const bool is_own = was_open_;  // set aside as damaged, and neither that nor a fresh one worked
  open(utc_ms);
  if (!writable_) return;
  recovered_ += rows_;
  if (is_own) return;
  first_of_run_ = next_row_id_;
  // With a clock that began in the past the commands of this run have lower numbers than those of
  // earlier ones. What is settled of these counts as older all the same.
  Statement older(file_->db, "UPDATE orders SET arrival = 0 WHERE told = 1 AND arrival >= ?");
  if (!older.bind(1, to_sql(first_command_of_run_)).run()) failed("write");
  FoundLate found;
  found.ids = known_ids();
  found.unacknowledged = unacknowledged();
  found_late_ = std::move(found);
  if (!file_) return;  // found damaged meanwhile
  Statement known(file_->db, "SELECT name, last_seq FROM devices");
  while (known.step() == Statement::Step::row) {
    const auto own = numbers_.find(std::string(known.text(0)));
    const std::uint64_t last = from_sql(known.number(1));
    if (own != numbers_.end() && last > own->second.last) found_late_->numbers[own->first] = last;
  }
}

/// An open file that has lost its name can be written for ever, and nobody finds what is in it.
void Store::look_for_the_files() {
  if (!writable_ || (file_->is_in_place() && lock_->is_in_place())) return;
  log::error("store", {{"state", "memory"},
                       {"path", config_.path},
                       {"reason", "its files were deleted or replaced while the agent ran"},
                       {"samples_lost", std::to_string(rows_)}});
  for (const auto& [key, stream] : streams_)
    if (stream.rows > 0) dropped_[key.first] += stream.rows;
  file_.reset();
  lock_.reset();
  forget_rows();
  unstamped_ms_ = 0;
  // What is there now may be another run's.
  writable_ = was_open_ = false;
  open_late(utc_ms_);
  if (!writable_) return;
  if (file_->trail.head().records == 0) note(audit::begun({}, utc_ms_));
  write_all_numbers();
  log::info("store", {{"state", "disk"}, {"rows", std::to_string(rows_)}});
}

void Store::forget_rows() {
  streams_.clear();
  out_.clear();
  removed_.clear();
  rows_ = 0;
  bytes_ = 0;
}

bool Store::load() {
  forget_rows();
  file_->db.clear_fault();
  Statement sums(file_->db,
                 "SELECT device, grp, count(*), sum(length(CAST(row AS BLOB))), min(id), max(id)"
                 " FROM samples GROUP BY device, grp");
  while (sums.step() == Statement::Step::row) {
    Stream& stream = streams_[{std::string(sums.text(0)), std::string(sums.text(1))}];
    stream.rows = from_sql(sums.number(2));
    stream.oldest = from_sql(sums.number(4));
    rows_ += stream.rows;
    bytes_ += from_sql(sums.number(3)) + stream.rows * SampleRow::kOverhead;
    next_row_id_ = std::max(next_row_id_, from_sql(sums.number(5)) + 1);
  }
  if (!measure_journal() || !file_->trail.load()) return false;
  last_command_number_ = std::max(last_command_number_, file_->trail.arrivals());
  first_audit_of_run_ = file_->trail.head().records + 1;
  return file_->db.fault().code == SQLITE_OK;
}

/// `why` is a value: what the file has said goes with it.
void Store::start_anew(std::string why) {
  file_.reset();
  writable_ = false;
  const std::string path = store_file_path(config_.path);
  const std::string first = path + ".corrupt-" + std::to_string(utc_ms_);
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
                       {"reason", std::move(why)},
                       {"set_aside", fault ? "failed: " + fault.message() : aside},
                       {"samples_lost", std::to_string(rows_)}});
  if (!fault) set_aside_ = std::filesystem::path(aside).filename().string();
  note(audit::begun(set_aside_, utc_ms_));
  for (const auto& [key, stream] : streams_)
    if (stream.rows > 0) dropped_[key.first] += stream.rows;
  forget_rows();
  unstamped_ms_ = 0;
}

void Store::failed(std::string_view doing) {
  const sqlite::Fault fault = file_->db.fault();
  // A row that cannot be there may be of our own making, where it is not the first.
  const bool is_row = fault.code == SQLITE_CONSTRAINT || fault.code == SQLITE_MISMATCH;
  const bool is_file = is_damage(fault.code) && (!is_row || set_aside_.empty());
  // Once: a disk that spoils each fresh file at once is given up until the next try.
  if (is_file && writable_ && !std::exchange(mending_, true)) {
    start_anew(fault.text);
    open(utc_ms_);
    write_all_numbers();
    mending_ = false;
    return;
  }
  const std::string why = std::string(doing) + ": " + fault.text;
  if (writable_ || why != last_failure_)
    log::error("store", {{"state", "memory"}, {"path", config_.path}, {"reason", why}});
  last_failure_ = why;
  writable_ = false;
}

void Store::unreadable() {
  const sqlite::Fault fault = file_->db.fault();
  if (is_damage(fault.code)) return failed("read");
  log::error("store", {{"path", config_.path}, {"reason", "read: " + fault.text}});
}

void Store::upkeep(SteadyTime now, std::int64_t utc_ms) {
  note_clock(now, utc_ms);
  if (!running_since_) running_since_ = now;
  if (!writable_) {
    if (!try_at_) try_at_ = now + kTryAgain;
    if (now < *try_at_) return;
    try_at_ = now + kTryAgain;
    if (!file_) {
      open_late(utc_ms);
    } else if (file_->can_write()) {
      writable_ = true;
    } else {
      failed("write");
    }
    write_all_numbers();
    if (writable_ && unstamped_ms_ != 0) restamp();
    if (!flush()) return;
    last_failure_.clear();
    log::info("store", {{"state", "disk"}, {"rows", std::to_string(rows_)}});
  }
  try_at_.reset();
  if (unstamped_ms_ != 0) restamp();
  if (!flush_at_ || now >= *flush_at_ || removed_.size() >= kRemovedAtOnce) {
    flush_at_ = now + kFlushEvery;
    flush();
    if (numbers_short_) reserve_numbers();
    shrink_journal();
    drop_excess_rows();
  }
  if (!clean_up_at_ || now >= *clean_up_at_) {
    clean_up_at_ = now + kCleanUpEvery;
    look_for_the_files();
    drop_old_rows();
    drop_old_ids();
    prune_audit();
  } else if (writable_ && file_->trail.is_over(config_.audit_max_bytes)) {
    prune_audit();
  }
}

void Store::close() {
  if (!writable_) return;
  flush();
  std::vector<NumberRow> rows;
  for (const auto& [device, numbers] : numbers_) rows.push_back({device, numbers.last});
  write_numbers(rows, true);
  if (writable_) file_->db.execute("PRAGMA wal_checkpoint(TRUNCATE)");
  file_.reset();
  lock_.reset();
  writable_ = false;
}

void Store::note_clock(SteadyTime now, std::int64_t utc_ms) {
  if (clock_at_) {
    const std::int64_t passed = duration_cast<milliseconds>(now - *clock_at_).count();
    const std::int64_t set_by = utc_ms - utc_ms_ - passed;
    if (std::abs(set_by) >= milliseconds(kClockSet).count()) {
      log::warn("clock_set", {{"by_ms", std::to_string(set_by)}});
      unstamped_ms_ += set_by;
      for (auto entry = unrecorded_.begin(); entry != unrecorded_.end(); ++entry)
        unrecorded_.modify(entry, [set_by](JournalEntry& changed) {
          changed.received_ms += set_by;
          changed.deadline_ms += set_by;
        });
    }
  }
  clock_at_ = now;
  utc_ms_ = utc_ms;
}

/// What this run wrote goes with the clock: a gateway without one of its own starts in the past,
/// and its time comes over the same network as the broker, after the outage.
void Store::restamp() {
  Statement samples(file_->db, "UPDATE samples SET created_ms = created_ms + ? WHERE id >= ?");
  Statement commands(file_->db,
                     "UPDATE orders SET received_ms = received_ms + ?1,"
                     " deadline_ms = deadline_ms + ?1 WHERE arrival >= ?2 AND received_ms <= ?3");
  bool done = false;
  {
    Transaction transaction(file_->db);
    done = transaction.begun() &&
           samples.bind(1, unstamped_ms_).bind(2, to_sql(first_of_run_)).run() &&
           commands.bind(1, unstamped_ms_)
               .bind(2, to_sql(first_command_of_run_))
               .bind(3, utc_ms_ - unstamped_ms_)
               .run() &&
           transaction.commit();
  }
  if (!done) return failed("clock");
  unstamped_ms_ = 0;
}

// ---- samples ------------------------------------------------------------------------------------

bool Store::append(std::vector<SampleRow>& rows, Hold hold) {
  if (!writable_ || rows.empty()) return writable_;
  failpoint("sample_unstored");
  std::uint64_t added = 0;
  std::vector<Victim> gone;
  std::map<std::string, std::uint64_t> last;
  const auto write = [&] {
    Transaction transaction(file_->db);
    if (!transaction.begun() || !write_pending()) return false;
    std::uint64_t row_id = next_row_id_;
    for (const SampleRow& row : rows) {
      added += row.cost();
      last[row.device] = std::max(last[row.device], row.seq);
      if (!file_->insert.bind(1, to_sql(row_id++))
               .bind(2, row.device)
               .bind(3, row.group)
               .bind(4, to_sql(row.seq))
               .bind(5, utc_ms_)
               .bind(6, row.json)
               .run())
        return false;
    }
    if (config_.sync_always)
      for (const auto& [device, seq] : last)
        if (!file_->numbers.bind(1, device).bind(2, to_sql(seq)).bind(3, 0).run()) return false;
    const std::uint64_t full = bytes_ + added + journal_size_changed_.bytes;
    if (full > config_.max_bytes && !delete_oldest(full - config_.max_bytes, 0, gone)) return false;
    return commit(transaction);
  };
  file_->synchronise(true);
  const bool written = write();
  file_->synchronise(false);
  if (!written) {
    failed("append");
    if (config_.sync_always && !writable_) numbers_are_behind();
    return false;
  }
  flushed();
  for (SampleRow& row : rows) {
    row.row_id = next_row_id_++;
    const StreamKey key{row.device, row.group};
    Stream& stream = streams_[key];
    if (stream.rows == 0) stream.oldest = row.row_id;
    ++stream.rows;
    ++rows_;
    if (hold == Hold::no) continue;
    ++stream.out;
    out_[row.row_id] = {key, row.cost()};
  }
  bytes_ += added;
  forget(gone);
  failpoint("sample_stored");
  return true;
}

bool Store::delete_oldest(std::uint64_t excess, std::int64_t older_than_ms,
                          std::vector<Victim>& gone) {
  std::uint64_t freed = 0;
  Statement& oldest = file_->oldest;
  auto step = oldest.step();
  while (step == Statement::Step::row) {
    // Row ids rise with time, so that the first row that is young enough ends the search.
    if (freed >= excess && oldest.number(3) >= older_than_ms) break;
    Victim victim;
    victim.row_id = from_sql(oldest.number(0));
    victim.stream = {std::string(oldest.text(1)), std::string(oldest.text(2))};
    victim.cost = from_sql(oldest.number(4)) + SampleRow::kOverhead;
    freed += victim.cost;
    gone.push_back(std::move(victim));
    step = oldest.step();
  }
  oldest.reset();
  if (step == Statement::Step::failed) return false;
  return std::all_of(gone.begin(), gone.end(), [this](const Victim& victim) {
    return file_->remove.bind(1, to_sql(victim.row_id)).run();
  });
}

void Store::forget(const std::vector<Victim>& gone) {
  for (const Victim& victim : gone) {
    Stream& stream = streams_[victim.stream];
    if (out_.erase(victim.row_id) > 0) --stream.out;
    --stream.rows;
    stream.oldest = victim.row_id + 1;
    --rows_;
    bytes_ -= victim.cost;
    ++dropped_[victim.stream.first];
  }
}

std::optional<HistoryBatch> Store::next(std::size_t max_payload, const MaySend& may_send) {
  auto oldest = streams_.end();
  for (auto stream = streams_.begin(); stream != streams_.end(); ++stream) {
    if (stream->second.on_the_way || stream->second.rows <= stream->second.out ||
        !may_send(stream->first))
      continue;
    if (oldest == streams_.end() || stream->second.oldest < oldest->second.oldest) oldest = stream;
  }
  if (oldest == streams_.end() || !file_) return std::nullopt;
  const StreamKey key = oldest->first;
  if (writable_) flush();
  if (!file_) return std::nullopt;

  BatchBuilder builder(max_payload);
  std::vector<std::uint64_t> costs;
  std::vector<std::uint64_t> damaged;
  Statement& stream = file_->stream;
  stream.bind(1, key.first).bind(2, key.second);
  auto step = stream.step();
  for (; step == Statement::Step::row; step = stream.step()) {
    const std::uint64_t row_id = from_sql(stream.number(0));
    if (out_.contains(row_id) || removed_.contains(row_id)) continue;
    const std::string_view row = stream.text(1);
    if (!is_intact(row)) {
      out_[row_id] = {key, row.size() + SampleRow::kOverhead};
      damaged.push_back(row_id);
      continue;
    }
    if (!builder.add(row_id, row)) break;
    costs.push_back(row.size() + SampleRow::kOverhead);
  }
  stream.reset();
  if (!damaged.empty()) drop_damaged(key, damaged);
  if (step == Statement::Step::failed) failed("read");
  if (step == Statement::Step::failed || builder.empty()) return std::nullopt;
  HistoryBatch batch = builder.take(key);
  for (std::size_t i = 0; i < batch.row_ids.size(); ++i) out_[batch.row_ids[i]] = {key, costs[i]};
  Stream& taken = streams_[key];
  taken.out += batch.row_ids.size();
  taken.on_the_way = true;
  return batch;
}

void Store::drop_damaged(const StreamKey& stream, const std::vector<std::uint64_t>& row_ids) {
  streams_[stream].out += row_ids.size();
  dropped_[stream.first] += remove(row_ids);
  log::error("store", {{"state", "damaged"},
                       {"device", stream.first},
                       {"group", stream.second},
                       {"rows_dropped", std::to_string(row_ids.size())}});
}

std::uint64_t Store::remove(std::span<const std::uint64_t> row_ids) {
  std::uint64_t count = 0;
  for (const std::uint64_t row_id : row_ids) {
    const auto found = out_.extract(row_id);
    if (found.empty()) continue;
    Stream& stream = streams_[found.mapped().stream];
    --stream.out;
    --stream.rows;
    stream.oldest = std::max(stream.oldest, stream.out == 0 ? row_id + 1 : stream.oldest);
    --rows_;
    bytes_ -= found.mapped().cost;
    removed_.insert(row_id);
    ++count;
  }
  return count;
}

std::uint64_t Store::remove(const HistoryBatch& batch) {
  streams_[{batch.device, batch.group}].on_the_way = false;
  return remove(batch.row_ids);
}

void Store::returned(const HistoryBatch& batch) {
  streams_[{batch.device, batch.group}].on_the_way = false;
  for (const std::uint64_t row_id : batch.row_ids) release(row_id);
}

void Store::release(std::uint64_t row_id) {
  const auto found = out_.extract(row_id);
  if (!found.empty()) --streams_[found.mapped().stream].out;
}

bool Store::has_waiting(const std::string& device) const {
  for (auto stream = streams_.lower_bound({device, {}});
       stream != streams_.end() && stream->first.first == device; ++stream)
    if (stream->second.rows > stream->second.out) return true;
  return false;
}

bool Store::has_waiting(const StreamKey& stream) const {
  const auto found = streams_.find(stream);
  return found != streams_.end() && found->second.rows > found->second.out;
}

bool Store::is_on_the_way(const StreamKey& stream) const {
  const auto found = streams_.find(stream);
  return found != streams_.end() && found->second.on_the_way;
}

bool Store::flush() {
  if (!owes_the_file()) return writable_;
  // Again where a damaged file has made room for a fresh one.
  for (int attempt = 0; attempt < 2 && writable_; ++attempt) {
    if (flush_all()) return true;
    failed("write");
  }
  return false;
}

/// After hours without a disk there may be more than live samples can wait for in one go, or more
/// than has room.
bool Store::flush_all() {
  while (unaudited_.size() > kFlushedAtOnce || unrecorded_.size() > kFlushedAtOnce)
    if (!flush_piece()) return false;
  Transaction transaction(file_->db);
  if (!transaction.begun() || !write_pending() || !commit(transaction)) return false;
  flushed();
  return true;
}

bool Store::flush_piece() {
  const auto bodies = std::next(unaudited_.begin(), piece_of(unaudited_));
  const auto entries = std::next(unrecorded_.begin(), piece_of(unrecorded_));
  Transaction transaction(file_->db);
  if (!transaction.begun()) return false;
  begin_changes();
  const bool written = std::all_of(unaudited_.begin(), bodies,
                                   [this](const std::string& body) { return write_audit(body); }) &&
                       std::all_of(unrecorded_.begin(), entries, [this](const JournalEntry& entry) {
                         return write_entry(entry);
                       });
  if (!written || !commit(transaction)) return false;
  for (auto body = unaudited_.begin(); body != bodies; ++body) unaudited_bytes_ -= body->size();
  for (auto entry = unrecorded_.begin(); entry != entries; ++entry)
    unrecorded_bytes_ -= bytes_of(*entry);
  unaudited_.erase(unaudited_.begin(), bodies);
  unrecorded_.erase(unrecorded_.begin(), entries);
  return true;
}

bool Store::write_pending() {
  begin_changes();
  if (!write_unaudited()) return false;
  for (const std::uint64_t row_id : removed_)
    if (!file_->remove.bind(1, to_sql(row_id)).run()) return false;
  for (const JournalEntry& entry : unrecorded_)
    if (!write_entry(entry)) return false;
  for (const auto& [device, id, command] : to_acknowledge_)
    if (!change_command(device, id, [&, number = command] {
          return file_->acknowledge.bind(1, device).bind(2, id).bind(3, to_sql(number)).run();
        }))
      return false;
  return true;
}

void Store::flushed() {
  removed_.clear();
  to_acknowledge_.clear();
  unrecorded_.clear();
  unrecorded_bytes_ = 0;
  forgot_results_ = false;
  unaudited_.clear();
  unaudited_bytes_ = 0;
  audit_lost_ = 0;
}

void Store::drop_old_rows() { drop_rows(0, utc_ms_ - milliseconds(config_.max_age).count()); }

void Store::drop_excess_rows() {
  if (bytes() > config_.max_bytes) drop_rows(bytes() - config_.max_bytes, 0);
}

void Store::drop_rows(std::uint64_t excess, std::int64_t older_than_ms) {
  if (!writable_ || rows_ == 0) return;
  std::vector<Victim> gone;
  bool done = false;
  {
    Transaction transaction(file_->db);
    done = transaction.begun() && write_pending() && delete_oldest(excess, older_than_ms, gone) &&
           commit(transaction);
  }
  if (!done) return failed("delete");
  flushed();
  forget(gone);
}

}  // namespace fxagent
