#include "agent/field/bus/wire_trace.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <regex>

#include "agent/field/bus/bus.h"
#include "tests/agent/field/field_plant.h"
#include "tests/agent/field/port_frames.h"
#include "tests/agent/field/scripted_bus.h"

namespace fxagent::test {
namespace {

using std::chrono::milliseconds;
using Lines = std::vector<std::string>;

const Bytes kReadD100 = read_frame(kD100, 2);
const std::string kFrame = "trace frame link=line1 device=press1 way=";
const std::string kAsked =
    kFrame + "out bytes=\"" + to_hex(kReadD100) + "\" says=\"read D100 × 1\"";

/// A line whose log the test reads.
struct WireTraceTest : ScriptedBusTest {
  WireTraceTest() {
    make_bus();
    station.codec = port_codec();
    station.device = "press1";
    station.enquire = EnquirePolicy::never;
    station.timeout = milliseconds(1000);
  }
  void trace() { bus->trace_to(std::make_unique<WireTrace>("line1")); }
  /// Returns the log lines of a read of D100, without the times.
  Lines read_d100() {
    testing::internal::CaptureStderr();
    if (!bus->is_open()) {
      EXPECT_TRUE(run_on(io, bus->open()).has_value());
    }
    read("D100");
    std::istringstream log(testing::internal::GetCapturedStderr());
    Lines lines;
    for (std::string text; std::getline(log, text);) {
      EXPECT_TRUE(std::regex_search(text, std::regex("^20[0-9-]+T[0-9:.]+Z trace "))) << text;
      text = text.substr(text.find("trace "));
      lines.push_back(std::regex_replace(text, std::regex("after_ms=[0-9.]+"), "after_ms=*"));
    }
    return lines;
  }
};

TEST_F(WireTraceTest, QuestionAndAnswerAreExplained) {
  wire->expect(kReadD100).give(word_frame(0x15AB));
  trace();
  EXPECT_EQ(read_d100(), (Lines{kAsked, kFrame + "in bytes=\"" + to_hex(word_frame(0x15AB)) +
                                            "\" after_ms=* says=\"data 15AB\""}));
}

TEST_F(WireTraceTest, ALinkThatIsNotTracedShowsNothingAndATraceMayCease) {
  for (int i = 0; i < 3; ++i) wire->expect(kReadD100).give(word_frame(1));
  EXPECT_EQ(read_d100(), Lines{});
  trace();
  EXPECT_TRUE(bus->is_traced());
  EXPECT_EQ(read_d100().size(), 2U);
  bus->trace_to(nullptr);
  EXPECT_EQ(read_d100(), Lines{});
}

TEST_F(WireTraceTest, ARefusalIsExplained) {
  wire->expect(kReadD100).give(kNak);
  trace();
  EXPECT_EQ(read_d100(), (Lines{kAsked, kFrame + "in bytes=15 after_ms=* says=nak"}));
}

TEST_F(WireTraceTest, SilenceIsToldWithItsTime) {
  wire->expect(kReadD100).silence();
  trace();
  EXPECT_EQ(read_d100(),
            (Lines{kAsked, kFrame + "in after_ms=* says=\"no bytes within 1000 ms\""}));
}

TEST_F(WireTraceTest, ABadFrameIsToldWithWhatIsWrong) {
  Bytes bad = word_frame(0x15AB);
  bad.back() = '0';
  wire->expect(kReadD100).give(bad);
  trace();
  const Lines lines = read_d100();
  ASSERT_EQ(lines.size(), 2U);
  EXPECT_TRUE(lines[1].starts_with(kFrame + "in bytes=\"" + to_hex(bad) + "\" after_ms=* says=\""))
      << lines[1];
  EXPECT_NE(lines[1].find("sum"), std::string::npos) << lines[1];
}

TEST_F(WireTraceTest, HalfAnAnswerIsShown) {
  wire->expect(kReadD100).give({0x02, '3'}).silence();
  trace();
  EXPECT_EQ(
      read_d100(),
      (Lines{kAsked,
             kFrame + "in bytes=\"02 33\" after_ms=* says=\"no complete answer within 1000 ms\""}));
}

TEST_F(WireTraceTest, BytesThatNobodyAskedForAreShown) {
  wire->give({0x7F}).expect(kReadD100).give(joined(word_frame(1), kNak));
  trace();
  const Lines lines = read_d100();
  ASSERT_EQ(lines.size(), 4U);
  // From open(), where no device is addressed.
  EXPECT_EQ(lines[0], "trace frame link=line1 way=in bytes=7F says=\"unexpected bytes\"");
  EXPECT_EQ(lines[1], kAsked);
  EXPECT_EQ(std::ranges::count(lines, kFrame + "in bytes=15 says=\"unexpected bytes; nak\""), 1)
      << lines[2] << '\n'
      << lines[3];
}

TEST_F(WireTraceTest, LongFramesAreShownWhole) {
  const WireTrace trace("line1");
  testing::internal::CaptureStderr();
  trace.unasked(Bytes(600, 0x55), SteadyTime());
  EXPECT_GT(testing::internal::GetCapturedStderr().size(), 1800U);
}

// The tracer and the device's codec may be gone when the log thread handles the line.
TEST_F(WireTraceTest, WhatWaitsToBeExplainedKeepsItsCodecAndNothingLonger) {
  auto codec = port_codec();
  const std::weak_ptr<const Codec> kept = codec;
  testing::internal::CaptureStderr();
  {
    WireTrace trace("line1");
    station.codec = std::move(codec);
    trace.speak_to(station);
    station.codec = nullptr;
    trace.out(kReadD100, SteadyTime());
    EXPECT_FALSE(kept.expired());
  }
  testing::internal::GetCapturedStderr();
  EXPECT_TRUE(kept.expired());
}

struct RingTest : WireTraceTest {
  using Frames = std::vector<std::pair<RecordedFrame::Way, Bytes>>;

  RingTest() {
    station.recorded_as = ring->number({"press1", "fx-programming-port", {}});
    bus->trace_to(std::make_unique<WireTrace>("line1", WireTrace::Log::no, ring));
  }
  Frames recorded() {
    Frames frames;
    for (const RecordedFrame& frame : ring->frames().frames) {
      EXPECT_EQ(frame.device, station.recorded_as);
      EXPECT_GT(frame.at_us, 0);
      frames.emplace_back(frame.way, frame.bytes);
    }
    return frames;
  }

  const std::shared_ptr<FrameRing> ring = std::make_shared<FrameRing>(FrameRing::kLeastBytes);
};

TEST_F(RingTest, HasWhatATraceShowsAndTheLogHasNothing) {
  wire->expect(kReadD100).give(joined(word_frame(1), kNak));
  EXPECT_EQ(read_d100(), Lines{});
  EXPECT_FALSE(bus->is_traced());
  EXPECT_EQ(recorded(), (Frames{{RecordedFrame::Way::out, kReadD100},
                                {RecordedFrame::Way::unasked, kNak},
                                {RecordedFrame::Way::in, word_frame(1)}}));
}

TEST_F(RingTest, HasSilenceWithItsReason) {
  wire->expect(kReadD100).silence();
  EXPECT_EQ(read_d100(), Lines{});
  EXPECT_EQ(recorded(),
            (Frames{{RecordedFrame::Way::out, kReadD100}, {RecordedFrame::Way::failed, {}}}));
  EXPECT_EQ(ring->frames().frames.back().note, "no bytes within 1000 ms");
  EXPECT_EQ(ring->frames().frames.back().after, milliseconds(1000));
}

}  // namespace
}  // namespace fxagent::test
