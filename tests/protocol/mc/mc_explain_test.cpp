// `fxagent decode` of malformed frames, and of frames that this product never sends.
#include <gtest/gtest.h>

#include <random>

#include "protocol/mc/mc.h"
#include "tests/protocol/answers.h"

namespace fxagent::mc {
namespace {

using namespace test;

Explanation told(Frame frame, const Bytes& rx, std::optional<Direction> direction = std::nullopt) {
  return Mc({.frame = frame, .model = Model::fx5u}).explain(rx, direction);
}

TEST(McExplain, ARequestIsNamedWithItsRouteDeviceAndTimer) {
  const Explanation read = told(
      Frame::e4, hex("54 00 34 12 00 00 01 02 E0 03 00 0C 00 10 00 01 04 01 00 0F 00 00 9C 03 00"));
  EXPECT_TRUE(read.ok) << read.error.value_or("");
  EXPECT_EQ(read.direction, Direction::request);
  EXPECT_EQ(read.operation, "read");
  EXPECT_EQ(read.command, "0401");
  EXPECT_EQ(read.device, "X17");
  EXPECT_EQ(read.count, 3U);
  EXPECT_EQ(field(read, "serial number"), "1234");
  EXPECT_EQ(field(read, "PC"), "02");
  EXPECT_EQ(field(read, "module I/O"), "03E0");
  EXPECT_EQ(field(read, "monitoring timer"), "4000 ms");
  const Explanation write =
      told(Frame::e3, hex("50 00 00 FF FF 03 00 0E 00 00 00 01 14 01 00 64 00 00 90 03 00 10 10"));
  EXPECT_EQ(write.values, (std::vector<std::string>{"1", "0", "1"}));
  EXPECT_EQ(field(write, "monitoring timer"), "for ever");
  const Explanation blocks =
      told(Frame::e3,
           hex("50 00 00 FF FF 03 00 1A 00 10 00 06 14 00 00 01 01 00 00 00 A8 02 00 34 12 78 "
               "56 64 00 00 90 01 00 55 AA"));
  EXPECT_TRUE(blocks.ok) << blocks.error.value_or("");
  EXPECT_EQ(blocks.device, "D0,M100");
  const std::vector<std::string> kBits = {"1", "0", "1", "0", "1", "0", "1", "0",
                                          "0", "1", "0", "1", "0", "1", "0", "1"};
  std::vector<std::string> values = {"1234", "5678"};
  values.insert(values.end(), kBits.begin(), kBits.end());
  EXPECT_EQ(blocks.values, values);
  EXPECT_EQ(blocks.count, 18U);
  // The words of a bit device are its bits: counted and shown as devices.
  const Explanation words =
      told(Frame::e3, hex("50 00 00 FF FF 03 00 0C 00 10 00 01 04 00 00 64 00 00 90 02 00"));
  EXPECT_EQ(words.device, "M100");
  EXPECT_EQ(words.count, 32U);
  EXPECT_EQ(field(words, "points"), "2 words");
  const Explanation set =
      told(Frame::e3, hex("50 00 00 FF FF 03 00 0E 00 10 00 01 14 00 00 64 00 00 90 01 00 55 AA"));
  EXPECT_EQ(set.values, kBits);
  EXPECT_EQ(set.count, 16U);
}

TEST(McExplain, AnAnswerIsItsDataOrItsReason) {
  const Explanation data = told(Frame::e3, hex("D0 00 00 FF FF 03 00 06 00 00 00 34 12 02 00"));
  EXPECT_EQ(data.operation, "data");
  EXPECT_EQ(data.values, (std::vector<std::string>{"1234", "0002"}));
  const Explanation done = told(Frame::e3, hex("D0 00 00 FF FF 03 00 02 00 00 00"));
  EXPECT_EQ(done.operation, "ack");
  const Explanation nak =
      told(Frame::e3, hex("D0 00 00 FF FF 03 00 0B 00 59 C0 01 02 E0 03 00 01 04 02 00"));
  EXPECT_EQ(nak.operation, "nak");
  EXPECT_EQ(nak.values, std::vector<std::string>{"C059"});
  expect_says(field(nak, "reason"), "does not have the command");
  EXPECT_EQ(field(nak, "refused by"), "network 1, PC 02, module I/O 03E0, station 00");
  EXPECT_EQ(field(nak, "refused command"), "0401, subcommand 0002");
  const Explanation part = told(Frame::e3, hex("D0 00 00 FF FF 03 00 04 00 59 C0 01 02"));
  EXPECT_TRUE(part.ok);
  EXPECT_EQ(field(part, "part of the error information"), "01 02");
  const Explanation type =
      told(Frame::e3,
           hex("D0 00 00 FF FF 03 00 14 00 00 00 51 30 32 55 43 50 55 20 20 20 20 20 20 20 20 "
               "20 63 02"));
  EXPECT_EQ(field(type, "type name, if it is one"), "Q02UCPU         ");
}

TEST(McExplain, WhatIsWrongWithAFrameIsSaid) {
  struct Case {
    Frame frame;
    Bytes rx;
    const char* error;
  };
  const Case cases[] = {
      {Frame::e3, {}, "shorter than its header"},
      {Frame::e3, hex("50 00 00 FF FF 03 00 0C 00 10 00"), "shorter than its header"},
      {Frame::e3, hex("54 00 34 12 00 00 00 FF FF 03 00 02 00 10 00"), "mc-4e"},
      {Frame::e4, ascii("D00000FF03FF0000040000"), "mc-3e"},
      {Frame::e3, hex("D0 00 00 FF FF 03 00 02 00 00 00 11"), "1 bytes follow"},
      {Frame::e3, ascii("D00000FF03FF0000040G00"), "not hex digits"},
      {Frame::e3, hex("50 00 00 FF FF 03 00 04 00 10 00 01 04"), "before the subcommand"},
      {Frame::e3, hex("50 00 00 FF FF 03 00 08 00 10 00 01 04 00 00 64 00"), "its devices"},
      {Frame::e3, hex("50 00 00 FF FF 03 00 0C 00 10 00 01 04 00 00 64 00 00 87 01 00"),
       "not a device"},
      {Frame::e3, hex("50 00 00 FF FF 03 00 0C 00 10 00 01 04 00 00 64 00 00 A8 00 00"),
       "a request for no points"},
      {Frame::e3, hex("50 00 00 FF FF 03 00 0D 00 10 00 01 04 00 00 64 00 00 A8 01 00 00"),
       "1 characters more"},
      {Frame::e3, hex("50 00 00 FF FF 03 00 0C 00 10 00 01 14 00 00 64 00 00 A8 01 00"),
       "before its data"},
      {Frame::e3, hex("50 00 00 FF FF 03 00 0D 00 10 00 01 14 01 00 64 00 00 90 01 00 20"),
       "bits are 0 and 1"},
      {Frame::e3, hex("50 00 00 FF FF 03 00 0E 00 10 00 06 04 00 00 01 00 64 00 00 90 01 00"),
       "M100 among the blocks of words"},
      {Frame::e3, ascii("500000FF03FF000018001004010000Q*0000000004"), "not a device"},
      {Frame::e3, ascii("500000FF03FF000018001004010000D*00000X0004"), "not a device"},
      {Frame::c3, ascii("F9"), "too short"},
      {Frame::c3, ascii("F90000FF00"), "begins with ENQ"},
      {Frame::c3, ascii("%F70000FF00"), "no frame id"},
      {Frame::c3, ascii("+F80000FF03FF0000"), "mc-4c"},
      {Frame::c4, ascii("+F90000FF00"), "mc-3c"},
      {Frame::c3, ascii("+F9000"), "ends in its route"},
      {Frame::c3, ascii("+F9XX00FF00"), "route is not hex"},
      {Frame::c3, ascii("+F90000FF00A"), "more than an acknowledgement"},
      {Frame::c3, ascii("-F90000FF0071"), "four hex digits"},
      {Frame::c3, ascii("<F90000FF001234"), "no ETX"},
      {Frame::c3, ascii("<F90000FF001234>1"), "two characters of sum"},
      {Frame::c3, ascii("<F90000FF0012340002>BB"), "sum BB given, BA computed"},
      {Frame::c3, ascii("%F90000FF0004010000M*00010000020B"), "sum 0B given, 0A computed"},
      {Frame::c4, hex("10 02 12 00"), "from 10 02 to 10 03"},
      {Frame::c4, hex("10 02 10 03"), "too short for its length"},
      {Frame::c4, hex("10 02 00 00 10 03"), "no frame id"},
      {Frame::c4, hex("10 02 0C 00 F8 00 00 FF FF 03 00 00 FF FF 00 00 10 03 31"),
       "two characters"},
      {Frame::c4, hex("10 02 0D 00 F8 00 00 FF FF 03 00 00 FF FF 00 00 10 03 30 34"), "length 13"},
  };
  for (const Case& c : cases) {
    SCOPED_TRACE(to_hex(c.rx));
    const Explanation out = told(c.frame, c.rx);
    EXPECT_FALSE(out.ok);
    expect_says(out.error.value_or(""), c.error);
  }
}

TEST(McExplain, TheDirectionThatIsAskedForCounts) {
  EXPECT_FALSE(told(Frame::e3, hex("D0 00 00 FF FF 03 00 02 00 00 00"), Direction::request).ok);
  EXPECT_FALSE(
      told(Frame::e3, hex("50 00 00 FF FF 03 00 06 00 10 00 01 01 00 00"), Direction::reply).ok);
  // In format 3 a request and a data frame may look alike.
  const Bytes both = ascii("<F90000FF0001010000>");
  const Explanation likelier = told(Frame::c3, both);
  EXPECT_TRUE(likelier.ambiguous);
  EXPECT_EQ(likelier.direction, Direction::request);
  EXPECT_EQ(field(likelier, "frame"), "3C in format 3");
  EXPECT_EQ(told(Frame::c3, both, Direction::reply).operation, "data");
}

TEST(McExplain, SumsMayBeMissing) {
  EXPECT_TRUE(told(Frame::c3, ascii("%F90000FF0004010000M*0001000002")).ok);
  const Explanation five =
      told(Frame::c4, hex("10 02 0C 00 F8 00 00 FF FF 03 00 00 FF FF 00 00 10 03"));
  EXPECT_TRUE(five.ok) << five.error.value_or("");
  EXPECT_FALSE(five.checksum_given);
}

TEST(McExplain, DamagedFramesAreExplainedAndDecodedWithoutHarm) {
  std::mt19937 random(1);
  for (const auto& [name, frame] : {std::pair{"mc_3e.txt", Frame::e3},
                                    {"mc_4e.txt", Frame::e4},
                                    {"mc_3c.txt", Frame::c3},
                                    {"mc_4c.txt", Frame::c4}}) {
    for (const test::Exchange& e : test::read_frames(name)) {
      for (Bytes rx : {e.request, e.reply}) {
        for (int i = 0; i < 200 && !rx.empty(); ++i) {
          Bytes damaged = rx;
          damaged[random() % damaged.size()] = static_cast<std::uint8_t>(random());
          if (i % 3 == 0) damaged.resize(random() % (damaged.size() + 1));
          const Explanation out =
              Mc({.frame = frame, .model = Model::iq_r}).explain(damaged, std::nullopt);
          EXPECT_EQ(out.ok, !out.error.has_value());
          for (std::uint32_t format = 1; format <= 5; ++format) {
            Mc::Settings settings;
            settings.frame = frame;
            settings.format = frame == Frame::c4 ? format : std::min(format, 4U);
            settings.code = format % 2 == 0 ? Code::ascii : Code::binary;
            const auto reply =
                Mc(settings).decode(Read{{id(Space::d), 0, 32}, kWordWay}, 1, damaged);
            if (reply && *reply && (*reply)->kind == Reply::Kind::data) {
              EXPECT_EQ((*reply)->image.size(), 4U);
            }
          }
        }
      }
    }
  }
}

}  // namespace
}  // namespace fxagent::mc
