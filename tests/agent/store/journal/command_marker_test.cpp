#include "agent/store/journal/guarded_journal.h"

#include <gtest/gtest.h>

#include <semaphore>
#include <thread>

namespace fxagent {
namespace {

using namespace std::chrono_literals;

TEST(CommandMarker, MarksAreMadeInOrderOnItsOwnThreadBeforeTheyAreAnswered) {
  std::vector<std::uint64_t> written;
  std::thread::id writer;
  std::binary_semaphore answered(0);
  CommandMarker marker([&](std::uint64_t number) {
    written.push_back(number);
    writer = std::this_thread::get_id();
  });
  marker.set_patience(1h);
  for (std::uint64_t number = 1; number <= 100; ++number)
    marker.mark(number, [&, number](bool may_be_sent) {
      EXPECT_TRUE(may_be_sent);
      EXPECT_EQ(written.back(), number);
      if (number == 100) answered.release();
    });
  answered.acquire();
  EXPECT_EQ(written.size(), 100U);
  EXPECT_NE(writer, std::this_thread::get_id());
}

TEST(CommandMarker, WhileTheDiskHangsEachNextCommandIsRefusedAtOnce) {
  std::binary_semaphore disk(0);
  std::binary_semaphore answered(0);
  CommandMarker marker([&](std::uint64_t) { disk.acquire(); });
  marker.set_patience(0ms);
  const auto expect_true = [&](bool may_be_sent) {
    EXPECT_TRUE(may_be_sent);
    answered.release();
  };
  marker.mark(1, expect_true);
  bool is_refused = false;
  marker.mark(2, [&](bool may_be_sent) { is_refused = !may_be_sent; });
  EXPECT_TRUE(is_refused);
  disk.release();
  answered.acquire();
  disk.release();
  marker.mark(3, expect_true);
  answered.acquire();
}

}  // namespace
}  // namespace fxagent
