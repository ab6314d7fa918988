#include "agent/uplink/store_file.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <cstring>
#include <filesystem>
#include <system_error>
#include <thread>

namespace fxagent {
namespace {

using sqlite::Transaction;
using std::chrono::milliseconds;

constexpr milliseconds kPatience{500};
constexpr milliseconds kAskAgain{10};

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
    "CREATE INDEX orders_by_age ON orders(device, received_ms);",
    // `payload` is the command as it came, until there is a result.
    "ALTER TABLE orders ADD COLUMN arrival INTEGER NOT NULL DEFAULT 0;"
    "ALTER TABLE orders ADD COLUMN payload TEXT NOT NULL DEFAULT '';"
    "CREATE TABLE audit(n INTEGER PRIMARY KEY, text TEXT NOT NULL, hash BLOB NOT NULL);"
    "CREATE TABLE audit_head(one INTEGER PRIMARY KEY CHECK(one = 1), records INTEGER NOT NULL,"
    " hash BLOB NOT NULL, arrivals INTEGER NOT NULL, bytes INTEGER NOT NULL);"
    "INSERT INTO audit_head VALUES(1, 0, zeroblob(32), 0, 0);",
    // Which ids are the newest is told by the numbers of their commands: a clock can be set back.
    "DROP INDEX orders_by_age;"
    "CREATE INDEX orders_by_arrival ON orders(device, arrival DESC, received_ms DESC,"
    " told);"};

}  // namespace

DirectoryLock::DirectoryLock(const std::string& directory) {
  const std::string path = directory + "/fxagent.lock";
  handle_ = ::open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, S_IRUSR | S_IWUSR);
  if (handle_ < 0) {
    fault_ = path + ": " + std::strerror(errno);
    return;
  }
  const auto give_up = std::chrono::steady_clock::now() + kPatience;
  while (::flock(handle_, LOCK_EX | LOCK_NB) != 0) {
    if (errno != EWOULDBLOCK || std::chrono::steady_clock::now() >= give_up) {
      fault_ = errno == EWOULDBLOCK ? directory + " is another agent's"
                                    : path + ": " + std::strerror(errno);
      return;
    }
    std::this_thread::sleep_for(kAskAgain);
  }
}

DirectoryLock::~DirectoryLock() {
  if (handle_ >= 0) ::close(handle_);
}

std::string store_file_path(const std::string& directory) {
  return (std::filesystem::path(directory) / "fxagent.db").string();
}

std::string make_store_file(const std::string& directory) {
  std::error_code fault;
  if (!std::filesystem::exists(directory, fault)) {
    std::filesystem::create_directories(directory, fault);
    if (fault) return directory + ": " + fault.message();
    ::chmod(directory.c_str(), S_IRWXU);
  }
  const std::string file = store_file_path(directory);
  const int handle = ::open(file.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, S_IRUSR | S_IWUSR);
  if (handle < 0) return file + ": " + std::strerror(errno);
  ::fchmod(handle, S_IRUSR | S_IWUSR);
  ::close(handle);
  return {};
}

StoreFile::StoreFile(const std::string& path, bool always) : db(path), always_(always) {
  if (!db.is_open()) return;
  sqlite3_busy_timeout(db.handle(), static_cast<int>(kPatience.count()));
  usable_ = db.execute("PRAGMA journal_mode = WAL") &&
            db.execute(always ? "PRAGMA synchronous = FULL" : "PRAGMA synchronous = NORMAL") &&
            sqlite::migrate(db, kSchema) && sqlite::has_schema(db, kSchema);
  if (!usable_) return;
  insert = {db, "INSERT INTO samples VALUES(?, ?, ?, ?, ?, ?)"};
  remove = {db, "DELETE FROM samples WHERE id = ?"};
  lane = {db, "SELECT id, row FROM samples WHERE device = ? AND grp = ? ORDER BY seq, id"};
  oldest = {db,
            "SELECT id, device, grp, created_ms, length(CAST(row AS BLOB)) FROM samples"
            " ORDER BY id"};
  // A row makes room for a later command: the field did not know that id when it took this one. It
  // had let go of it, or the file opened late.
  order = {db,
           "INSERT INTO orders VALUES(?, ?, ?, ?, ?, ?, ?, '', 0, ?, ?)"
           " ON CONFLICT DO UPDATE SET received_ms = excluded.received_ms,"
           " deadline_ms = excluded.deadline_ms, op = excluded.op,"
           " response_topic = excluded.response_topic, correlation = excluded.correlation,"
           " result = '', told = 0, arrival = excluded.arrival, payload = excluded.payload"
           " WHERE arrival < excluded.arrival"};
  record = {db,
            "INSERT INTO orders VALUES(?, ?, ?, ?, ?, ?, ?, ?, 0, ?, '')"
            " ON CONFLICT DO UPDATE SET"
            " received_ms = iif(arrival = excluded.arrival, received_ms, excluded.received_ms),"
            " deadline_ms = max(deadline_ms, excluded.deadline_ms), op = excluded.op,"
            " response_topic = iif(arrival = excluded.arrival, response_topic,"
            " excluded.response_topic),"
            " correlation = iif(arrival = excluded.arrival, correlation, excluded.correlation),"
            " result = excluded.result, told = 0, arrival = excluded.arrival, payload = ''"
            " WHERE iif(result = '', arrival <= excluded.arrival, arrival < excluded.arrival)"};
  told = {db,
          "UPDATE orders SET told = 1, response_topic = '', correlation = x''"
          " WHERE device = ? AND id = ? AND arrival = ?"};
  // A number goes back only to the exact one, from the end of its block.
  numbers = {db,
             "INSERT INTO devices VALUES(?, ?, ?) ON CONFLICT DO UPDATE SET last_seq ="
             " CASE excluded.clean WHEN 1 THEN excluded.last_seq"
             " ELSE max(last_seq, excluded.last_seq) END, clean = excluded.clean"};
  trail = AuditTrail(db);
  try {
    checkpointer_.emplace(db, path);
  } catch (const std::system_error&) {
    // Without a thread the checkpoints stay where SQLite has them: at the commits.
  }
}

void StoreFile::synchronise(bool full) {
  if (!always_) db.execute(full ? "PRAGMA synchronous = FULL" : "PRAGMA synchronous = NORMAL");
}

bool StoreFile::can_write() {
  // What filled the disk may be the log, where a reader held it back.
  db.execute("PRAGMA wal_checkpoint(PASSIVE)");
  Transaction transaction(db);
  return transaction.begun() &&
         db.execute(
             "INSERT INTO samples VALUES(0, '', '', 0, 0, zeroblob(65536));"
             "DELETE FROM samples WHERE id = 0") &&
         transaction.commit();
}

}  // namespace fxagent
