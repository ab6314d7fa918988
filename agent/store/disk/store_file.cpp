#include "agent/store/disk/store_file.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <filesystem>
#include <system_error>
#include <thread>

#include "agent/process/port_access.h"
#include "agent/without_signals.h"

namespace fxagent {
namespace {

using std::chrono::milliseconds;

constexpr milliseconds kReaderEnds{500};
constexpr milliseconds kAskAgain{10};
constexpr const char* kLockFile = "/fxagent.lock";
// Passes of one checkpoint. The second is short; usually no commit has come since the first.
constexpr int kPasses = 2;

// The user_version that the first step makes. Agents before 0.1.0 had 1 to 4.
constexpr std::int64_t kFirstVersion = 5;
// `grp` is a group. Rows of a stream are ordered by seq. `payload` holds the command as received
// until there is a result; `format` is always 1. Command numbers (`arrival`) decide which ids are
// the newest: a clock can be set back. Refused commands are kept while there is room.
constexpr const char* kSchema[] = {
    "CREATE TABLE samples(id INTEGER PRIMARY KEY, device TEXT NOT NULL, grp TEXT NOT NULL,"
    " seq INTEGER NOT NULL, created_ms INTEGER NOT NULL, row TEXT NOT NULL,"
    " format INTEGER NOT NULL DEFAULT 0);"
    "CREATE INDEX samples_by_lane ON samples(device, grp, seq, id);"
    "CREATE TABLE devices(name TEXT PRIMARY KEY, last_seq INTEGER NOT NULL,"
    " clean INTEGER NOT NULL) WITHOUT ROWID;"
    "CREATE TABLE orders(device TEXT NOT NULL, id TEXT NOT NULL, received_ms INTEGER NOT NULL,"
    " deadline_ms INTEGER NOT NULL, op TEXT NOT NULL, response_topic TEXT NOT NULL,"
    " correlation BLOB NOT NULL, result TEXT NOT NULL, told INTEGER NOT NULL,"
    " arrival INTEGER NOT NULL DEFAULT 0, payload TEXT NOT NULL DEFAULT '',"
    " refused INTEGER NOT NULL DEFAULT 0, PRIMARY KEY(device, id)) WITHOUT ROWID;"
    "CREATE INDEX orders_by_arrival ON orders(device, arrival DESC, received_ms DESC,"
    " told);"
    "CREATE INDEX orders_refused ON orders(arrival) WHERE refused = 1;"
    "CREATE TABLE audit(n INTEGER PRIMARY KEY, text TEXT NOT NULL, hash BLOB NOT NULL);"
    "CREATE TABLE audit_head(one INTEGER PRIMARY KEY CHECK(one = 1), records INTEGER NOT NULL,"
    " hash BLOB NOT NULL, arrivals INTEGER NOT NULL, bytes INTEGER NOT NULL);"
    "INSERT INTO audit_head VALUES(1, 0, zeroblob(32), 0, 0);"};

/// Opens the file, or creates it (0600). `why` says why it is not open or not ours; empty: it is.
FileHandle open_own(const std::string& path, std::string& why) {
  FileHandle handle(
      ::open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, S_IRUSR | S_IWUSR));
  if (handle >= 0)
    why = why_not_ours(handle, path);
  else
    why = errno == ELOOP ? path + ": it is a symbolic link, which the agent does not follow"
                         : fault_of_system(path);
  return handle;
}

/// Returns why another user could put a file or a link in the place of the store's; empty if none
/// could. A sticky directory prevents it. why_not_ours() rejects files that were there before.
std::string who_else_may_write(const std::string& directory) {
  struct stat found {};
  if (::stat(directory.c_str(), &found) != 0) return fault_of_system(directory);
  if (!S_ISDIR(found.st_mode)) return {};  // opening a file in it reports this
  if (found.st_uid != ::geteuid() && found.st_uid != 0)
    return directory + " belongs to user " + std::to_string(found.st_uid) +
           ", but the agent runs as user " + std::to_string(::geteuid()) +
           ": that user could replace the store's files; chown it to the agent's user";
  if ((found.st_mode & (S_IWGRP | S_IWOTH)) != 0 && (found.st_mode & S_ISVTX) == 0)
    return directory + " can be written by " +
           ((found.st_mode & S_IWOTH) != 0 ? "everybody" : "its group") +
           ", who could replace the store's files; chmod 700 it";
  return {};
}

}  // namespace

