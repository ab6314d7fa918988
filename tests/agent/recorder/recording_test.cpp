#include "agent/recorder/recording.h"

#include <gtest/gtest.h>

#include <random>

#include "protocol/catalog.h"

namespace fxagent {
namespace {

using Way = RecordedFrame::Way;

RecordedDevice device(const std::string& name, const std::string& protocol) {
  return {name, protocol, default_options(*find_protocol(protocol))};
}

RecordedFrames some_frames() {
  RecordedFrames frames{
      .devices = {device("press1", "fx-programming-port"), device("meter1", "modbus-tcp")}};
  const std::int64_t at = 1'795'716'000'123'456;
  frames.frames = {
      {Way::out, at, {}, 0, {0x05}, ""},
      {Way::in, at + 7400, std::chrono::microseconds(7400), 0, {0x06}, ""},
      {Way::failed, at + 1'000'000, std::chrono::seconds(1), 0, {}, "no bytes within 1000 ms"},
      {Way::unasked, at + 1'000'001, {}, kNoDevice, {0xFF, 0x00}, ""}};
  return frames;
}

RecordingHead head() {
  return {
      "edge7", "0.1.0", "line1", "serial /dev/ttyUSB0 9600 7E1", "asked", 1'795'716'002'000'000};
}

TEST(Recording, HasOneLineForEachFrame) {
  const std::string text = recording_text(head(), some_frames());
  EXPECT_TRUE(
      text.starts_with("fxagent-recording 1\nagent edge7 0.1.0\nlink line1\n"
                       "wire serial /dev/ttyUSB0 9600 7E1\n"))
      << text;
  EXPECT_NE(text.find("Z in 0 7.400 06\n"), text.npos) << text;
  EXPECT_NE(text.find("Z failed 0 1000.000 - no bytes within 1000 ms\n"), text.npos) << text;
  EXPECT_NE(text.find("Z unasked - 0.000 FF00\n"), text.npos) << text;
  EXPECT_NE(text.find("\nnumber 1 0 2\n"), text.npos) << "the transaction of Modbus TCP\n" << text;
  EXPECT_EQ(text.find("\nnumber 0 "), text.npos) << text;
}

TEST(Recording, ReadsWhatItWrites) {
  const RecordedFrames frames = some_frames();
  const auto read = parse_recording(recording_text(head(), frames));
  ASSERT_TRUE(read) << read.error();
  EXPECT_EQ(read->frames, frames.frames);
  EXPECT_EQ(read->devices, frames.devices);
  EXPECT_EQ(read->head.link, "line1");
  EXPECT_EQ(read->head.wire, "serial /dev/ttyUSB0 9600 7E1");
  EXPECT_EQ(read->head.reason, "asked");
  EXPECT_EQ(read->head.agent, "edge7");
  EXPECT_EQ(read->head.written_us, head().written_us);
}

TEST(Recording, DescribesEveryProtocolSoThatItsCodecCanBeMade) {
  RecordedFrames frames;
  for (const ProtocolInfo& protocol : catalog())
    frames.devices.push_back(device("d", std::string(protocol.name)));
  const auto read = parse_recording(recording_text(head(), frames));
  ASSERT_TRUE(read) << read.error();
  EXPECT_EQ(read->devices, frames.devices);
}

TEST(Recording, FindsTheNumberOfEveryProtocolThatHasOne) {
  for (const ProtocolInfo& protocol : catalog()) {
    const auto codec = protocol.make(default_options(protocol));
    ASSERT_TRUE(codec);
    const bool is_numbered = (*codec)->after_silence() == Recovery::none;
    EXPECT_EQ(number_place(**codec).size > 0, is_numbered) << protocol.name;
  }
}

TEST(Recording, ControlCharactersDoNotMakeLines) {
  RecordedFrames frames = some_frames();
  frames.frames[2].note = "a\nlink evil\x1B[2J";
  RecordingHead evil = head();
  evil.reason = "b\nlink evil";
  const std::string text = recording_text(evil, frames);
  const auto read = parse_recording(text);
  ASSERT_TRUE(read) << read.error();
  EXPECT_EQ(read->head.link, "line1");
  EXPECT_EQ(read->frames[2].note, "a?link evil?[2J");
}

TEST(Recording, AWrongLineIsNamed) {
  const std::string good = recording_text(head(), some_frames());
  const auto expect_error = [](const std::string& text, const std::string& says) {
    const auto read = parse_recording(text);
    ASSERT_FALSE(read) << text;
    EXPECT_TRUE(read.error().starts_with("line ")) << read.error();
    EXPECT_NE(read.error().find(says), std::string::npos) << read.error();
  };
  expect_error("", "a recording begins with");
  expect_error("fxagent-recording 2\n", "a newer fxagent");
  expect_error(good + "hello\n", "begins with none of");
  const std::string time = "2026-11-26T18:00:00.123456Z ";
  expect_error(good + "2026-11-26 out 0 0 05\n", "the time must be");
  expect_error(good + time + "up 0 0 05\n", "out, in, failed or unasked");
  expect_error(good + time + "out 2 0 05\n", "has no line `device`");
  expect_error(good + time + "out 0 -1 05\n", "milliseconds");
  expect_error(good + time + "out 0 nan 05\n", "milliseconds");
  expect_error(good + time + "out 0 0\n", "bytes are missing");
  expect_error(good + time + "out 0 0 0\n", "two hex digits");
  expect_error(good + time + "out 0 0 zz\n", "hex digit");
  expect_error(good + "device 7 x modbus-tcp\n", "numbered 0, 1, 2");
  expect_error(good + "device 2 x telex\n", "no such protocol");
  expect_error(good + "device 2 x modbus-tcp unit=999999\n", "out of range");
  expect_error(good + "device 2 x modbus-tcp horse=1\n", "not one of its protocol's");
  const auto large = parse_recording(std::string(kMostRecordingBytes + 1, '#'));
  ASSERT_FALSE(large);
  EXPECT_NE(large.error().find("at most"), std::string::npos);
}

TEST(Recording, AnyDamageIsAnErrorOrARecording) {
  const std::string good = recording_text(head(), some_frames());
  std::minstd_rand random(7);
  int accepted = 0;
  for (int i = 0; i < 5000; ++i) {
    std::string bad = good;
    for (int n = 0; n < 1 + i % 4; ++n) {
      const std::size_t at = random() % bad.size();
      if (random() % 2 == 0)
        bad[at] = static_cast<char>(random());
      else
        bad.erase(at, random() % 20);
    }
    const auto read = parse_recording(bad);
    accepted += read ? 1 : 0;
    if (!read) {
      EXPECT_FALSE(read.error().empty());
    }
  }
  EXPECT_GT(accepted, 0);
  EXPECT_LT(accepted, 5000);
}

}  // namespace
}  // namespace fxagent
