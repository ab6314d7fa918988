// An open file, socket or event of the operating system. Any thread.
#pragma once

#include <unistd.h>

#include <cerrno>
#include <cstddef>
#include <string_view>
#include <utility>

namespace fxagent {

/// Closes the file descriptor at the end of its life. Converts to its number; negative: not open.
class FileHandle final {
 public:
  explicit FileHandle(int number = -1) : number_(number) {}
  FileHandle(FileHandle&& other) noexcept : number_(other.release()) {}
  FileHandle& operator=(FileHandle&& other) noexcept {
    close();
    number_ = other.release();
    return *this;
  }
  ~FileHandle() { close(); }

  operator int() const { return number_; }
  explicit operator bool() const = delete;  // -1 would be true
  /// Passes the descriptor to the caller, who closes it.
  int release() { return std::exchange(number_, -1); }
  void close() {
    if (number_ >= 0) ::close(release());
  }

 private:
  int number_;
};

/// Writes the whole text. Returns false, with errno set, if part of the text was not written.
inline bool write_all(int file, std::string_view text) {
  while (!text.empty()) {
    const auto written = ::write(file, text.data(), text.size());
    if (written < 0 && errno == EINTR) continue;
    if (written == 0) errno = ENOSPC;
    if (written <= 0) return false;
    text.remove_prefix(static_cast<std::size_t>(written));
  }
  return true;
}

}  // namespace fxagent