std::string fault_of_system(const std::string& what) {
  return what + ": " + std::generic_category().message(errno);
}

bool write_at(int handle, const void* data, std::size_t size, std::size_t at) {
  const auto written = ::pwrite(handle, data, size, static_cast<off_t>(at));
  if (written >= 0 && static_cast<std::size_t>(written) < size) errno = ENOSPC;
  return written == static_cast<ssize_t>(size);
}

std::string why_not_ours(int handle, const std::string& path) {
  struct stat found {};
  if (::fstat(handle, &found) != 0) return fault_of_system(path);
  if (!S_ISREG(found.st_mode)) return path + " is not a regular file";
  if (found.st_uid != ::geteuid())
    return path + " belongs to user " + std::to_string(found.st_uid) + ", not to the agent's";
  if (found.st_nlink > 1) return path + " has a second name (a hard link)";
  return {};
}

FileHandle open_to_read(const std::string& path) {
  // A pipe must not hold up the start.
  FileHandle handle(::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK));
  if (handle >= 0 && !why_not_ours(handle, path).empty()) handle.close();
  return handle;
}

std::optional<FileIdentity> identity_of(const std::string& path) {
  struct stat found {};
  if (::lstat(path.c_str(), &found) != 0) return std::nullopt;
  return FileIdentity{found.st_dev, found.st_ino};
}

std::optional<FileIdentity> identity_of(int handle) {
  struct stat found {};
  if (::fstat(handle, &found) != 0) return std::nullopt;
  return FileIdentity{found.st_dev, found.st_ino};
}

bool lock_within(int handle, milliseconds patience) {
  const auto give_up = std::chrono::steady_clock::now() + patience;
  while (::flock(handle, LOCK_EX | LOCK_NB) != 0) {
    if (errno != EWOULDBLOCK || std::chrono::steady_clock::now() >= give_up) return false;
    std::this_thread::sleep_for(kAskAgain);
  }
  return true;
}

DirectoryLock::DirectoryLock(const std::string& directory, milliseconds patience)
    : path_(directory + kLockFile) {
  handle_ = open_own(path_, fault_);
  if (handle_ < 0) {
    handle_ = open_to_read(path_);
    if (handle_ >= 0) fault_.clear();
  }
  if (!fault_.empty() || lock_within(handle_, patience)) return;
  is_in_use_ = errno == EWOULDBLOCK;
  fault_ = is_in_use_ ? in_use(directory, path_) : fault_of_system(path_);
}

std::string in_use(const std::string& directory, const std::string& locked) {
  const auto holder = file_holder(locked);
  return directory + " is in use by a running fxagent" +
         (holder ? " (" + holder->text() + ")" : std::string()) +
         ": stop it, or give each agent its own directory";
}

std::string refused_in_use(const std::string& directory, milliseconds patience) {
  const std::string path = directory + kLockFile;
  const FileHandle file(::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK));
  struct stat owned {};
  struct stat found {};
  // A third user who may write in the directory must not keep the agent from starting.
  if (::stat(directory.c_str(), &owned) != 0 || ::fstat(file, &found) != 0 ||
      found.st_uid != owned.st_uid)
    return {};
  return lock_within(file, patience) || errno != EWOULDBLOCK ? "" : in_use(directory, path);
}

std::string store_file_path(const std::string& directory) {
  return (std::filesystem::path(directory) / "fxagent.db").string();
}

std::string make_store_directory(const std::string& directory) {
  std::error_code fault;
  if (!std::filesystem::exists(directory, fault)) {
    std::filesystem::create_directories(directory, fault);
    if (fault) return directory + ": " + fault.message();
    ::chmod(directory.c_str(), S_IRWXU);
  }
  return who_else_may_write(directory);
}

