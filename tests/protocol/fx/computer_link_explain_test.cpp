#include <gtest/gtest.h>

#include "protocol/fx/computer_link.h"
#include "tests/protocol/answers.h"

namespace fxagent::fx {
namespace {

using namespace test;
using Values = std::vector<std::string>;

Explanation explained(Model model, ByteView frame, std::optional<Direction> direction) {
  return ComputerLink({.model = model}).explain(frame, direction);
}

Explanation explain(std::string_view frame, std::optional<Direction> direction = {}) {
  return explained(Model::unknown_fx, ascii(frame), direction);
}

/// Explains a frame of the first character, the text and the correct sum.
Explanation summed(std::string_view text) {
  Bytes frame = ascii(text);
  append_hex(frame, byte_sum(ByteView(frame).subspan(1)), 2);
  return explained(Model::unknown_fx, frame, std::nullopt);
}

TEST(LinkExplanation, NamesEveryFrameOfTheTranscripts) {
  for (const test::Exchange& e : test::read_frames("fx_computer_link.txt")) {
    SCOPED_TRACE(e.where());
    const auto model = *model_named(e.model);
    const auto out = explained(model, e.request, std::nullopt);
    if (e.operation == "sum_only") {
      EXPECT_FALSE(out.ok);
      continue;
    }
    ASSERT_TRUE(out.ok) << out.error.value_or("");
    const bool by_plc = e.operation == "on_demand";
    EXPECT_EQ(out.direction, by_plc ? Direction::reply : Direction::request);
    EXPECT_EQ(out.checksum_given, out.checksum_computed);
    if (e.device != "-" && e.operation != "nak") {
      EXPECT_EQ(out.device, e.device);
    }
    EXPECT_FALSE(explained(model, e.request, by_plc ? Direction::request : Direction::reply).ok);
    if (e.reply.empty()) continue;
    const auto reply = explained(model, e.reply, Direction::reply);
    EXPECT_TRUE(reply.ok) << reply.error.value_or("");
    EXPECT_EQ(reply.operation, e.reply[0] == 0x02 ? "data" : e.reply[0] == 0x06 ? "ack" : "nak");
  }
}

TEST(LinkExplanation, AReadOfBitsSaysAllOfIt) {
  const auto out = explain("%05FFBRAX00400547");
  EXPECT_TRUE(out.ok);
  EXPECT_FALSE(out.ambiguous);
  EXPECT_EQ(out.operation, "read");
  EXPECT_EQ(out.command, "BR");
  EXPECT_EQ(out.device, "X40");
  EXPECT_EQ(out.count, 5U);
  EXPECT_EQ(out.checksum_given, "47");
  EXPECT_EQ(field(out, "station"), "5");
  EXPECT_EQ(field(out, "message wait"), "100 ms");
  EXPECT_EQ(field(out, "PLC number"), "FF");
}

TEST(LinkExplanation, WordsOfABitDeviceAreItsBits) {
  const auto out = summed("%00FFWW0M0640018001");
  EXPECT_EQ(out.count, 16U);
  ASSERT_EQ(out.values.size(), 16U);
  EXPECT_EQ(out.values.front(), "1");
  EXPECT_EQ(out.values[1], "0");
  EXPECT_EQ(out.values.back(), "1");
  EXPECT_EQ(field(out, "data"), "8001");
  EXPECT_EQ(summed("%00FFWW0D0000021234ACD7").values, (Values{"1234", "ACD7"}));
  EXPECT_EQ(summed("%00FFWW0CN2000112345678").values, Values{"12345678"});
}

TEST(LinkExplanation, ScatteredDevicesAreAllNamed) {
  const auto out = summed("%05FFQT002R0120001234Y000100BCA9");
  EXPECT_TRUE(out.ok);
  EXPECT_EQ(out.device, "R12000,Y100");
  EXPECT_EQ(out.count, 2U);
  EXPECT_EQ(field(out, "Y100"), "BCA9");
}

// JY997D16901 7.7.2: extension registers have only names of seven characters, in QR, QW and QT.
TEST(LinkExplanation, ExtensionRegistersAreNamedInSevenCharactersOnly) {
  for (const std::string_view text :
       {"00FFWR0R000002", "00FFWW0R0000011234", "00FFWT001R00001234"}) {
    const auto out = summed("%" + std::string(text));
    EXPECT_FALSE(out.ok) << text;
    expect_says(out.error.value_or(""), "'R0000' is not a device");
  }
  const auto read = summed("%00FFQR0R00000002");
  EXPECT_TRUE(read.ok) << read.error.value_or("");
  EXPECT_EQ(read.device, "R0");
  EXPECT_FALSE(summed("%00FFQR0R03276801").ok) << "R32767 is the last one";
}

TEST(LinkExplanation, DataAreWordsBitsAModelOrAText) {
  EXPECT_EQ(summed("<00FF1234ABCD>").values, (Values{"1234", "ABCD"}));
  EXPECT_EQ(summed("<00FF01101>").values, (Values{"0", "1", "1", "0", "1"}));
  EXPECT_EQ(field(summed("<00FFF3>"), "answer to PC"), "FX3U");
  EXPECT_EQ(field(summed("<00FF8D>"), "answer to PC"), "an unknown model");
  EXPECT_EQ(field(summed("<00FF05ABXYE>"), "answer to TT"), "ABXYE");
  EXPECT_EQ(field(summed("<00FE12345678>"), "PLC number"), "FE, sent on demand");
  EXPECT_EQ(summed("<00FF12XY5>").error, "the data are neither words nor bits");
}

TEST(LinkExplanation, AnAckMayComeFromEitherSide) {
  const auto ack = explain("+00FF");
  EXPECT_TRUE(ack.ok);
  EXPECT_TRUE(ack.ambiguous);
  EXPECT_EQ(ack.direction, Direction::reply);
  EXPECT_EQ(ack.operation, "ack");
  EXPECT_TRUE(explain("+00FF\r\n", Direction::request).ok);
  const auto nak = explain("-00FF06");
  EXPECT_EQ(nak.operation, "nak");
  EXPECT_EQ(field(nak, "reason"), "06, the device does not exist, or too many points");
  EXPECT_EQ(explain("-00FF").direction, Direction::request);
  EXPECT_FALSE(explain("-00FF", Direction::reply).ok);
  EXPECT_FALSE(explain("-00FF06", Direction::request).ok);
}

TEST(LinkExplanation, CrLfAndAMissingSumAreSaid) {
  const auto out = explain("%00FFRR0\r\n");
  EXPECT_TRUE(out.ok);
  EXPECT_EQ(field(out, "end"), "CR LF: format 4");
  EXPECT_EQ(field(out, "sum"), "none");
  EXPECT_FALSE(out.checksum_given);
}

TEST(LinkExplanation, WhatIsWrongIsSaid) {
  const auto error = [](std::string_view frame) { return explain(frame).error.value_or("good"); };
  EXPECT_EQ(error(""), "no bytes");
  EXPECT_EQ(error("A"), "a frame begins with ENQ, STX, ACK, NAK, EOT or CL, not with 41");
  EXPECT_EQ(error("%00"), "station and PLC number are four hex digits");
  EXPECT_EQ(error("%00FFBR"), "the request is truncated");
  EXPECT_EQ(error("%00F1RR0"), "the PLC number of an FX is FF");
  EXPECT_EQ(error("%00FFJR0"), "'JR' is not a command of an FX");
  EXPECT_EQ(error("%00FFRRX"), "the message wait is not a hex digit");
  EXPECT_EQ(error("%00FFRR0C9"), "sum C9 given, C0 computed");
  EXPECT_EQ(error("%00FFRR0C"), "1 characters are left over; a sum has two");
  EXPECT_EQ(error("%00FFBR0X008001"), "'X0080' is not a device of 5 characters on this model");
  EXPECT_EQ(error("%00FFBR0T012301"), "'T0123' is not a device of 5 characters on this model");
  EXPECT_EQ(error("%00FFBR0X00"), "the request is truncated");
  EXPECT_EQ(error("%00FFBR0D012301"), "D123 is a word, not a bit");
  EXPECT_EQ(error("%00FFWR0TS12301"),
            "contacts of timers and counters can only be accessed bit by bit");
  EXPECT_EQ(error("%00FFWR0D012300"), "the number of points is not two hex digits from 01 up");
  EXPECT_EQ(error("%00FFWW0D01230212340"), "5 data characters given, 8 expected");
  EXPECT_EQ(error("%00FFBW0M0123022101"), "the data are not 0 and 1");
  EXPECT_EQ(error("%00FFBT002M01231"), "only 1 of 2 points are present");
  EXPECT_EQ(error("%00FFBT001D01231"), "'D0123' is not a device for this command");
  EXPECT_EQ(error("%00FFWT001CN20012345678"), "'CN200' is not a device for this command");
  EXPECT_EQ(error("%00FFBT001M01232"), "'2' is not a value of M123");
  EXPECT_EQ(error("%FFFFGW02"), "the flag is neither 0 nor 1");
  EXPECT_EQ(error("%00FFTT005ABC"), "the text is shorter than its length says");
  EXPECT_EQ(error("<00FF1234"), "there is no ETX (03)");
  EXPECT_EQ(error("<00FF>00"), "there are no data");
  EXPECT_EQ(error("+00FF00"), "'00' must not follow an ACK");
  EXPECT_EQ(field(explain("\x04"), "meaning"),
            "ends the transmission; each station waits for a new request");
  EXPECT_EQ(error("\x04"
                  "00"),
            "nothing follows EOT and CL");
}

}  // namespace
}  // namespace fxagent::fx
