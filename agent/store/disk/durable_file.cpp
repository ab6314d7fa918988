#include "agent/store/disk/durable_file.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <utility>

#include "agent/store/disk/store_file.h"

namespace fxagent {
DurableFile::DurableFile(std::string directory, const std::string& name)
    : directory_(std::move(directory)), path_(directory_ + "/" + name) {}

std::string DurableFile::lock() {
  // A directory that was deleted or replaced is another one. The slash follows a link.
  if (const auto locked = identity_of(locked_); locked && locked == identity_of(directory_ + "/"))
    return {};
  locked_.close();
  if (std::string fault = make_store_directory(directory_); !fault.empty()) return fault;
  FileHandle handle(::open(directory_.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (handle < 0) return fault_of_system(directory_);
  // An agent that is just ending releases its store a moment before this lock.
  if (!lock_within(handle, kJustEnds))
    return errno == EWOULDBLOCK ? in_use(directory_, directory_) : fault_of_system(directory_);
  locked_ = std::move(handle);
  return {};
}

tl::expected<std::optional<std::string>, std::string> DurableFile::read(std::size_t most) const {
  const FileHandle file(::open(path_.c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK));
  if (file < 0) {
    if (errno == ENOENT) return std::nullopt;
    return tl::unexpected(fault_of_system(path_));
  }
  if (std::string fault = why_not_ours(file, path_); !fault.empty())
    return tl::unexpected(std::move(fault));
  std::string text;
  std::array<char, 65536> block{};
  while (text.size() <= most) {
    const auto got = ::read(file, block.data(), block.size());
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) return tl::unexpected(fault_of_system(path_));
    if (got == 0) return text;
    text.append(block.data(), static_cast<std::size_t>(got));
  }
  return tl::unexpected(path_ + " is larger than " + std::to_string(most) + " bytes");
}

std::string DurableFile::write(std::string_view text) const {
  if (std::string fault = make_store_directory(directory_); !fault.empty()) return fault;
  const std::string fresh = path_ + ".new";
  // A crash may have left this file, or another user may have put it there.
  ::unlink(fresh.c_str());
  const auto give_up = [&fresh](const std::string& what) {
    std::string fault = fault_of_system(what);
    ::unlink(fresh.c_str());
    return fault;
  };
  {
    const FileHandle file(::open(
        fresh.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC | O_NOFOLLOW, S_IRUSR | S_IWUSR));
    if (file < 0) return fault_of_system(fresh);
    if (!write_all(file, text) || ::fsync(file) != 0) return give_up(fresh);
  }
  if (::rename(fresh.c_str(), path_.c_str()) != 0) return give_up(path_);
  return synchronise_directory();
}

std::string DurableFile::remove() const {
  if (::unlink(path_.c_str()) != 0) return errno == ENOENT ? std::string() : fault_of_system(path_);
  return synchronise_directory();
}

std::string DurableFile::synchronise_directory() const {
  const FileHandle directory(::open(directory_.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (directory < 0 || ::fsync(directory) != 0) return fault_of_system(directory_);
  return {};
}

}  // namespace fxagent
