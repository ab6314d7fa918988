// The limit of open files, lowered for a test.
#pragma once

#include <gtest/gtest.h>
#include <sys/resource.h>

namespace fxagent::test {

/// Changes the limit of open files until the test is over.
class OpenFiles final {
 public:
  explicit OpenFiles(rlim_t allowed) {
    EXPECT_EQ(getrlimit(RLIMIT_NOFILE, &before_), 0);
    rlimit low = before_;
    low.rlim_cur = allowed;
    EXPECT_EQ(setrlimit(RLIMIT_NOFILE, &low), 0);
  }
  OpenFiles(const OpenFiles&) = delete;
  OpenFiles& operator=(const OpenFiles&) = delete;
  ~OpenFiles() { setrlimit(RLIMIT_NOFILE, &before_); }

 private:
  rlimit before_{};
};

}  // namespace fxagent::test
