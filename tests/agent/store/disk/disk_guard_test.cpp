#include "agent/store/disk/disk_guard.h"

#include <gtest/gtest.h>

#include <future>
#include <semaphore>
#include <thread>

namespace fxagent {
namespace {

using namespace std::chrono_literals;

TEST(DiskThread, WorkIsDoneOnAnotherThreadBeforeRunReturns) {
  DiskThread disk([] { ADD_FAILURE() << "nothing was overdue"; });
  disk.set_patience(1h);
  std::thread::id worker;
  for (int i = 0; i < 100; ++i) {
    worker = {};
    ASSERT_TRUE(disk.run([&] { worker = std::this_thread::get_id(); }));
    EXPECT_NE(worker, std::thread::id());
    EXPECT_NE(worker, std::this_thread::get_id());
    EXPECT_FALSE(disk.is_busy());
  }
}

TEST(DiskThread, OverdueWorkGoesOnAndItsEndIsReportedOnce) {
  std::counting_semaphore<8> ended(0);
  std::promise<void> disk_answers;
  bool done = false;
  DiskThread disk([&] { ended.release(); });
  disk.set_patience(1ms);
  ASSERT_FALSE(disk.run([&, answer = disk_answers.get_future().share()] {
    answer.wait();
    done = true;
  }));
  EXPECT_TRUE(disk.is_busy());
  disk_answers.set_value();
  ended.acquire();
  EXPECT_FALSE(disk.is_busy());
  EXPECT_TRUE(done);
  EXPECT_FALSE(ended.try_acquire());
}

TEST(DiskThread, EndOfTheThreadWaitsForOverdueWork) {
  std::promise<void> disk_answers;
  std::atomic<bool> done = false;
  std::jthread answer;
  {
    DiskThread disk([] {});
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