std::string make_store_file(const std::string& directory) {
  std::string why = make_store_directory(directory);
  if (!why.empty()) return why;
  const std::string file = store_file_path(directory);
  const FileHandle handle = open_own(file, why);
  if (why.empty()) ::fchmod(handle, S_IRUSR | S_IWUSR);
  return why;
}

Checkpointer::Checkpointer(SQLite::Database& writer, const std::string& path)
    : writer_(writer), own_(sqlite::open(path)) {
  // Opens the WAL now: later, other files may have replaced these.
  own_.tryExec("PRAGMA schema_version");
  const WithoutSignals quiet;
  thread_ = std::jthread([this](const std::stop_token& stop) { run(stop); });
  // SQLiteCpp has neither this hook nor a checkpoint that reports its progress.
  sqlite3_wal_hook(writer_.getHandle(), committed, this);
}

Checkpointer::~Checkpointer() { sqlite3_wal_hook(writer_.getHandle(), nullptr, nullptr); }

/// SQLite calls this after each commit. A checkpoint's result is ignored: the pages are safe in the
/// WAL, and a later commit tries again.
int Checkpointer::committed(void* self, sqlite3* writer, const char* schema, int pages) noexcept {
  auto& checkpointer = *static_cast<Checkpointer*>(self);
  if (pages < kPages) {
    checkpointer.copied_ = 0;  // the WAL has started over
  } else if (pages >= kMostPages) {
    const std::lock_guard alone(checkpointer.working_);
    sqlite3_wal_checkpoint_v2(writer, schema, SQLITE_CHECKPOINT_PASSIVE, nullptr, nullptr);
  } else if (pages - checkpointer.copied_ >= kPages) {
    const std::lock_guard lock(checkpointer.mutex_);
    checkpointer.due_ = true;
    checkpointer.news_.notify_one();
  }
  return SQLITE_OK;
}

void Checkpointer::run(const std::stop_token& stop) {
  std::unique_lock lock(mutex_);
  while (news_.wait(lock, stop, [this] { return due_; })) {
    due_ = false;
    lock.unlock();
    bring_home();
    lock.lock();
  }
}

void Checkpointer::bring_home() {
  const std::lock_guard alone(working_);
  int pages = 0;
  int home = -1;
  for (int pass = 0; pass < kPasses && home < pages; ++pass)
    if (sqlite3_wal_checkpoint_v2(own_.getHandle(), nullptr, SQLITE_CHECKPOINT_PASSIVE, &pages,
                                  &home) != SQLITE_OK)
      return;
  copied_ = home;
}

StoreFile::StoreFile(const std::string& path, bool always)
    : db(sqlite::open(path)), path_(path), always_(always) {
  db.setBusyTimeout(static_cast<int>(kReaderEnds.count()));
  db.exec("PRAGMA journal_mode = WAL");
  db.exec(always ? "PRAGMA synchronous = FULL" : "PRAGMA synchronous = NORMAL");
  sqlite::migrate(db, kFirstVersion, kSchema);
  sqlite::check_schema(db, kFirstVersion, kSchema);
  file_ = identity_of(path);
  log_ = identity_of(path + "-wal");
  try {
    checkpointer_.emplace(db, path);
  } catch (const std::system_error&) {
    // Without a thread, checkpoints stay where SQLite runs them: at the commits.
  } catch (const SQLite::Exception&) {
    // Same without a second connection.
  }
}

void StoreFile::synchronise(bool full) {
  if (!always_) db.tryExec(full ? "PRAGMA synchronous = FULL" : "PRAGMA synchronous = NORMAL");
}

bool StoreFile::is_in_place() const {
  return has_its_name() && log_ && identity_of(path_ + "-wal") == log_;
}

std::optional<sqlite::Fault> StoreFile::why_not_writable() {
  // The WAL may have filled the disk while a reader held its checkpoint back.
  db.tryExec("PRAGMA wal_checkpoint(PASSIVE)");
  return sqlite::attempt([this] {
    SQLite::Transaction transaction(db, SQLite::TransactionBehavior::IMMEDIATE);
    db.exec(
        "INSERT INTO samples VALUES(0, '', '', 0, 0, zeroblob(65536), 0);"
        "DELETE FROM samples WHERE id = 0");
    transaction.commit();
  });
}

}  // namespace fxagent
