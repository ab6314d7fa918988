#include "agent/uplink/store.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <system_error>

#include "agent/log.h"
#include "agent/uplink/json.h"
#include "agent/uplink/sqlite.h"

namespace fxagent {
namespace {

using sqlite::Statement;
using sqlite::Transaction;
using std::chrono::milliseconds;
using std::chrono::seconds;

constexpr milliseconds kSettleEvery{200};
constexpr seconds kCleanUpEvery{60};
constexpr std::size_t kMostUnrecorded = 10000;
constexpr int kBusyMs = 500;  // a process that is just ending may still hold the file

// Step i leads from user_version i to i + 1. `grp` is a group; the order of a lane is that of seq.
constexpr const char* kSchema[] = {
    "CREATE TABLE samples(id INTEGER PRIMARY KEY, device TEXT NOT NULL, grp TEXT NOT NULL,"
    " seq INTEGER NOT NULL, created_ms INTEGER NOT NULL, row TEXT NOT NULL);"
    "CREATE INDEX samples_by_lane ON samples(device, grp, seq, id);"
    "CREATE TABLE devices(name TEXT PRIMARY KEY, last_seq INTEGER NOT NULL,"
    " clean INTEGER NOT NULL) WITHOUT ROWID;"
    "CREATE TABLE orders(device TEXT NOT NULL, id TEXT NOT NULL, received_ms INTEGER NOT NULL,"
    " deadline_ms INTEGER NOT NULL, op TEXT NOT NULL, response_topic TEXT NOT NULL,"
    " correlation BLOB NOT NULL, result TEXT NOT NULL, told INTEGER NOT NULL,"
    " PRIMARY KEY(device, id)) WITHOUT ROWID;"
    "CREATE INDEX orders_by_age ON orders(device, received_ms);"};

/// The codes after which the file is not to be trusted any more; SQLITE_SCHEMA: a newer program's,
/// or not what ours makes, as where the file was cut short.
bool is_damage(int code) {
  return code == SQLITE_CORRUPT || code == SQLITE_NOTADB || code == SQLITE_SCHEMA;
}

/// Beside that a schema that cannot be made, since something of that name is there: SQLITE_ERROR.
bool is_damage_at_open(int code) { return is_damage(code) || code == SQLITE_ERROR; }

std::int64_t to_sql(std::uint64_t number) { return static_cast<std::int64_t>(number); }
std::uint64_t from_sql(std::int64_t number) { return static_cast<std::uint64_t>(number); }

/// Makes the directory (0700) and the file (0600) where they are not there. Empty: done.
std::string make_file(const std::filesystem::path& directory, const std::filesystem::path& file) {
  std::error_code fault;
  if (!std::filesystem::exists(directory, fault)) {
    std::filesystem::create_directories(directory, fault);
    if (fault) return directory.string() + ": " + fault.message();
    ::chmod(directory.c_str(), S_IRWXU);
  }
  const int handle = ::open(file.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, S_IRUSR | S_IWUSR);
  if (handle < 0) return file.string() + ": " + std::strerror(errno);
  ::fchmod(handle, S_IRUSR | S_IWUSR);
  ::close(handle);
  return {};
}

}  // namespace

/// The open file and its statements, which are prepared once.
class Store::File final {
 public:
  File(const std::string& path, bool always) : db(path), always_(always) {
    if (!db.is_open()) return;
    sqlite3_busy_timeout(db.handle(), kBusyMs);
    // Exclusive: two agents with one store would publish and journal for each other.
    usable_ = db.execute("PRAGMA locking_mode = EXCLUSIVE; PRAGMA journal_mode = WAL;") &&
              db.execute(always ? "PRAGMA synchronous = FULL" : "PRAGMA synchronous = NORMAL") &&
              sqlite::migrate(db, kSchema) && sqlite::has_schema(db, kSchema);
    if (!usable_) return;
    insert = {db, "INSERT INTO samples VALUES(?, ?, ?, ?, ?, ?)"};
    remove = {db, "DELETE FROM samples WHERE id = ?"};
    lane = {db, "SELECT id, row FROM samples WHERE device = ? AND grp = ? ORDER BY seq, id"};
    oldest = {db,
              "SELECT id, device, grp, created_ms, length(CAST(row AS BLOB)) FROM samples"
              " ORDER BY id"};
    order = {db, "INSERT OR IGNORE INTO orders VALUES(?, ?, ?, ?, ?, ?, ?, '', 0)"};
    record = {db,
              "INSERT INTO orders VALUES(?, ?, ?, ?, ?, ?, ?, ?, 0)"
              " ON CONFLICT DO UPDATE SET result = excluded.result WHERE result = ''"};
    told = {db, "UPDATE orders SET told = 1 WHERE device = ? AND id = ?"};
    numbers = {db, "INSERT OR REPLACE INTO devices VALUES(?, ?, ?)"};
  }

