#include "agent/process/thread_progress.h"

#include <gtest/gtest.h>
#include <pthread.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <fstream>
#include <semaphore>
#include <thread>

namespace fxagent {
namespace {

using namespace std::chrono_literals;

constexpr ThreadProgress::Time kBeginning{1000s};
constexpr const char* kName = "turns_test";

/// A thread that waits; each turn() wakes it once.
class Worker {
 public:
  Worker()
      : thread_([this] {
          pthread_setname_np(pthread_self(), kName);
          id_ = gettid();
          while (true) {
            began_.release();
            go_.acquire();
            if (over_) return;
            // A switch in each turn, even if the thread did not have to wait for it.
            std::this_thread::sleep_for(1us);
          }
        }) {
    began_.acquire();
  }
  ~Worker() {
    over_ = true;
    go_.release();
  }
  Worker(const Worker&) = delete;
  Worker& operator=(const Worker&) = delete;

  /// proc(5): the state follows the name in parentheses.
  bool is_asleep() const {
    std::ifstream file("/proc/self/task/" + std::to_string(id_) + "/stat");
    std::string stat;
    std::getline(file, stat);
    return stat.find(") S") != std::string::npos;
  }
  /// Takes one turn: wakes the thread, which then waits again.
  void turn() {
    go_.release();
    began_.acquire();
  }

 private:
  std::atomic<pid_t> id_ = 0;
  std::atomic<bool> over_ = false;
  std::binary_semaphore go_{0};
  std::binary_semaphore began_{0};
  std::jthread thread_;
};

struct ThreadProgressTest : testing::Test {
  /// Checks this many times, ten seconds apart.
  std::string after(int checks, bool excused = false) {
    for (int i = 0; i < checks; ++i) {
      turns.check(now, excused);
      now += ThreadProgress::kBetweenChecks;
    }
    return turns.hanging_thread();
  }
  /// Waits until the kernel has finished starting or waking the thread, and it waits permanently.
  void settle(const Worker& worker) {
    while (!worker.is_asleep()) std::this_thread::yield();
    while (after(ThreadProgress::kChecks).empty()) std::this_thread::yield();
    turns = ThreadProgress(kName, "pair");
  }

  ThreadProgress turns{kName, "pair"};
  ThreadProgress::Time now = kBeginning;
};

TEST_F(ThreadProgressTest, AThreadThatIsNeverSwitchedStandsStillAndIsNamed) {
  Worker worker;
  settle(worker);
  EXPECT_EQ(after(ThreadProgress::kChecks), "");
  EXPECT_EQ(after(1), kName);
  EXPECT_EQ(after(10), kName);
  worker.turn();
  EXPECT_EQ(after(1), "");
}

TEST_F(ThreadProgressTest, WhatStandsStillIsLoggedOnceWithItsPart) {
  const Worker worker;
  settle(worker);
  testing::internal::CaptureStderr();
  after(ThreadProgress::kChecks + 10);
  EXPECT_FALSE(turns.check(now, false));
  const std::string log = testing::internal::GetCapturedStderr();
  const std::string line = std::string("error watchdog stands_still=pair thread=") + kName;
  EXPECT_NE(log.find(line), log.npos) << log;
  EXPECT_EQ(log.find(line), log.rfind(line)) << log;
}

TEST_F(ThreadProgressTest, AThreadThatTakesATurnNowAndThenGoesOn) {
  Worker worker;
  for (int i = 0; i < 10; ++i) {
    EXPECT_EQ(after(ThreadProgress::kChecks), "");
    worker.turn();
  }
}

TEST_F(ThreadProgressTest, OneOfTwoIsEnough) {
  Worker stuck;
  settle(stuck);
  Worker busy;
  std::string said;
  for (int i = 0; i < ThreadProgress::kChecks + 1; ++i) {
    said = after(1);
    busy.turn();
  }
  EXPECT_EQ(said, kName);
}

/// A name server lookup may take long.
TEST_F(ThreadProgressTest, WhoIsExcusedBeginsAnew) {
  const Worker worker;
  settle(worker);
  EXPECT_EQ(after(100, /*excused=*/true), "");
  EXPECT_EQ(after(ThreadProgress::kChecks), "");
  EXPECT_EQ(after(1), kName);
  EXPECT_EQ(after(1, /*excused=*/true), "");
}

/// A suspended machine or a stopped process has missed the checks too.
TEST_F(ThreadProgressTest, TimeAloneDoesNotCount) {
  const Worker worker;
  settle(worker);
  EXPECT_EQ(after(2), "");
  now += 24h;
  EXPECT_EQ(after(2), "");
  const auto then = now;
  for (int i = 0; i < 1000; ++i) turns.check(then, false);
  EXPECT_EQ(turns.hanging_thread(), "");
}

TEST_F(ThreadProgressTest, OthersAndThreadsThatAreGoneDoNotMatter) {
  {
    const Worker worker;
    settle(worker);
    EXPECT_EQ(after(ThreadProgress::kChecks + 1), kName);
  }
  EXPECT_EQ(after(1), "");
  EXPECT_EQ(after(100), "");  // this thread has another name
}

}  // namespace
}  // namespace fxagent
