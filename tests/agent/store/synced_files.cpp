#include "tests/agent/store/synced_files.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <utility>

#include "tests/support/scratch.h"

namespace fxagent::test {
namespace {

SyncedFiles* disk = nullptr;

}  // namespace

SyncedFiles::SyncedFiles() { disk = this; }
SyncedFiles::~SyncedFiles() { disk = nullptr; }

SyncedFiles::Identity SyncedFiles::identity_of(int directory, const char* name) {
  struct statx found {};
  ::statx(directory, name, AT_EMPTY_PATH | AT_SYMLINK_NOFOLLOW, STATX_INO | STATX_BTIME, &found);
  return {(std::uint64_t{found.stx_dev_major} << 32) | found.stx_dev_minor, found.stx_ino,
          found.stx_btime.tv_sec * 1'000'000'000 + found.stx_btime.tv_nsec};
}

void SyncedFiles::synchronised(int handle) {
  namespace fs = std::filesystem;
  const std::lock_guard lock(mutex_);
  const Identity own = identity_of(handle, "");
  const fs::path path = "/proc/self/fd/" + std::to_string(handle);
  if (fs::is_directory(path)) {
    auto& names = names_[own];
    names.clear();
    for (const auto& each : fs::directory_iterator(path))
      if (each.is_regular_file())
        names[each.path().filename()] = identity_of(AT_FDCWD, each.path().c_str());
  } else {
    contents_[own] = content_of(path);
  }
}

void SyncedFiles::leave(const std::string& from, const std::string& directory,
                        const std::string& prefix) const {
  namespace fs = std::filesystem;
  const std::lock_guard lock(mutex_);
  fs::create_directories(directory);
  fs::permissions(directory, fs::perms::owner_all);
  const auto names = names_.find(identity_of(AT_FDCWD, from.c_str()));
  if (names == names_.end()) return;
  for (const auto& [name, identity] : names->second) {
    if (!name.starts_with(prefix)) continue;
    const auto content = contents_.find(identity);
    std::ofstream out(fs::path(directory) / name, std::ios::binary);
    if (content != contents_.end()) out << content->second;
  }
}

}  // namespace fxagent::test

/// Replaces the C library's fsync() in this program.
extern "C" int fsync(int handle) {
  if (fxagent::test::disk != nullptr) fxagent::test::disk->synchronised(handle);
  return static_cast<int>(::syscall(SYS_fsync, handle));
}
