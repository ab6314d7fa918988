#include "agent/field/link/link_recorder.h"

#include <gtest/gtest.h>

#include <filesystem>

#include "tests/support/scratch.h"

namespace fxagent {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

struct LinkRecorderTest : testing::Test {
  LinkRecorderTest() {
    FlightRecorder::Settings settings{
        .directory = scratch.path("recordings"), .most_files = 10, .most_bytes = 1 << 20};
    settings.follows = std::chrono::hours(1);  // until the end, which does not wait
    recorder = std::make_unique<FlightRecorder>(settings);
    config.name = "line1";
    config.channel = SerialSettings{.path = "/dev/ttyUSB0"};
    link = std::make_unique<LinkRecorder>(recorder.get(), config, FrameRing::kLeastBytes);
  }
  /// Ends the recorder and returns the reason of its only file; empty if there is none.
  std::string reason() {
    testing::internal::CaptureStderr();
    recorder.reset();
    testing::internal::GetCapturedStderr();
    for (const auto& entry : std::filesystem::directory_iterator(scratch.path("recordings"))) {
      if (entry.path().extension() != kRecordingSuffix) continue;
      const auto recording = parse_recording(test::content_of(entry.path()));
      EXPECT_EQ(recording->head.wire, "serial /dev/ttyUSB0 9600 7E1");
      return recording->head.reason;
    }
    return {};
  }
  static CommandResult result(CommandStatus status, milliseconds took) {
    CommandResult out;
    out.id = "c1";
    out.status = status;
    out.queue = milliseconds(20);
    out.wire = took - out.queue;
    return out;
  }

  static constexpr milliseconds kBound{100};
  const test::Scratch scratch;
  LinkConfig config;
  std::unique_ptr<FlightRecorder> recorder;
  std::unique_ptr<LinkRecorder> link;
};

TEST_F(LinkRecorderTest, AWorkingLinkIsNoAnomaly) {
  link->check_link(0, false, "not opened yet");
  link->check_link(0, true, "");
  link->check_link(FrameBurst::kFrames - 1, true, "");
  link->ended(result(CommandStatus::succeeded, milliseconds(100)), "press1", kBound);
  link->ended(result(CommandStatus::rejected, milliseconds(100)), "press1", kBound);
  EXPECT_EQ(reason(), "");
}

TEST_F(LinkRecorderTest, ALostLinkIs) {
  link->check_link(0, true, "");
  link->check_link(0, false, "no such device");
  EXPECT_EQ(reason(), "link down: no such device");
}

TEST_F(LinkRecorderTest, ABurstOfBadFramesIs) {
  link->check_link(FrameBurst::kFrames, true, "");
  EXPECT_EQ(reason(), "a burst of bad frames");
}

TEST_F(LinkRecorderTest, AnUnknownOutcomeIs) {
  link->ended(result(CommandStatus::unknown_outcome, milliseconds(50)), "press1", kBound);
  EXPECT_EQ(reason(), "UNKNOWN_OUTCOME: command c1 for press1");
}

TEST_F(LinkRecorderTest, ACommandOverItsBoundIs) {
  link->ended(result(CommandStatus::succeeded, milliseconds(101)), "press1", kBound);
  EXPECT_EQ(reason(), "over its bound: command c1 for press1 took 101 of 100 ms");
}

TEST(LinkRecorder, WithoutARecorderDoesNothing) {
  LinkConfig config;
  LinkRecorder link(nullptr, config, 0);
  EXPECT_EQ(link.ring(), nullptr);
  EXPECT_EQ(link.number(DeviceConfig()), kNoDevice);
  link.check_link(100, true, "");
  link.check_link(100, false, "down");
}

TEST(FrameBurst, FiveWithinAMinuteAreOneBurst) {
  FrameBurst burst;
  const SteadyTime begin{};
  for (std::uint64_t i = 1; i < FrameBurst::kFrames; ++i)
    EXPECT_FALSE(burst.add(i, begin + seconds(i)));
  EXPECT_FALSE(burst.add(4, begin + seconds(5))) << "nothing new";
  EXPECT_TRUE(burst.add(5, begin + seconds(6)));
  EXPECT_FALSE(burst.add(6, begin + seconds(7))) << "the next burst begins";
  EXPECT_TRUE(burst.add(10, begin + seconds(8)));
}

TEST(FrameBurst, AFewOverALongTimeAreNone) {
  FrameBurst burst;
  for (std::uint64_t i = 1; i <= 100; ++i)
    EXPECT_FALSE(burst.add(i, SteadyTime() + seconds(20 * i))) << i;
}

TEST(FrameBurst, ManyAtOnceAreABurst) { EXPECT_TRUE(FrameBurst().add(5, SteadyTime())); }

}  // namespace
}  // namespace fxagent
