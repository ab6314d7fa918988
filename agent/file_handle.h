// An open file, socket or event of the operating system. Any thread.
#pragma once

#include <unistd.h>

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

}  // namespace fxagent
