#include "agent/recorder/frame_ring.h"

#include <gtest/gtest.h>

#include <atomic>
#include <cstdlib>
#include <deque>
#include <random>
#include <thread>

namespace fxagent {
namespace {

using Way = RecordedFrame::Way;
using std::chrono::nanoseconds;

/// A frame whose number is in `after`.
RecordedFrame frame(std::int64_t number, std::size_t bytes, const std::string& note = {}) {
  RecordedFrame out;
  out.way = static_cast<Way>(number % 4);
  out.after = nanoseconds(number);
  out.device = number % 3 == 0 ? kNoDevice : static_cast<std::uint16_t>(number % 3);
  out.bytes.assign(bytes, static_cast<std::uint8_t>(number));
  out.note = note;
  return out;
}
void add(FrameRing& ring, const RecordedFrame& frame) {
  ring.add(frame.way, frame.device, SteadyTime(), frame.after, frame.bytes, frame.note);
}
/// Returns the frames of the ring without their times.
std::vector<RecordedFrame> frames_of(const FrameRing& ring) {
  auto frames = ring.frames().frames;
  for (RecordedFrame& each : frames) each.at_us = 0;
  return frames;
}

TEST(FrameRing, ReturnsTheFramesThatWereAdded) {
  FrameRing ring(FrameRing::kLeastBytes);
  EXPECT_TRUE(ring.frames().frames.empty());
  const std::vector<RecordedFrame> added{frame(1, 8), frame(2, 0, "no bytes within 1000 ms"),
                                         frame(3, 300)};
  for (const RecordedFrame& each : added) add(ring, each);
  EXPECT_EQ(frames_of(ring), added);
  EXPECT_EQ(ring.frames().next, 3U);
}

TEST(FrameRing, KeepsTheNewestWhateverTheirLengths) {
  FrameRing ring(FrameRing::kLeastBytes);
  std::minstd_rand random(1);
  std::deque<RecordedFrame> added;
  for (std::int64_t i = 0; i < 3000; ++i) {
    added.push_back(frame(i, random() % 700, std::string(random() % 40, 'n')));
    add(ring, added.back());
    const auto kept = frames_of(ring);
    ASSERT_FALSE(kept.empty());
    ASSERT_LE(kept.size(), added.size());
    ASSERT_TRUE(std::equal(kept.rbegin(), kept.rend(), added.rbegin())) << i;
    if (kept.size() + 1 < added.size()) added.pop_front();
  }
}

TEST(FrameRing, AReaderGoesOnWhereItWas) {
  FrameRing ring(FrameRing::kLeastBytes);
  for (std::int64_t i = 0; i < 10; ++i) add(ring, frame(i, 4));
  const RecordedFrames first = ring.frames(0, 3);
  ASSERT_EQ(first.frames.size(), 3U);
  EXPECT_EQ(first.frames.front().after.count(), 7) << "the newest ones";
  EXPECT_TRUE(ring.frames(first.next).frames.empty());
  add(ring, frame(10, 4));
  const RecordedFrames more = ring.frames(first.next, 100);
  ASSERT_EQ(more.frames.size(), 1U);
  EXPECT_EQ(more.frames.front().after.count(), 10);
  EXPECT_TRUE(ring.frames(99).frames.empty()) << "a number of an earlier run";
}

TEST(FrameRing, TimesAreUtc) {
  FrameRing ring(FrameRing::kLeastBytes);
  const auto now = std::chrono::steady_clock::now();
  const std::int64_t before = utc_us(std::chrono::system_clock::now());
  ring.add(Way::out, 0, now, {}, Bytes{5}, "");
  ring.add(Way::in, 0, now + std::chrono::microseconds(7400), {}, Bytes{6}, "");
  const auto frames = ring.frames().frames;
  EXPECT_EQ(frames[1].at_us - frames[0].at_us, 7400);
  constexpr std::int64_t kHour = 3'600'000'000;  // a clock that is set meanwhile may jump
  EXPECT_LT(std::abs(frames[0].at_us - before), kHour);
}

TEST(FrameRing, LongFramesAndNotesAreCut) {
  FrameRing ring(FrameRing::kLeastBytes);
  add(ring, frame(1, 100'000, std::string(5000, 'x')));
  const auto kept = ring.frames().frames;
  ASSERT_EQ(kept.size(), 1U);
  EXPECT_EQ(kept[0].bytes.size(), FrameRing::kLeastBytes / 4);
  EXPECT_EQ(kept[0].note, std::string(FrameRing::kMostNote, 'x') + "; cut");
}

TEST(FrameRing, EqualDevicesHaveOneNumber) {
  FrameRing ring(FrameRing::kLeastBytes);
  EXPECT_EQ(ring.number({"a", "modbus-tcp", {}}), 0);
  EXPECT_EQ(ring.number({"b", "modbus-tcp", {}}), 1);
  EXPECT_EQ(ring.number({"a", "modbus-tcp", {}}), 0);
  EXPECT_EQ(ring.number({"a", "modbus-tcp", {{"unit", std::int64_t{2}}}}), 2);
  EXPECT_EQ(ring.frames().devices.size(), 3U);
}

TEST(FrameRing, ACopyIsWholeWhileFramesAreAdded) {
  FrameRing ring(FrameRing::kLeastBytes);
  std::atomic<bool> over = false;
  std::thread field([&] {
    for (std::int64_t i = 0; i < 20'000; ++i) add(ring, frame(i, static_cast<std::size_t>(i % 90)));
    over = true;
  });
  while (!over) {
    std::int64_t last = -1;
    for (const RecordedFrame& each : frames_of(ring)) {
      EXPECT_TRUE(last < 0 || each.after.count() == last + 1);
      last = each.after.count();
      EXPECT_EQ(each, frame(last, static_cast<std::size_t>(last % 90)));
    }
  }
  field.join();
}

}  // namespace
}  // namespace fxagent
