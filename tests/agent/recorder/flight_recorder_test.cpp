#include "agent/recorder/flight_recorder.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <thread>

#include "tests/support/scratch.h"

namespace fxagent {
namespace {

namespace fs = std::filesystem;
using std::chrono::milliseconds;

struct FlightRecorderTest : testing::Test {
  void begin(std::size_t most_files = 10) {
    FlightRecorder::Settings settings{.directory = directory,
                                      .most_files = most_files,
                                      .most_bytes = 1 << 20,
                                      .agent = "edge7",
                                      .version = "0.1.0"};
    settings.follows = std::chrono::hours(1);  // until the end, which does not wait
    recorder.emplace(settings);
  }
  std::shared_ptr<FrameRing> link(const std::string& name) {
    auto ring = recorder->new_ring(name, "tcp 10.0.0.7:502", FrameRing::kLeastBytes);
    ring->add(RecordedFrame::Way::out, kNoDevice, SteadyTime(), {}, Bytes{5}, "");
    return ring;
  }
  /// Ends the recorder, which writes what is due, and returns the recordings.
  std::vector<Recording> end() {
    testing::internal::CaptureStderr();
    recorder.reset();
    log = testing::internal::GetCapturedStderr();
    std::vector<Recording> read;
    for (const auto& entry : fs::directory_iterator(directory)) {
      if (entry.path().extension() != kRecordingSuffix) continue;
      auto recording = parse_recording(test::content_of(entry.path()));
      EXPECT_TRUE(recording) << recording.error();
      if (recording) read.push_back(std::move(*recording));
    }
    return read;
  }

  const test::Scratch scratch;
  const std::string directory = scratch.path("recordings");
  std::optional<FlightRecorder> recorder;
  std::string log;
};

TEST_F(FlightRecorderTest, AnAnomalyMakesAFileThatShowsWhatFollowed) {
  begin();
  const auto ring = link("line1");
  recorder->anomaly("line1", "UNKNOWN_OUTCOME: command c1 for press1");
  ring->add(RecordedFrame::Way::in, kNoDevice, SteadyTime(), {}, Bytes{6}, "");
  const auto read = end();
  ASSERT_EQ(read.size(), 1U);
  EXPECT_EQ(read[0].frames.size(), 2U);
  EXPECT_EQ(read[0].head.reason, "UNKNOWN_OUTCOME: command c1 for press1");
  EXPECT_EQ(read[0].head.link, "line1");
  EXPECT_EQ(read[0].head.wire, "tcp 10.0.0.7:502");
  EXPECT_NE(log.find("recorder link=line1 frames=2 file="), std::string::npos) << log;
}

TEST_F(FlightRecorderTest, AnomaliesInARowShareOneFile) {
  begin();
  const auto ring = link("line1");
  for (int i = 0; i < 1000; ++i) recorder->anomaly("line1", "link down: " + std::to_string(i % 2));
  const auto read = end();
  ASSERT_EQ(read.size(), 1U);
  EXPECT_EQ(read[0].head.reason, "link down: 0; link down: 1");
}

TEST_F(FlightRecorderTest, ManyLinksAtOnceDoNotDeleteEachOthersFiles) {
  begin(3);
  std::vector<std::shared_ptr<FrameRing>> rings;
  for (int i = 0; i < 100; ++i) rings.push_back(link("line" + std::to_string(i)));
  for (int i = 0; i < 100; ++i) recorder->anomaly("line" + std::to_string(i), "link down");
  const auto read = end();
  ASSERT_EQ(read.size(), 3U);
  for (const Recording& recording : read) EXPECT_LT(recording.head.link, "line3");
}

TEST_F(FlightRecorderTest, ALinkThatIsGoneIsForgotten) {
  begin();
  link("line1").reset();
  EXPECT_EQ(recorder->ring_of("line1"), nullptr);
  EXPECT_EQ(recorder->ring_of("line2"), nullptr);
  recorder->anomaly("line1", "too late");
  EXPECT_TRUE(end().empty());
}

TEST_F(FlightRecorderTest, ReadersFindTheRingOfALink) {
  begin();
  const auto ring = link("line1");
  EXPECT_EQ(recorder->ring_of("line1"), ring);
  EXPECT_EQ(recorder->ring_of("line1")->frames().frames.size(), 1U);
}

TEST_F(FlightRecorderTest, AskedItWritesTheLinksThatAreNamed) {
  begin();
  const auto first = link("line1");
  const auto second = link("line2");
  while (!fs::exists(directory + "/answer")) std::this_thread::yield();  // it is ready
  ASSERT_EQ(leave_request(directory, {"line2"}), "");
  recorder->asked();
  const auto read = end();
  ASSERT_EQ(read.size(), 1U);
  EXPECT_EQ(read[0].head.link, "line2");
  EXPECT_EQ(read[0].head.reason, "asked");
  EXPECT_NE(last_answer(directory).find("-line2.fxrec\n"), std::string::npos);
}

TEST_F(FlightRecorderTest, WithoutADirectoryItLogsTheCure) {
  scratch.write("recordings", "a file in its place");
  begin();
  const auto ring = link("line1");
  recorder->anomaly("line1", "link down");
  testing::internal::CaptureStderr();
  recorder.reset();
  log = testing::internal::GetCapturedStderr();
  EXPECT_NE(log.find("not written"), std::string::npos) << log;
}

}  // namespace
}  // namespace fxagent
