// Another process that has a file open.
#pragma once

#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/file.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>

namespace fxagent::test {

/// The process has the name of this one and ends with this object.
class OtherProgram {
 public:
  enum class Holds : std::uint8_t { open, locked };
  /// `lacks`: a descriptor of this process that the other one closes; -1: none.
  explicit OtherProgram(const std::string& path, Holds holds = Holds::open, int lacks = -1) {
    std::array<int, 2> ready{};
    std::array<int, 2> end{};
    EXPECT_EQ(::pipe(ready.data()), 0);
    EXPECT_EQ(::pipe(end.data()), 0);
    pid_ = ::fork();
    if (pid_ == 0) {
      ::close(lacks);
      const int file = ::open(path.c_str(), O_RDWR | O_NOCTTY);
      if (holds == Holds::locked) ::flock(file, LOCK_EX);
      ::close(end[1]);
      char one = '.';
      [[maybe_unused]] auto done = ::write(ready[1], &one, 1);
      done = ::read(end[0], &one, 1);  // until the other end is closed
      ::_exit(0);
    }
    char one = 0;
    EXPECT_EQ(::read(ready[0], &one, 1), 1);
    for (const int file : {ready[0], ready[1], end[0]}) ::close(file);
    end_ = end[1];
  }
  OtherProgram(const OtherProgram&) = delete;
  OtherProgram& operator=(const OtherProgram&) = delete;
  ~OtherProgram() {
    ::close(end_);
    ::waitpid(pid_, nullptr, 0);
  }
  int pid() const { return pid_; }

 private:
  pid_t pid_ = -1;
  int end_ = -1;
};

}  // namespace fxagent::test
