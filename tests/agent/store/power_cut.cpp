#include "tests/agent/store/power_cut.h"

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <limits>
#include <stdexcept>

namespace fxagent::test {
namespace {

constexpr std::int64_t kToEnd = std::numeric_limits<std::int64_t>::max();

PowerCut* disk = nullptr;

/// SQLite's record of an open file, followed by that of the file system.
struct Layered {
  sqlite3_file base;
  const char* path;  // SQLite keeps the name valid while the file is open
  sqlite3_file* real() { return reinterpret_cast<sqlite3_file*>(this + 1); }
};

sqlite3_file* real(sqlite3_file* file) { return reinterpret_cast<Layered*>(file)->real(); }
sqlite3_vfs* system_vfs() { return sqlite3_vfs_find("unix"); }

int close(sqlite3_file* file) { return real(file)->pMethods->xClose(real(file)); }
int read(sqlite3_file* file, void* into, int size, sqlite3_int64 at) {
  return real(file)->pMethods->xRead(real(file), into, size, at);
}
int write(sqlite3_file* file, const void* from, int size, sqlite3_int64 at) {
  const char* path = reinterpret_cast<Layered*>(file)->path;
  if (disk != nullptr) disk->await_thaw();
  const int code = real(file)->pMethods->xWrite(real(file), from, size, at);
  if (disk != nullptr && path != nullptr && code == SQLITE_OK) disk->changed(path, at, at + size);
  return code;
}
int truncate(sqlite3_file* file, sqlite3_int64 size) {
  const char* path = reinterpret_cast<Layered*>(file)->path;
  const int code = real(file)->pMethods->xTruncate(real(file), size);
  if (disk != nullptr && path != nullptr && code == SQLITE_OK) disk->changed(path, size, kToEnd);
  return code;
}
int file_size(sqlite3_file* file, sqlite3_int64* size) {
  return real(file)->pMethods->xFileSize(real(file), size);
}
int lock(sqlite3_file* file, int level) { return real(file)->pMethods->xLock(real(file), level); }
int unlock(sqlite3_file* file, int level) {
  return real(file)->pMethods->xUnlock(real(file), level);
}
int check_lock(sqlite3_file* file, int* taken) {
  return real(file)->pMethods->xCheckReservedLock(real(file), taken);
}
int control(sqlite3_file* file, int what, void* argument) {
  return real(file)->pMethods->xFileControl(real(file), what, argument);
}
int sector(sqlite3_file* file) { return real(file)->pMethods->xSectorSize(real(file)); }
// A disk without guarantees, so that SQLite omits no sync.
int character(sqlite3_file*) { return 0; }
int shm_map(sqlite3_file* file, int page, int size, int extend, void volatile** at) {
  return real(file)->pMethods->xShmMap(real(file), page, size, extend, at);
}
// Every transaction needs a lock, also one that finds all its pages in memory.
int shm_lock(sqlite3_file* file, int offset, int count, int flags) {
  if (disk != nullptr && disk->is_failing() && (flags & SQLITE_SHM_LOCK) != 0)
    return SQLITE_IOERR_SHMLOCK;
  return real(file)->pMethods->xShmLock(real(file), offset, count, flags);
}
void shm_barrier(sqlite3_file* file) { real(file)->pMethods->xShmBarrier(real(file)); }
int shm_unmap(sqlite3_file* file, int remove) {
  return real(file)->pMethods->xShmUnmap(real(file), remove);
}

int synchronise(sqlite3_file* file, int) {
  sqlite3_int64 size = 0;
  if (file_size(file, &size) != SQLITE_OK) return SQLITE_IOERR_FSYNC;
  const auto copy = [file](char* into, sqlite3_int64 at, sqlite3_int64 count) {
    return read(file, into, static_cast<int>(count), at) == SQLITE_OK;
  };
  const char* path = reinterpret_cast<Layered*>(file)->path;
  if (path == nullptr || disk == nullptr) return SQLITE_OK;
  return disk->synchronised(path, size, copy) ? SQLITE_OK : SQLITE_IOERR_FSYNC;
}

const sqlite3_io_methods kMethods{2,           close,     read,      write,   truncate,
                                  synchronise, file_size, lock,      unlock,  check_lock,
                                  control,     sector,    character, shm_map, shm_lock,
                                  shm_barrier, shm_unmap, nullptr,   nullptr};

int open(sqlite3_vfs*, const char* name, sqlite3_file* file, int flags, int* got) {
  auto* layered = reinterpret_cast<Layered*>(file);
  layered->path = name;
  layered->base.pMethods = nullptr;
  const int code = system_vfs()->xOpen(system_vfs(), name, layered->real(), flags, got);
  if (layered->real()->pMethods != nullptr) layered->base.pMethods = &kMethods;
  return code;
}

int remove(sqlite3_vfs*, const char* name, int synced) {
  if (disk != nullptr) disk->deleted(name);
  return system_vfs()->xDelete(system_vfs(), name, synced);
}

sqlite3_vfs& layer() {
  static sqlite3_vfs made = [] {
    sqlite3_vfs vfs = *system_vfs();
    vfs.zName = "power-cut";
    vfs.pNext = nullptr;
    vfs.szOsFile = static_cast<int>(sizeof(Layered)) + system_vfs()->szOsFile;
    vfs.xOpen = open;
    vfs.xDelete = remove;
    return vfs;
  }();
  return made;
}

}  // namespace

PowerCut::PowerCut() {
  disk = this;
  if (sqlite3_vfs_register(&layer(), 1) != SQLITE_OK) throw std::runtime_error("no such disk");
}

PowerCut::~PowerCut() {
  sqlite3_vfs_register(system_vfs(), 1);
  disk = nullptr;
}

std::uint64_t PowerCut::syncs(const std::string& ending) const {
  const std::lock_guard lock(mutex_);
  std::uint64_t count = 0;
  for (const auto& [path, file] : files_)
    if (path.ends_with(ending)) count += file.syncs;
  return count;
}

void PowerCut::leave(const std::string& from, const std::string& directory) const {
  namespace fs = std::filesystem;
  const std::lock_guard lock(mutex_);
  fs::create_directories(directory);
  fs::permissions(directory, fs::perms::owner_all);
  const fs::path origin = fs::canonical(from);
  for (const auto& [path, file] : files_) {
    if (file.syncs == 0 || fs::weakly_canonical(path).parent_path() != origin) continue;
    std::ofstream(fs::path(directory) / fs::path(path).filename(), std::ios::binary)
        << file.content;
  }
}

void PowerCut::freeze() {
  const std::lock_guard lock(mutex_);
  is_frozen_ = true;
}

void PowerCut::thaw() {
  const std::lock_guard lock(mutex_);
  is_frozen_ = false;
  thawed_.notify_all();
}

void PowerCut::await_thaw() const {
  std::unique_lock lock(mutex_);
  ++waiting_;
  thawed_.wait(lock, [this] { return !is_frozen_; });
  --waiting_;
}

bool PowerCut::is_awaited() const {
  const std::lock_guard lock(mutex_);
  return is_frozen_ && waiting_ > 0;
}

void PowerCut::changed(const std::string& path, std::int64_t begin, std::int64_t end) {
  const std::lock_guard lock(mutex_);
  files_[path].changed.emplace_back(begin, end);
}

bool PowerCut::synchronised(const std::string& path, std::int64_t size, const Copy& copy) {
  const std::lock_guard lock(mutex_);
  File& file = files_[path];
  if (file.syncs == 0) file.changed = {{0, size}};
  file.content.resize(static_cast<std::size_t>(size));
  for (const auto& [begin, end] : file.changed) {
    const std::int64_t kept = std::min(end, size);
    if (begin < kept && !copy(file.content.data() + begin, begin, kept - begin)) return false;
  }
  file.changed.clear();
  ++file.syncs;
  return true;
}

void PowerCut::deleted(const std::string& path) {
  const std::lock_guard lock(mutex_);
  files_.erase(path);
}

}  // namespace fxagent::test
