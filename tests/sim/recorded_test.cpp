#include "tests/sim/recorded.h"

#include <gtest/gtest.h>

#include "tests/sim/config.h"
#include "tests/sim/sample_plc.h"

namespace fxsim {
namespace {

using std::chrono::milliseconds;

const std::string kHead =
    "fxagent-recording 1\nagent edge7 0.1.0\nlink line1\nwire tcp 10.0.0.7:502\n"
    "device 0 meter1 modbus-tcp model=auto unit=1\nnumber 0 0 2\n";
std::string frame(const std::string& rest) { return "2026-11-26T18:00:00.123456Z " + rest + "\n"; }

class RecordedDeviceTest : public testing::Test {
 protected:
  void play(const std::string& frames) {
    device_ = make_recorded_device(std::make_shared<Recording>(parse_recording(kHead + frames)));
    framer_ = device_->make_framer();
  }
  std::vector<Frame> frames_of(const std::string& hex) {
    std::vector<Frame> frames;
    const Bytes bytes = from_hex(hex).value_or(Bytes());
    for (const auto byte : bytes) framer_->take(byte, TimePoint(), frames);
    return frames;
  }
  /// Returns the answer in hex; "silence" if there is none.
  std::string answer(const std::string& hex) {
    const auto frames = frames_of(hex);
    if (frames.size() != 1) return std::to_string(frames.size()) + " frames";
    Plc plc(*find_model("FX3U"), make_plant("none"), TimePoint());
    last_ = device_->execute(frames[0], plc);
    return last_.reply.empty() ? "silence" : to_hex(last_.reply);
  }

  std::unique_ptr<Personality> device_;
  std::unique_ptr<Framer> framer_;
  Ruling last_;
};

TEST_F(RecordedDeviceTest, EachRequestHasItsAnswersInOrderAndThenAnew) {
  play(frame("out - 0.000 05") + frame("in - 7.400 06") + frame("out - 0.000 0230") +
       frame("in - 3.000 31") + frame("out - 0.000 0230") + frame("in - 3.000 32"));
  EXPECT_EQ(answer("02 30"), "31");
  EXPECT_EQ(answer("05"), "06");
  EXPECT_EQ(last_.wait, milliseconds(7));
  EXPECT_EQ(answer("02 30"), "32");
  EXPECT_EQ(answer("02 30"), "31");
}

TEST_F(RecordedDeviceTest, AnAnswerCarriesTheNumberOfItsRequest) {
  play(frame("out 0 0.000 00010000000101") + frame("in 0 1.000 00010000000177"));
  EXPECT_EQ(answer("A5 5A 00 00 00 01 01"), "A5 5A 00 00 00 01 77");
}

TEST_F(RecordedDeviceTest, SilenceAndBadAnswersArePlayedToo) {
  play(frame("out - 0.000 05") + frame("failed - 1000.000 - no bytes within 1000 ms") +
       frame("out - 0.000 05") + frame("failed - 4.000 FF a bad frame") + frame("out - 0.000 04"));
  EXPECT_EQ(answer("05"), "silence");
  EXPECT_EQ(answer("05"), "FF");
  EXPECT_EQ(answer("04"), "silence");
}

TEST_F(RecordedDeviceTest, ARequestThatWasNotRecordedGetsNoAnswer) {
  play(frame("out - 0.000 0230") + frame("in - 3.000 31"));
  const auto frames = frames_of("02 31 02 30");
  ASSERT_EQ(frames.size(), 2U);
  EXPECT_FALSE(frames[0].whole);
  EXPECT_EQ(to_hex(frames[0].bytes), "02 31");
  EXPECT_TRUE(frames[1].whole);
}

TEST(RecordingOfSim, NamesTheLineThatIsWrong) {
  for (const std::string& text :
       {std::string("{}"), kHead + frame("out - x 05"), kHead + frame("out - 0.0 0"),
        kHead + frame("out"), kHead + "number 0 99999999999999999999 2\n",
        kHead + frame("out - nan 05")})
    EXPECT_THROW(
        {
          try {
            parse_recording(text);
          } catch (const ConfigError& error) {
            EXPECT_TRUE(std::string(error.what()).starts_with("line ")) << error.what();
            throw;
          }
        },
        ConfigError)
        << text;
}

}  // namespace
}  // namespace fxsim