  bool is_usable() const { return usable_; }

  /// Samples are synchronised with the disk even where orders are not: a power cut loses none that
  /// counts as stored. With `always` everything is.
  void synchronise(bool full) {
    if (!always_) db.execute(full ? "PRAGMA synchronous = FULL" : "PRAGMA synchronous = NORMAL");
  }

  /// Whether there is room for a message more.
  bool can_write() {
    Transaction transaction(db);
    return transaction.begun() &&
           db.execute(
               "INSERT INTO samples VALUES(0, '', '', 0, 0, zeroblob(65536));"
               "DELETE FROM samples WHERE id = 0") &&
           transaction.commit();
  }

  sqlite::Database db;
  Statement insert;
  Statement remove;
  Statement lane;
  Statement oldest;
  Statement order;
  Statement record;
  Statement told;
  Statement numbers;

 private:
  const bool always_;
  bool usable_ = false;
};

Store::Store(const StoreConfig& config, std::int64_t utc_ms) : config_(config), utc_ms_(utc_ms) {
  open(utc_ms);
  recovered_ = rows_;
  if (writable_)
    log::info("store", {{"state", "disk"},
                        {"path", config_.path},
                        {"rows", std::to_string(rows_)},
                        {"bytes", std::to_string(bytes_)}});
}

Store::~Store() = default;

void Store::open(std::int64_t utc_ms) {
  utc_ms_ = utc_ms;
  const std::filesystem::path directory(config_.path);
  const std::filesystem::path path = directory / "fxagent.db";
  // A second time, after a damaged file was set aside.
  for (int attempt = 0; attempt < 2 && !writable_; ++attempt) {
    const std::string why = make_file(directory, path);
    if (!why.empty()) {
      if (why != last_failure_) log::error("store", {{"state", "memory"}, {"reason", why}});
      last_failure_ = why;
      return;
    }
    file_ = std::make_unique<File>(path.string(), config_.sync_always);
    if (file_->is_usable() && load()) {
      writable_ = true;
    } else if (is_damage_at_open(file_->db.fault().code) && attempt == 0) {
      start_anew(file_->db.fault().text);
    } else {
      failed("open");
      file_.reset();
      return;
    }
  }
}

bool Store::load() {
  lanes_.clear();
  out_.clear();
  removed_.clear();
  rows_ = 0;
  bytes_ = 0;
  file_->db.clear_fault();
  Statement sums(file_->db,
                 "SELECT device, grp, count(*), sum(length(CAST(row AS BLOB))), min(id), max(id)"
                 " FROM samples GROUP BY device, grp");
  while (sums.step() == Statement::Step::row) {
    Lane& lane = lanes_[{std::string(sums.text(0)), std::string(sums.text(1))}];
    lane.rows = from_sql(sums.number(2));
    lane.oldest = from_sql(sums.number(4));
    rows_ += lane.rows;
    bytes_ += from_sql(sums.number(3)) + lane.rows * SampleRow::kOverhead;
    next_order_ = std::max(next_order_, from_sql(sums.number(5)) + 1);
  }
  return file_->db.fault().code == SQLITE_OK;
}

/// `why` is a value: what the file has said goes with it.
void Store::start_anew(std::string why) {
  file_.reset();
  writable_ = false;
  const std::filesystem::path path = std::filesystem::path(config_.path) / "fxagent.db";
  const std::string aside = path.string() + ".corrupt-" + std::to_string(utc_ms_);
  std::error_code fault;
  std::filesystem::rename(path, aside, fault);
  for (const char* suffix : {"-wal", "-shm"}) {
    std::error_code none;
    std::filesystem::rename(path.string() + suffix, aside + suffix, none);
  }
  log::error("store", {{"state", "damaged"},
                       {"reason", std::move(why)},
                       {"set_aside", fault ? "failed: " + fault.message() : aside},
                       {"samples_lost", std::to_string(rows_)}});
  for (const auto& [key, lane] : lanes_)
    if (lane.rows > 0) dropped_[key.first] += lane.rows;
  lanes_.clear();
  out_.clear();
  removed_.clear();
  untold_.clear();
  rows_ = 0;
  bytes_ = 0;
}

void Store::failed(std::string_view doing) {
  const sqlite::Fault fault = file_->db.fault();
  if (is_damage(fault.code) && writable_) {
    start_anew(fault.text);
    open(utc_ms_);
    write_all_numbers();
    return;
  }
  const std::string why = std::string(doing) + ": " + fault.text;
  if (writable_ || why != last_failure_)
    log::error("store", {{"state", "memory"}, {"path", config_.path}, {"reason", why}});
  last_failure_ = why;
  writable_ = false;
}

void Store::upkeep(SteadyTime now, std::int64_t utc_ms) {
  utc_ms_ = utc_ms;
  if (!writable_) {
    if (!try_at_) try_at_ = now + kTryAgain;
    if (now < *try_at_) return;
    try_at_ = now + kTryAgain;
    if (!file_) {
      open(utc_ms);
      recovered_ += rows_;
    } else if (file_->can_write()) {
      writable_ = true;
    } else {
      failed("write");
    }
    write_all_numbers();
    if (!settle()) return;
    last_failure_.clear();
    log::info("store", {{"state", "disk"}, {"rows", std::to_string(rows_)}});
  }
  try_at_.reset();
  if (!settle_at_ || now >= *settle_at_) {
    settle_at_ = now + kSettleEvery;
    settle();
  }
  if (!clean_up_at_ || now >= *clean_up_at_) {
    clean_up_at_ = now + kCleanUpEvery;
    drop_old_rows();
    drop_old_ids();
  }
}

void Store::close() {
  if (!writable_) return;
  settle();
  for (const auto& [device, numbers] : numbers_)
    if (writable_) write_numbers(device, numbers.last, true);
  if (writable_) file_->db.execute("PRAGMA wal_checkpoint(TRUNCATE)");
  file_.reset();
  writable_ = false;
}

// ---- samples ------------------------------------------------------------------------------------

bool Store::append(std::vector<SampleRow>& rows, Hold hold) {
  if (!writable_ || rows.empty()) return writable_;
  std::uint64_t added = 0;
  std::vector<Victim> gone;
  std::map<std::string, std::uint64_t> last;
  const auto write = [&] {
    Transaction transaction(file_->db);
    if (!transaction.begun() || !write_settled()) return false;
    std::uint64_t order = next_order_;
    for (const SampleRow& row : rows) {
      added += row.cost();
      last[row.device] = std::max(last[row.device], row.seq);
      if (!file_->insert.bind(1, to_sql(order++))
               .bind(2, row.device)
               .bind(3, row.group)
               .bind(4, to_sql(row.seq))
               .bind(5, row.created_ms)
               .bind(6, row.json)
               .run())
        return false;
    }
    if (config_.sync_always)
      for (const auto& [device, seq] : last)
        if (!file_->numbers.bind(1, device).bind(2, to_sql(seq)).bind(3, 0).run()) return false;
    const std::uint64_t full = bytes_ + added;
    if (full > config_.max_bytes && !delete_oldest(full - config_.max_bytes, 0, gone)) return false;
    return transaction.commit();
  };
  file_->synchronise(true);
  const bool written = write();
  file_->synchronise(false);
  if (!written) {
    failed("append");
    return false;
  }
  removed_.clear();
  untold_.clear();
  unrecorded_.clear();
  for (SampleRow& row : rows) {
    row.order = next_order_++;
    const LaneKey key{row.device, row.group};
    Lane& lane = lanes_[key];
    if (lane.rows == 0) lane.oldest = row.order;
    ++lane.rows;
    ++rows_;
    if (hold == Hold::no) continue;
    ++lane.out;
    out_[row.order] = {key, row.cost()};
  }
  bytes_ += added;
  forget(gone);
  return true;
}

bool Store::delete_oldest(std::uint64_t excess, std::int64_t older_than_ms,
                          std::vector<Victim>& gone) {
  std::uint64_t freed = 0;
  Statement& oldest = file_->oldest;
  auto step = oldest.step();
  while (step == Statement::Step::row) {
    // Orders rise with time, so that the first row that is young enough ends the search.
    if (freed >= excess && oldest.number(3) >= older_than_ms) break;
    Victim victim;
    victim.order = from_sql(oldest.number(0));
    victim.lane = {std::string(oldest.text(1)), std::string(oldest.text(2))};
    victim.cost = from_sql(oldest.number(4)) + SampleRow::kOverhead;
    freed += victim.cost;
    gone.push_back(std::move(victim));
    step = oldest.step();
  }
  oldest.reset();
  if (step == Statement::Step::failed) return false;
  return std::all_of(gone.begin(), gone.end(), [this](const Victim& victim) {
    return file_->remove.bind(1, to_sql(victim.order)).run();
  });
}

void Store::forget(const std::vector<Victim>& gone) {
  for (const Victim& victim : gone) {
    Lane& lane = lanes_[victim.lane];
    if (out_.erase(victim.order) > 0) --lane.out;
    --lane.rows;
    lane.oldest = victim.order + 1;
    --rows_;
    bytes_ -= victim.cost;
    ++dropped_[victim.lane.first];
  }
}

std::optional<HistoryBatch> Store::next(std::size_t max_payload, const MaySend& may_send) {
  auto oldest = lanes_.end();
  for (auto lane = lanes_.begin(); lane != lanes_.end(); ++lane) {
    if (lane->second.on_the_way || lane->second.rows <= lane->second.out || !may_send(lane->first))
      continue;
    if (oldest == lanes_.end() || lane->second.oldest < oldest->second.oldest) oldest = lane;
  }
  if (oldest == lanes_.end() || !file_) return std::nullopt;
  const LaneKey key = oldest->first;
  if (writable_) settle();
  if (!file_) return std::nullopt;

  BatchBuilder builder(max_payload);
  std::vector<std::uint64_t> costs;
  std::vector<std::uint64_t> damaged;
  Statement& lane = file_->lane;
  lane.bind(1, key.first).bind(2, key.second);
  auto step = lane.step();
  for (; step == Statement::Step::row; step = lane.step()) {
    const std::uint64_t order = from_sql(lane.number(0));
    if (out_.contains(order) || removed_.contains(order)) continue;
    const std::string_view row = lane.text(1);
    if (!json::is_intact(row)) {
      out_[order] = {key, row.size() + SampleRow::kOverhead};
      damaged.push_back(order);
      continue;
    }
    if (!builder.add(order, row)) break;
    costs.push_back(row.size() + SampleRow::kOverhead);
  }
  lane.reset();
  if (!damaged.empty()) drop_damaged(key, damaged);
  if (step == Statement::Step::failed) failed("read");
  if (step == Statement::Step::failed || builder.empty()) return std::nullopt;
  HistoryBatch batch = builder.take(key);
  for (std::size_t i = 0; i < batch.orders.size(); ++i) out_[batch.orders[i]] = {key, costs[i]};
  Lane& taken = lanes_[key];
  taken.out += batch.orders.size();
  taken.on_the_way = true;
  return batch;
}

void Store::drop_damaged(const LaneKey& lane, const std::vector<std::uint64_t>& orders) {
  lanes_[lane].out += orders.size();
  dropped_[lane.first] += remove(orders);
  log::error("store", {{"state", "damaged"},
                       {"device", lane.first},
                       {"group", lane.second},
                       {"rows_dropped", std::to_string(orders.size())}});
}

std::uint64_t Store::remove(std::span<const std::uint64_t> orders) {
  std::uint64_t count = 0;
  for (const std::uint64_t order : orders) {
    const auto found = out_.extract(order);
    if (found.empty()) continue;
    Lane& lane = lanes_[found.mapped().lane];
    --lane.out;
    --lane.rows;
    lane.oldest = std::max(lane.oldest, lane.out == 0 ? order + 1 : lane.oldest);
    --rows_;
    bytes_ -= found.mapped().cost;
    removed_.insert(order);
    ++count;
  }
  return count;
}

std::uint64_t Store::remove(const HistoryBatch& batch) {
  lanes_[{batch.device, batch.group}].on_the_way = false;
  return remove(batch.orders);
}

void Store::returned(const HistoryBatch& batch) {
  lanes_[{batch.device, batch.group}].on_the_way = false;
  for (const std::uint64_t order : batch.orders) release(order);
}

void Store::release(std::uint64_t order) {
  const auto found = out_.extract(order);
  if (!found.empty()) --lanes_[found.mapped().lane].out;
}

bool Store::has_waiting(const std::string& device) const {
  for (auto lane = lanes_.lower_bound({device, {}});
       lane != lanes_.end() && lane->first.first == device; ++lane)
    if (lane->second.rows > lane->second.out) return true;
  return false;
}

bool Store::has_waiting(const LaneKey& lane) const {
  const auto found = lanes_.find(lane);
  return found != lanes_.end() && found->second.rows > found->second.out;
}

bool Store::is_on_the_way(const LaneKey& lane) const {
  const auto found = lanes_.find(lane);
  return found != lanes_.end() && found->second.on_the_way;
}

bool Store::settle() {
  if (removed_.empty() && untold_.empty() && unrecorded_.empty()) return writable_;
  if (!writable_) return false;
  {
    Transaction transaction(file_->db);
    if (transaction.begun() && write_settled() && transaction.commit()) {
      removed_.clear();
      untold_.clear();
      unrecorded_.clear();
      return true;
    }
  }
  failed("delete");
  return false;
}

bool Store::write_settled() {
  for (const std::uint64_t order : removed_)
    if (!file_->remove.bind(1, to_sql(order)).run()) return false;
  for (const JournalEntry& entry : unrecorded_)
    if (!write_record(entry)) return false;
  for (const auto& [device, id] : untold_)
    if (!file_->told.bind(1, device).bind(2, id).run()) return false;
  return true;
}

void Store::drop_old_rows() {
  if (!writable_ || rows_ == 0) return;
  const std::int64_t limit = utc_ms_ - milliseconds(config_.max_age).count();
  std::vector<Victim> gone;
  bool done = false;
  {
    Transaction transaction(file_->db);
    done = transaction.begun() && write_settled() && delete_oldest(0, limit, gone) &&
           transaction.commit();
  }
  if (!done) return failed("delete");
  removed_.clear();
  untold_.clear();
  unrecorded_.clear();
  forget(gone);
}

// ---- numbers ------------------------------------------------------------------------------------

std::uint64_t Store::last_seq(const std::string& device, std::int64_t utc_ms) {
  // Where nothing is known, the clock is above every number of an earlier boot.
  std::uint64_t last = from_sql(utc_ms);
  if (file_) {
    Statement known(file_->db, "SELECT last_seq, clean FROM devices WHERE name = ?");
    if (known.bind(1, device).step() == Statement::Step::row) {
      const std::uint64_t written = from_sql(known.number(0));
      const bool exact = known.number(1) != 0 || config_.sync_always;
      last = exact ? written : std::max(last, written);
    }
  }
  Numbers& numbers = numbers_[device];
  numbers.last = last;
  numbers.reserved = config_.sync_always ? last : last + kSequenceBlock;
  write_numbers(device, numbers.reserved, false);
  return last;
}

void Store::used_seq(const std::string& device, std::uint64_t seq) {
  Numbers& numbers = numbers_[device];
  numbers.last = std::max(numbers.last, seq);
  // With `always` each sample brings its number to the disk itself.
  if (config_.sync_always || seq + kSequenceBlock / 2 <= numbers.reserved) return;
  numbers.reserved = seq + kSequenceBlock;
  write_numbers(device, numbers.reserved, false);
}

bool Store::write_numbers(const std::string& device, std::uint64_t last, bool clean) {
  if (!writable_) return false;
  if (file_->numbers.bind(1, device).bind(2, to_sql(last)).bind(3, clean ? 1 : 0).run())
    return true;
  failed("numbers");
  return false;
}

void Store::write_all_numbers() {
  for (const auto& [device, numbers] : numbers_)
    write_numbers(device, config_.sync_always ? numbers.last : numbers.reserved, false);
}

// ---- orders -------------------------------------------------------------------------------------

bool Store::journal(std::span<const JournalEntry> orders) {
  if (!writable_) return false;
  {
    Transaction transaction(file_->db);
    const bool written = transaction.begun() &&
                         std::all_of(orders.begin(), orders.end(), [this](const JournalEntry& e) {
                           return file_->order.bind(1, e.device)
                               .bind(2, e.id)
                               .bind(3, e.received_ms)
                               .bind(4, e.deadline_ms)
                               .bind(5, e.op)
                               .bind(6, e.response_topic)
                               .bind(7, ByteView(e.correlation))
                               .run();
                         });
    if (written && transaction.commit()) return true;
  }
  failed("journal");
  return false;
}

void Store::record(JournalEntry entry) {
  if (writable_ && write_record(entry)) return;
  if (writable_) failed("journal");
  if (unrecorded_.size() < kMostUnrecorded) unrecorded_.push_back(std::move(entry));
}

bool Store::write_record(const JournalEntry& entry) {
  return file_->record.bind(1, entry.device)
      .bind(2, entry.id)
      .bind(3, entry.received_ms)
      .bind(4, entry.deadline_ms)
      .bind(5, entry.op)
      .bind(6, entry.response_topic)
      .bind(7, ByteView(entry.correlation))
      .bind(8, entry.result)
      .run();
}

void Store::told(const std::string& device, const std::string& id) {
  if (untold_.size() < kMostUnrecorded) untold_.emplace_back(device, id);
}

std::vector<JournalEntry> Store::remembered() {
  std::vector<JournalEntry> entries;
  if (!file_) return entries;
  Statement all(
      file_->db,
      "SELECT device, id, received_ms, deadline_ms, op, response_topic, correlation, result, told"
      " FROM (SELECT *, row_number() OVER (PARTITION BY device ORDER BY received_ms DESC) AS place"
      " FROM orders) WHERE place <= ? OR result = '' ORDER BY received_ms");
  all.bind(1, static_cast<std::int64_t>(kRememberedIds));
  auto step = all.step();
  for (; step == Statement::Step::row; step = all.step()) {
    JournalEntry entry;
    entry.device = all.text(0);
    entry.id = all.text(1);
    entry.received_ms = all.number(2);
    entry.deadline_ms = all.number(3);
    entry.op = all.text(4);
    entry.response_topic = all.text(5);
    const ByteView correlation = all.bytes(6);
    entry.correlation.assign(correlation.begin(), correlation.end());
    entry.result = all.text(7);
    entry.told = all.number(8) != 0;
    entries.push_back(std::move(entry));
  }
  if (step == Statement::Step::failed) failed("read");
  return entries;
}

void Store::drop_old_ids() {
  if (!writable_) return;
  const std::int64_t day = milliseconds(kRememberedFor).count();
  const std::int64_t age = std::max(day, milliseconds(config_.max_age).count());
  // What nobody could be told is kept as long as a sample is.
  Statement old(file_->db,
                "DELETE FROM orders WHERE deadline_ms < ?1"
                " AND (told = 1 AND received_ms < ?2 OR received_ms < ?3)");
  Statement many(file_->db,
                 "DELETE FROM orders WHERE told = 1 AND deadline_ms < ?1 AND (device, id) IN"
                 " (SELECT device, id FROM (SELECT device, id, row_number() OVER"
                 " (PARTITION BY device ORDER BY received_ms DESC) AS place FROM orders)"
                 " WHERE place > ?2)");
  const bool done = old.bind(1, utc_ms_).bind(2, utc_ms_ - day).bind(3, utc_ms_ - age).run() &&
                    many.bind(1, utc_ms_).bind(2, std::int64_t{kRememberedIds}).run();
  if (!done) failed("delete");
}

}  // namespace fxagent
