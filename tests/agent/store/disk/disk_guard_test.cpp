#include "agent/store/disk/disk_guard.h"

#include <gtest/gtest.h>

#include <future>
#include <semaphore>
#include <thread>

namespace fxagent {
namespace {

using namespace std::chrono_literals;

TEST(DiskGuard, WorkIsDoneOnAnotherThreadBeforeRunReturns) {
  DiskGuard disk(
      "", [] {}, [] { ADD_FAILURE() << "nothing was overdue"; });
  disk.set_patience(1h);
  std::thread::id worker;
  for (int i = 0; i < 100; ++i) {
    worker = {};
    ASSERT_TRUE(disk.run([&] { worker = std::this_thread::get_id(); }));
    EXPECT_NE(worker, std::thread::id());
    EXPECT_NE(worker, std::this_thread::get_id());
  }
}

TEST(DiskGuard, OverdueWorkGoesOnAndItsEndIsReportedOnce) {
  std::counting_semaphore<8> ended(0);
  std::promise<void> disk_answers;
  bool done = false;
  DiskGuard disk(
      "", [] {}, [&] { ended.release(); });
  disk.set_patience(1ms);
  ASSERT_FALSE(disk.run([&, answer = disk_answers.get_future().share()] {
    answer.wait();
    done = true;
  }));
  EXPECT_TRUE(disk.hangs());
  EXPECT_FALSE(disk.has_answered());
  disk_answers.set_value();
  ended.acquire();
  EXPECT_TRUE(disk.has_answered());
  EXPECT_TRUE(done);
  EXPECT_FALSE(ended.try_acquire());
}

TEST(DiskGuard, EndOfTheThreadWaitsForOverdueWork) {
  std::promise<void> disk_answers;
  std::atomic<bool> done = false;
  std::jthread answer;
  {
    DiskGuard disk(
        "", [] {}, [] {});
    disk.set_patience(1ms);
    ASSERT_FALSE(disk.run([&] {
      disk_answers.get_future().wait();
      done = true;
    }));
    answer = std::jthread([&] { disk_answers.set_value(); });
  }
  EXPECT_TRUE(done);
}

}  // namespace
}  // namespace fxagent
