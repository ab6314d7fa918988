#include "agent/handover/status_board.h"

#include <gtest/gtest.h>

#include <future>
#include <thread>

namespace fxagent {
namespace {

using namespace std::chrono_literals;

constexpr SteadyTime kStart{1h};

std::shared_ptr<const AgentStatus> status(std::int64_t ts_ms) {
  AgentStatus made;
  made.ts_ms = ts_ms;
  return std::make_shared<const AgentStatus>(std::move(made));
}

TEST(StatusBoard, FreshStatusIsReadAtOnceAndNobodyIsAsked) {
  int woken = 0;
  StatusBoard board([&] { ++woken; });
  board.publish(status(1), kStart);
  EXPECT_EQ(board.read(kStart + 999ms, 1h)->ts_ms, 1);
  EXPECT_FALSE(board.is_asked());
  EXPECT_EQ(woken, 0);
}

TEST(StatusBoard, OldStatusIsAskedForOnceUntilTheNextIsThere) {
  int woken = 0;
  StatusBoard board([&] { ++woken; });
  EXPECT_EQ(board.read(kStart, 0ms), nullptr);
  board.publish(status(1), kStart);
  EXPECT_FALSE(board.is_asked());
  EXPECT_EQ(board.read(kStart + 1s, 0ms)->ts_ms, 1);
  EXPECT_EQ(board.read(kStart + 2s, 0ms)->ts_ms, 1);
  EXPECT_TRUE(board.is_asked());
  EXPECT_EQ(woken, 2);
  board.publish(status(2), kStart + 3s);
  EXPECT_FALSE(board.is_asked());
  EXPECT_EQ(board.read(kStart + 3s, 0ms)->ts_ms, 2);
  EXPECT_EQ(woken, 2);
}

TEST(StatusBoard, ReaderWaitsForTheStatusThatItAskedFor) {
  std::promise<void> asked;
  StatusBoard board([&] { asked.set_value(); });
  std::thread uplink([&] {
    asked.get_future().wait();
    board.publish(status(1), kStart);
  });
  EXPECT_EQ(board.read(kStart, 1h)->ts_ms, 1);
  uplink.join();
}

TEST(StatusBoard, StatusInSomebodysHandsStaysAsItWas) {
  StatusBoard board([] {});
  board.publish(status(1), kStart);
  const auto kept = board.read(kStart, 0ms);
  board.publish(status(2), kStart);
  EXPECT_EQ(kept->ts_ms, 1);
  EXPECT_EQ(board.read(kStart, 0ms)->ts_ms, 2);
}

}  // namespace
}  // namespace fxagent
