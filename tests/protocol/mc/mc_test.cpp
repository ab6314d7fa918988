// mc-3e and mc-4e beyond the transcripts: requests, accepted answers, and reactions to refusals.
#include "protocol/mc/mc.h"

#include <gtest/gtest.h>

#include <array>

#include "protocol/mc/message.h"
#include "tests/protocol/answers.h"

namespace fxagent::mc {
namespace {

using namespace test;

constexpr std::uint16_t kD = id(Space::d);
constexpr std::uint16_t kM = id(Space::m);

Mc codec(Frame frame, Model model = Model::fx5u, Code code = Code::binary) {
  return Mc({.frame = frame, .model = model, .code = code});
}

std::string sent(const Mc& mc, const Request& request, std::uint16_t tag = 1) {
  const auto frame = mc.encode(request, tag);
  return frame ? to_hex(*frame) : frame.error().text;
}

/// Returns the message of a binary 3E request, after the timer.
std::string message(const Mc& mc, const Request& request) {
  const auto frame = mc.encode(request, 1);
  EXPECT_TRUE(frame) << frame.error().text;
  return frame ? to_hex(ByteView(*frame).subspan(11)) : std::string();
}

std::string why_not(const Mc& mc, const Request& request) {
  return error_of(mc.encode(request, 1)).text;
}

std::string fault(const Mc& mc, const Request& request, std::string_view rx,
                  std::uint16_t tag = 1) {
  return test::fault(mc, request, hex(rx), tag);
}

const Request kTwoWords = Read{{kD, 1600, 32}, kWordWay};
const Request kWrite = Write{{kD, 1600, 16}, {0x34, 0x12}};

// ---- accepted answers --------------------------------------------------------------------------

TEST(Mc3E, AnAnswerOfAnotherLengthIsNeverAValue) {
  const Mc mc = codec(Frame::e3);
  expect_says(fault(mc, kTwoWords, "D0 00 00 FF FF 03 00 04 00 00 00 34 12"), "2 characters");
  expect_says(fault(mc, kTwoWords, "D0 00 00 FF FF 03 00 08 00 00 00 34 12 78 56 00 00"),
              "6 characters");
  expect_says(fault(mc, kTwoWords, "D0 00 00 FF FF 03 00 02 00 00 00"), "0 characters");
  expect_says(fault(mc, kWrite, "D0 00 00 FF FF 03 00 04 00 00 00 34 12"), "0 expected");
  // Wrong lengths: the codec waits if a length is too long, and rejects impossible ones at once.
  EXPECT_TRUE(needs_more(mc, kTwoWords, hex("D0 00 00 FF FF 03 00 07 00 00 00 34 12 78 56")));
  expect_says(fault(mc, kTwoWords, "D0 00 00 FF FF 03 00 01 00 00"), "length 1");
  expect_says(fault(mc, kTwoWords, "D0 00 00 FF FF 03 00 FF FF 00"), "length 65535");
}

TEST(Mc3E, AnAnswerOfAnotherStationIsNeverAValue) {
  const Mc mc = codec(Frame::e3);
  for (const char* rx : {"D0 00 01 FF FF 03 00 06 00 00 00 34 12 78 56",
                         "D0 00 00 01 FF 03 00 06 00 00 00 34 12 78 56",
                         "D0 00 00 FF E0 03 00 06 00 00 00 34 12 78 56",
                         "D0 00 00 FF FF 03 01 06 00 00 00 34 12 78 56"})
    expect_says(fault(mc, kTwoWords, rx), "an answer for network");
  expect_says(fault(mc, kWrite, "D0 00 00 01 FF 03 00 02 00 00 00"), "PC FF");
}

TEST(Mc3E, AFrameOfAnotherKindIsNamedWithTheSettingThatFitsIt) {
  const Mc mc = codec(Frame::e3);
  expect_says(fault(mc, kTwoWords, "D4 00 01 00 00 00 00 FF FF 03 00 02 00 00 00"), "mc-4e");
  expect_says(fault(codec(Frame::e4), kTwoWords, "D0 00 00 FF FF 03 00 02 00 00 00"), "mc-3e");
  expect_says(fault(mc, kTwoWords, "44 30 30 30 30 30 46 46"), "in ASCII code: set `code`");
  const Mc ascii = codec(Frame::e3, Model::fx5u, Code::ascii);
  expect_says(fault(ascii, kTwoWords, "D0 00 00 FF FF 03 00 02 00 00 00"), "in binary code");
  expect_says(fault(mc, kTwoWords, "D0 50"), "mc-1e");
  expect_says(fault(ascii, kTwoWords, "44 30 35 30"), "mc-1e");
  expect_says(fault(mc, kTwoWords, "15 FF FF FF"), "subheader 15 FF FF FF");
  EXPECT_TRUE(needs_more(mc, kTwoWords, hex("D0")));
  EXPECT_TRUE(needs_more(mc, kTwoWords, hex("44 30")));
  EXPECT_TRUE(needs_more(ascii, kTwoWords, hex("44 30 30")));
}

TEST(Mc3E, ErrorInformationMayBeWholeInPartOrMissing) {
  const Mc mc = codec(Frame::e3);
  for (const char* rx :
       {"D0 00 00 FF FF 03 00 0B 00 56 C0 00 FF FF 03 00 01 04 00 00",
        "D0 00 00 FF FF 03 00 0B 00 56 C0 01 05 E0 03 02 01 04 00 00",
        "D0 00 00 FF FF 03 00 05 00 56 C0 00 FF FF", "D0 00 00 FF FF 03 00 02 00 56 C0",
        "D0 00 00 FF FF 03 00 0D 00 56 C0 00 FF FF 03 00 01 04 00 00 11 22"}) {
    const Reply reply = answer(mc, kTwoWords, hex(rx));
    EXPECT_EQ(reply.kind, Reply::Kind::nak);
    EXPECT_EQ(reply.device_code, 0xC056);
    EXPECT_EQ(reply.text, "end code C056: beyond the last device");
    EXPECT_TRUE(reply.image.empty());
  }
  // An error for another command is an answer to an earlier request.
  expect_says(fault(mc, kTwoWords, "D0 00 00 FF FF 03 00 0B 00 56 C0 00 FF FF 03 00 01 14 00 00"),
              "for another command: 01 14");
}

TEST(Mc3E, ErrorInformationInAsciiIsReadAsDigits) {
  const Mc mc = codec(Frame::e3, Model::fx5u, Code::ascii);
  const auto bytes = [](std::string_view text) { return Bytes(text.begin(), text.end()); };
  const Reply reply = answer(mc, kTwoWords, bytes("D00000FF03FF000016C05100FF03FF0004010000"));
  EXPECT_EQ(reply.device_code, 0xC051);
  EXPECT_EQ(answer(mc, kTwoWords, bytes("d00000ff03ff000004c056")).device_code, 0xC056);
  expect_says(error_of(mc.decode(kTwoWords, 1, bytes("D00000FF03FF00000C0000123456XY"))).text,
              "not two hex digits");
  EXPECT_FALSE(mc.decode(kTwoWords, 1, bytes("D00000FF03FF00000C00X012345678")));
  EXPECT_FALSE(mc.decode(kTwoWords, 1, bytes("D00000FF0XFF00000C000012345678")));
  EXPECT_EQ(answer(mc, kTwoWords, bytes("D00000FF03FF00000C00001234abcd")).image,
            hex("34 12 CD AB"));
}

TEST(Mc3E, BitsThatAreNeitherZeroNorOneAreNoValue) {
  const Request bits = Read{{kM, 100, 3}, kBitWay};
  const Mc mc = codec(Frame::e3);
  EXPECT_EQ(answer(mc, bits, hex("D0 00 00 FF FF 03 00 04 00 00 00 10 10")).image, hex("05"));
  // The padding after an odd count may have any value.
  EXPECT_EQ(answer(mc, bits, hex("D0 00 00 FF FF 03 00 04 00 00 00 10 1F")).image, hex("05"));
  expect_says(fault(mc, bits, "D0 00 00 FF FF 03 00 04 00 00 00 12 00"), "neither 0 nor 1");
}

TEST(Mc3E, AfterSilenceTheConnectionEndsForAnAnswerHasNoNumber) {
  EXPECT_EQ(codec(Frame::e3).after_silence(), Recovery::reconnect);
  EXPECT_EQ(codec(Frame::e3).after_nonsense(), Recovery::reconnect);
  EXPECT_EQ(codec(Frame::e4).after_silence(), Recovery::none);
  EXPECT_EQ(codec(Frame::e4).after_nonsense(), Recovery::reconnect);
  EXPECT_EQ(codec(Frame::c4).after_silence(), Recovery::drain);
  EXPECT_EQ(codec(Frame::c3).after_nonsense(), Recovery::drain);
}

TEST(Mc4E, AnswersWithOtherNumbersArePassedOverHoweverMany) {
  const Mc mc = codec(Frame::e4);
  const Bytes late = hex("D4 00 FF FF 00 00 00 FF FF 03 00 06 00 00 00 11 11 22 22");
  const Bytes refused = hex("D4 00 02 00 00 00 00 FF FF 03 00 02 00 56 C0");
  const Bytes other_station = hex("D4 00 03 00 00 00 01 01 FF 03 00 06 00 00 00 11 11 22 22");
  const Bytes own = hex("D4 00 00 01 00 00 00 FF FF 03 00 06 00 00 00 34 12 78 56");
  Bytes rx;
  for (const Bytes* part : {&late, &refused, &other_station, &late})
    rx.insert(rx.end(), part->begin(), part->end());
  EXPECT_TRUE(needs_more(mc, kTwoWords, rx, 0x0100));
  const std::size_t began = rx.size();
  rx.insert(rx.end(), own.begin(), own.end());
  const Reply reply = answer(mc, kTwoWords, rx, 0x0100);
  EXPECT_EQ(reply.image, hex("34 12 78 56"));
  EXPECT_EQ(reply.began, began);
  EXPECT_EQ(reply.consumed, rx.size());
  // Even with the right number, everything else must match.
  expect_says(
      fault(mc, kTwoWords, "D4 00 00 01 00 00 01 FF FF 03 00 06 00 00 00 34 12 78 56", 0x0100),
      "network 1");
}

TEST(Mc3E, WhatTheAgentSaysOfWholeFramesItMayPassForAnAnswer) {
  const Mc mc = codec(Frame::e3);
  EXPECT_TRUE(mc.may_pass_for_answer(hex("01 D0 00")));
  EXPECT_TRUE(mc.may_pass_for_answer(hex("01 D0")));
  EXPECT_FALSE(mc.may_pass_for_answer(hex("50 00 00 FF")));
  const Mc ascii = codec(Frame::e3, Model::fx5u, Code::ascii);
  for (const std::string_view text : {"D000", "d000", "xd0", "d"})
    EXPECT_TRUE(ascii.may_pass_for_answer(Bytes(text.begin(), text.end()))) << text;
  EXPECT_FALSE(ascii.may_pass_for_answer(Bytes{'5', '0', '0', '0'}));
  EXPECT_TRUE(codec(Frame::e4).may_pass_for_answer(hex("01")));
}

// ---- requests ----------------------------------------------------------------------------------

TEST(McMessages, SeriesDecideCodesAndNumbers) {
  const Request read = Read{{kD, 1600, 16}, kWordWay};
  EXPECT_EQ(message(codec(Frame::e3, Model::fx5u), read), "01 04 00 00 64 00 00 A8 01 00");
  EXPECT_EQ(message(codec(Frame::e3, Model::q), read), "01 04 00 00 64 00 00 A8 01 00");
  EXPECT_EQ(message(codec(Frame::e3, Model::unknown), read), "01 04 00 00 64 00 00 A8 01 00");
  EXPECT_EQ(message(codec(Frame::e3, Model::iq_r), read), "01 04 02 00 64 00 00 00 A8 00 01 00");
  const Request x17 = Read{{id(Space::x), 017, 1}, kBitWay};
  EXPECT_EQ(message(codec(Frame::e3, Model::fx5u), x17), "01 04 01 00 0F 00 00 9C 01 00");
}

TEST(McMessages, LongDevicesGoByRandomReadAsDoubleWords) {
  const Mc mc = codec(Frame::e3);
  const Request counters = Read{{id(Space::lcn), 64, 64}, kDwordWay};
  EXPECT_EQ(message(mc, counters), "03 04 00 00 00 02 02 00 00 56 03 00 00 56");
  EXPECT_EQ(
      answer(mc, counters, hex("D0 00 00 FF FF 03 00 0A 00 00 00 78 56 34 12 01 00 00 00")).image,
      hex("78 56 34 12 01 00 00 00"));
  EXPECT_EQ(message(mc, Write{{id(Space::lz), 32, 32}, {0x78, 0x56, 0x34, 0x12}}),
            "02 14 00 00 00 01 01 00 00 62 78 56 34 12");
  EXPECT_EQ(message(codec(Frame::e3, Model::iq_r), Read{{id(Space::ltn), 0, 32}, kDwordWay}),
            "03 04 02 00 00 01 00 00 00 00 52 00");
}

TEST(McMessages, WritesTakeExactlyTheirBits) {
  const Mc mc = codec(Frame::e3);
  EXPECT_EQ(message(mc, Force{kM, 8, true}), "01 14 01 00 08 00 00 90 01 00 10");
  EXPECT_EQ(message(mc, Force{kM, 8, false}), "01 14 01 00 08 00 00 90 01 00 00");
  EXPECT_EQ(message(mc, Write{{kM, 3, 5}, {0x15}}), "01 14 01 00 03 00 00 90 05 00 10 10 10");
  EXPECT_EQ(message(mc, Write{{kM, 3, 16}, {0x34, 0x12}}), "01 14 00 00 03 00 00 90 01 00 34 12");
  expect_says(why_not(mc, Force{kD, 8, true}), "only whole words");
  expect_says(why_not(mc, Write{{kD, 8, 16}, {1, 2}}), "whole words");
  expect_says(why_not(mc, Write{{kD, 0, 32}, {1, 2}}), "32 bits with 2 bytes");
  expect_says(why_not(mc, Write{{kD, 7999 * 16, 32}, {1, 2, 3, 4}}), "does not exist");
  expect_says(why_not(mc, Write{{id(Space::sm), 8037, 1}, {1}}), "cannot be written by address");
  expect_says(why_not(mc, Enquire{}), "no enquiry");
  expect_says(why_not(mc, Control{Control::Kind::reset}), "no reset");
}

TEST(McMessages, TheLimitsAreThoseOfTheSeries) {
  struct Case {
    Model model;
    Code code;
    std::uint32_t words, bits;
  };
  for (const Case& c :
       {Case{Model::fx5u, Code::binary, 960, 3584}, Case{Model::fx5u, Code::ascii, 480, 1792},
        Case{Model::q, Code::binary, 960, 7168}, Case{Model::q, Code::ascii, 960, 3584},
        Case{Model::iq_r, Code::binary, 960, 7168}, Case{Model::unknown, Code::ascii, 480, 1792}}) {
    const Mc mc = codec(Frame::e3, c.model, c.code);
    EXPECT_TRUE(mc.encode(Read{{kD, 0, c.words * 16}, kWordWay}, 1));
    expect_says(why_not(mc, Read{{kD, 0, (c.words + 1) * 16}, kWordWay}), "at most");
    EXPECT_TRUE(mc.encode(Read{{kM, 0, c.bits}, kBitWay}, 1));
    expect_says(why_not(mc, Read{{kM, 0, c.bits + 1}, kBitWay}), "at most");
    EXPECT_TRUE(mc.encode(Write{{kD, 0, c.words * 16}, Bytes(c.words * 2)}, 1));
    expect_says(why_not(mc, Write{{kD, 0, (c.words + 1) * 16}, Bytes(c.words * 2 + 2)}), "at most");
    EXPECT_FALSE(mc.encode(Write{{kM, 0, c.bits + 1}, Bytes(c.bits / 8 + 1)}, 1));
    EXPECT_LE(mc.max_write_bits(kD), c.words * 16);
    EXPECT_EQ(mc.max_write_bits(kM), c.bits);
  }
  EXPECT_EQ(codec(Frame::e3).max_write_bits(99), 0U);
  EXPECT_TRUE(codec(Frame::e3).read_ways(99).empty());
  EXPECT_TRUE(codec(Frame::e3, Model::q).read_ways(id(Space::lcn)).empty());
}

TEST(McMessages, RandomReadsAndBlocksHaveTheirOwnLimits) {
  const auto gather = [](std::uint32_t parts, std::uint8_t way, std::uint8_t command) {
    Gather all;
    for (std::uint32_t i = 0; i < parts; ++i) all.parts.push_back({{kD, i * 64, 16}, way, command});
    return all;
  };
  const Mc fx5 = codec(Frame::e3);
  const Mc iq_r = codec(Frame::e3, Model::iq_r);
  EXPECT_TRUE(fx5.encode(gather(192, kRandomWay, kRandomRead), 1));
  EXPECT_FALSE(fx5.encode(gather(193, kRandomWay, kRandomRead), 1));
  EXPECT_TRUE(iq_r.encode(gather(96, kRandomWay, kRandomRead), 1));
  EXPECT_FALSE(iq_r.encode(gather(97, kRandomWay, kRandomRead), 1));
  EXPECT_TRUE(fx5.encode(gather(120, kBlockWay, kBlockRead), 1));
  EXPECT_FALSE(fx5.encode(gather(121, kBlockWay, kBlockRead), 1));
  EXPECT_TRUE(iq_r.encode(gather(60, kBlockWay, kBlockRead), 1));
  EXPECT_FALSE(iq_r.encode(gather(61, kBlockWay, kBlockRead), 1));
  // Built-in ports of Q and L lack 0406; an unknown model may lack it.
  EXPECT_FALSE(codec(Frame::e3, Model::q).encode(gather(2, kBlockWay, kBlockRead), 1));
  EXPECT_EQ(codec(Frame::e3, Model::unknown).gathers().size(), 1U);
  Gather both = gather(1, kRandomWay, kRandomRead);
  both.parts.push_back({{kD, 0, 16}, kBlockWay, kBlockRead});
  expect_says(why_not(fx5, both), "do not fit in one frame");
  expect_says(why_not(fx5, Gather{}), "nothing");
  const Request contact = Gather{{Read{{id(Space::ts), 0, 16}, kRandomWay, kRandomRead}}};
  EXPECT_FALSE(fx5.encode(contact, 1));
}

TEST(McMessages, PartsOfAGatherComeBackInTheirOwnOrder) {
  const Mc mc = codec(Frame::e3);
  const Request random = Gather{{Read{{kD, 0, 32}, kRandomWay, kRandomRead},
                                 Read{{kM, 5, 16}, kRandomWay, kRandomRead},
                                 Read{{id(Space::lcn), 0, 32}, kRandomWay, kRandomRead}}};
  EXPECT_EQ(message(mc, random), "03 04 00 00 01 02 05 00 00 90 00 00 00 A8 00 00 00 56");
  EXPECT_EQ(
      answer(mc, random, hex("D0 00 00 FF FF 03 00 0C 00 00 00 05 06 01 02 03 04 11 12 13 14"))
          .image,
      hex("01 02 03 04 05 06 11 12 13 14"));
  const Request blocks =
      Gather{{Read{{kM, 16, 32}, kBlockWay, kBlockRead}, Read{{kD, 0, 48}, kBlockWay, kBlockRead}}};
  EXPECT_EQ(message(mc, blocks), "06 04 00 00 01 01 00 00 00 A8 03 00 10 00 00 90 02 00");
  EXPECT_EQ(
      answer(mc, blocks, hex("D0 00 00 FF FF 03 00 0C 00 00 00 01 02 03 04 05 06 11 12 13 14"))
          .image,
      hex("11 12 13 14 01 02 03 04 05 06"));
  const Mc ascii = codec(Frame::e3, Model::fx5u, Code::ascii);
  const std::string_view text = "D00000FF03FF00000C000056781234";
  const Request dword = Gather{{Read{{kD, 0, 32}, kRandomWay, kRandomRead}}};
  EXPECT_EQ(answer(ascii, dword, Bytes(text.begin(), text.end())).image, hex("34 12 78 56"));
}

TEST(McMessages, WritesToScatteredPlacesGoTogetherWhereOneFrameCarriesThem) {
  const Mc mc = codec(Frame::e3);
  const auto bits = mc.combine({Force{kM, 1, true}, Write{{kM, 20, 2}, {0x02}}});
  ASSERT_TRUE(bits);
  EXPECT_EQ(message(mc, *bits), "02 14 01 00 03 01 00 00 90 01 14 00 00 90 00 15 00 00 90 01");
  const auto words = mc.combine({Write{{kD, 0, 48}, {1, 2, 3, 4, 5, 6}}, kWrite});
  ASSERT_TRUE(words);
  EXPECT_EQ(message(mc, *words),
            "02 14 00 00 02 01 02 00 00 A8 05 06 64 00 00 A8 34 12 00 00 00 A8 01 02 03 04");
  EXPECT_FALSE(mc.combine({kWrite, Force{kM, 1, true}}));  // bits and words
  EXPECT_FALSE(mc.combine({kWrite}));
  EXPECT_FALSE(mc.combine({kWrite, kTwoWords}));
  EXPECT_FALSE(mc.combine({kTwoWords, kWrite}));
  EXPECT_FALSE(mc.combine({Enquire{}, kWrite}));
  std::vector<Request> many(161, kWrite);
  EXPECT_FALSE(mc.combine(many));
  many.pop_back();
  EXPECT_TRUE(mc.combine(many));
  EXPECT_FALSE(codec(Frame::e3, Model::iq_r).combine(many));
  // 137 double words at 14 each are 1,918 of 1,920.
  std::vector<Request> double_words(137, Write{{kD, 1600, 32}, {1, 2, 3, 4}});
  EXPECT_TRUE(mc.combine(double_words));
  double_words.push_back(double_words.front());
  EXPECT_FALSE(mc.combine(double_words));
  std::vector<Request> forces(188, Force{kM, 1, true});
  EXPECT_TRUE(mc.combine(forces));
  forces.push_back(Force{kM, 2, true});
  EXPECT_FALSE(mc.combine(forces));
  // An iQ-R takes 188 with short codes and 94 with its own.
  std::vector<Request> long_forces(94, Force{kM, 1, true});
  EXPECT_TRUE(codec(Frame::e3, Model::iq_r).combine(long_forces));
  long_forces.push_back(Force{kM, 2, true});
  EXPECT_FALSE(codec(Frame::e3, Model::iq_r).combine(long_forces));
}

TEST(McMessages, ContactsAreNeverWrittenAsWords) {
  const Mc mc = codec(Frame::e3);
  for (const Space space : {Space::ts, Space::tc, Space::sts, Space::stc, Space::cs, Space::cc}) {
    const Write contacts{{id(space), 0, 16}, {1, 0}};
    EXPECT_FALSE(mc.combine({kWrite, contacts})) << kind_of(space).letters;
    const auto bits = mc.combine({contacts, contacts});
    ASSERT_TRUE(bits) << kind_of(space).letters;
    EXPECT_EQ(message(mc, *bits).substr(0, 14), "02 14 01 00 20") << kind_of(space).letters;
  }
  EXPECT_TRUE(mc.combine({kWrite, Write{{kM, 0, 16}, {1, 0}}}));
}

TEST(McMessages, ANumberWithTooManyDigitsIsRefusedAndNeverShortened) {
  const Mc unknown = codec(Frame::e3, Model::unknown);
  EXPECT_TRUE(unknown.parse_address("M16777215", std::nullopt));
  expect_says(error_of(unknown.parse_address("M16777316", std::nullopt)).text,
              "M16777316 has more digits than a request to this model has room for: set `model`");
  expect_says(error_of(unknown.parse_address("K4M16777210", std::nullopt)).text, "set `model`");
  expect_says(why_not(unknown, Force{kM, 16777316, true}), "M16777316");
  EXPECT_TRUE(codec(Frame::e3, Model::iq_r).parse_address("M16777316", std::nullopt));
  const Mc ascii = codec(Frame::e3, Model::q, Code::ascii);
  EXPECT_TRUE(ascii.parse_address("D999999", std::nullopt));
  expect_says(error_of(ascii.parse_address("D1000000", std::nullopt)).text, "use `code` binary");
  EXPECT_TRUE(codec(Frame::e3, Model::q).parse_address("D1000000", std::nullopt));
}

TEST(McMessages, FileRegistersHaveHexadecimalDigitsInAsciiCode) {
  const Mc ascii = codec(Frame::e3, Model::q, Code::ascii);
  for (const auto& [name, digits] : {std::pair("ZR255", "ZR0000FF"), {"ZR4184063", "ZR3FD7FF"}}) {
    const auto address = ascii.parse_address(name, std::nullopt);
    ASSERT_TRUE(address) << name;
    const auto frame = ascii.encode(Read{address->span, kWordWay}, 1);
    ASSERT_TRUE(frame) << name;
    const std::string text(frame->begin(), frame->end());
    EXPECT_NE(text.find(std::string("04010000") + digits + "0001"), text.npos) << text;
    EXPECT_EQ(ascii.explain(*frame, Direction::request).device, name);
  }
}

TEST(McMessages, InAsciiSomeDevicesOfAnFx5HaveNoCertainName) {
  const Mc mc = codec(Frame::e3, Model::fx5u, Code::ascii);
  const auto refused = [&](std::string_view text) {
    SCOPED_TRACE(text);
    return error_of(mc.parse_address(text, std::nullopt)).text;
  };
  expect_says(refused("X10"), "use `code` binary");
  expect_says(refused("K4Y20"), "use `code` binary");
  expect_says(refused("LCN0"), "no certain name");
  EXPECT_TRUE(mc.parse_address("X7", std::nullopt));
  EXPECT_TRUE(mc.parse_address("M10", std::nullopt));
  EXPECT_TRUE(mc.read_ways(id(Space::lcn)).empty());
  EXPECT_FALSE(mc.encode(Read{{id(Space::x), 8, 1}, kBitWay}, 1));
  // From X0 one word can be read; a second one might have to begin at X20.
  EXPECT_TRUE(mc.parse_address("K4X0", std::nullopt));
  EXPECT_TRUE(mc.check_range({id(Space::x), 0, 16}));
  expect_says(refused("K8X0"), "X20: whether an FX5");
  for (const Span& far : {Span{id(Space::x), 0, 32}, Span{id(Space::y), 7, 10}}) {
    expect_says(error_of(mc.check_range(far)).text, "use `code` binary");
    EXPECT_FALSE(mc.check_write(far));
  }
  EXPECT_TRUE(mc.check_write({id(Space::y), 0, 16}));
  EXPECT_TRUE(mc.parse_range("Y0-Y77"));
  for (const ReadWay& way : mc.read_ways(id(Space::x))) {
    EXPECT_EQ(way.end_bit, way.way == kBitWay ? 8U : 16U);
    for (std::uint32_t first = 0; first + way.unit_bits <= way.end_bit; ++first)
      EXPECT_EQ(
          mc.encode(Read{{id(Space::x), first, way.unit_bits}, way.way, way.gather}, 1).has_value(),
          true)
          << first;
  }
  EXPECT_TRUE(codec(Frame::e3).check_range({id(Space::x), 0, 32}));
  EXPECT_TRUE(codec(Frame::e3, Model::q, Code::ascii).check_range({id(Space::x), 0, 32}));
  EXPECT_TRUE(codec(Frame::e3, Model::q, Code::ascii).parse_address("X10", std::nullopt));
  EXPECT_TRUE(codec(Frame::e3, Model::iq_r, Code::ascii).parse_address("LCN0", std::nullopt));
}

// ---- reactions to a refusal --------------------------------------------------------------------

TEST(McRefusals, EndCodesMeanWhatTheManualsSay) {
  const Mc mc = codec(Frame::e3);
  const Request gather = Gather{{Read{{kD, 0, 16}, kRandomWay, kRandomRead}}};
  const Request run = Control{Control::Kind::run};
  for (const int code : {0xC051, 0xC052, 0xC053, 0xC054, 0xC056, 0xC05B, 0x4031, 0x4030, 0x7E41,
                         0x7E42, 0x7E43, 0x7E4F, 0x4032}) {
    EXPECT_EQ(mc.meaning_of(kTwoWords, code), RefusalMeaning::hole) << code;
    EXPECT_EQ(mc.meaning_of(gather, code), RefusalMeaning::hole) << code;
    EXPECT_EQ(mc.meaning_of(kWrite, code), RefusalMeaning::final) << code;
  }
  for (const int code :
       {0x0050, 0x0055, 0x4013, 0x4080, 0x4FFF, 0xC050, 0xC059, 0xC05C, 0xC05F, 0xC061, 0xC200,
        0xC204, 0x7167, 0x7E40, 0x7F22, 0x7153, 0x7157, 0x7168, 0x716D}) {
    EXPECT_EQ(mc.meaning_of(kTwoWords, code), RefusalMeaning::final) << code;
    EXPECT_EQ(mc.meaning_of(kWrite, code), RefusalMeaning::final) << code;
  }
  for (const int code :
       {0x0050, 0x0055, 0x7F20, 0x7F21, 0x7F23, 0xC050, 0xC05F, 0xC06F, 0xC200, 0xC204})
    EXPECT_EQ(mc.meaning_of(gather, code), RefusalMeaning::unclear)
        << "others are refused for it, too: " << code;
  for (const int code : {0xC059, 0xC05C, 0xC061, 0x7E40, 0x7F22, 0x4080, 0xD000})
    EXPECT_EQ(mc.meaning_of(gather, code), RefusalMeaning::final) << code;
  EXPECT_EQ(mc.meaning_of(kTwoWords, 0x4A00), RefusalMeaning::unreachable);
  EXPECT_EQ(mc.meaning_of(kTwoWords, 0x4A1F), RefusalMeaning::unreachable);
  EXPECT_EQ(mc.meaning_of(kWrite, 0x4A00), RefusalMeaning::final);
  EXPECT_EQ(mc.meaning_of(kWrite, 0x7F24), RefusalMeaning::curable);
  EXPECT_EQ(mc.meaning_of(run, 0x7F24), RefusalMeaning::final);
  EXPECT_EQ(mc.meaning_of(kTwoWords, 0x7F6A), RefusalMeaning::busy);
  EXPECT_EQ(mc.meaning_of(run, 0x7F6A), RefusalMeaning::final);
  EXPECT_EQ(mc.meaning_of(kTwoWords, 0x7E47), RefusalMeaning::busy);
  EXPECT_EQ(mc.meaning_of(kWrite, 0x7E47), RefusalMeaning::busy);
  EXPECT_EQ(mc.meaning_of(run, 0x7E47), RefusalMeaning::final);
  // From a relay station: the request may have been forwarded, and its answer lost.
  for (const int code : {0x4B00, 0x4B02, 0x4BFF}) {
    EXPECT_EQ(mc.meaning_of(kTwoWords, code), RefusalMeaning::unreachable) << code;
    EXPECT_EQ(mc.meaning_of(kWrite, code), RefusalMeaning::unclear) << code;
    EXPECT_EQ(mc.meaning_of(run, code), RefusalMeaning::unclear) << code;
  }
  const Request asked = Control{Control::Kind::identify};
  EXPECT_EQ(mc.meaning_of(asked, 0x4A00), RefusalMeaning::unreachable);
  EXPECT_EQ(mc.meaning_of(asked, 0x1234), RefusalMeaning::final);
  EXPECT_EQ(mc.meaning_of(asked, 0xC059), RefusalMeaning::final);
  EXPECT_EQ(mc.meaning_of(asked, 0x7F24), RefusalMeaning::curable);
  // With an unknown code, it is unknown if the request was carried out.
  EXPECT_EQ(mc.meaning_of(kTwoWords, 0x1234), RefusalMeaning::final);
  EXPECT_EQ(mc.meaning_of(kWrite, 0x1234), RefusalMeaning::unclear);
}

TEST(McRefusals, TextsNameTheSettingToLookAt) {
  expect_says(end_code_text(0x0055, Series::iq_f), "Online Change");
  expect_says(end_code_text(0xC059, Series::iq_f), "`model`");
  expect_says(end_code_text(0xC050, Series::iq_f), "Communication Data Code");
  expect_says(end_code_text(0xC05F, Series::iq_f), "module_io");
  expect_says(end_code_text(0x4A05, Series::iq_f), "network and pc");
  expect_says(end_code_text(0xC201, Series::iq_f), "password");
  expect_says(end_code_text(0x4ABC, Series::iq_f), "no way");
  expect_says(end_code_text(0x4B02, Series::iq_f), "on the way");
  expect_says(end_code_text(0x4123, Series::iq_f), "refused by the CPU");
  expect_says(end_code_text(0x7F24, Series::iq_f), "sum_check");
  expect_says(end_code_text(0x1234, Series::iq_f), "end code 1234: an unknown reason");
}

TEST(McRefusals, TextsNameTheToolAndTheSettingOfThatModel) {
  const auto said = [](Model model, std::string_view code) {
    const std::string frame = "D0 00 00 FF FF 03 00 02 00 " + std::string(code);
    return answer(codec(Frame::e3, model), kWrite, hex(frame)).text;
  };
  constexpr std::string_view kWriteInRun = "55 00";
  for (const Model model : {Model::q, Model::l}) {
    expect_says(said(model, kWriteInRun), "in GX Works2 set \"Enable online change (FTP, MC Pro");
    EXPECT_EQ(said(model, kWriteInRun).find("Works3"), std::string::npos);
  }
  for (const Model model : {Model::fx5u, Model::fx5s, Model::iq_r}) {
    expect_says(said(model, kWriteInRun), "in GX Works3 set Enable/Disable Online Change");
    EXPECT_EQ(said(model, kWriteInRun).find("Works2"), std::string::npos);
  }
  for (const char* part : {"Enable All (SLMP)", "Enable online change (FTP, MC Protocol)"})
    expect_says(said(Model::unknown, kWriteInRun), part);
  constexpr std::string_view kPassword = "01 C2";
  expect_says(said(Model::q, kPassword), "in GX Works2 (Remote Password)");
  expect_says(said(Model::fx5u, kPassword), "in GX Works3 (Remote Password)");
  expect_says(said(Model::unknown, kPassword), "in GX Works (Remote Password)");
  // As in `fxagent decode`.
  const auto explained =
      codec(Frame::e3, Model::l).explain(hex("D0 00 00 FF FF 03 00 02 00 55 00"), std::nullopt);
  ASSERT_FALSE(explained.fields.empty());
  expect_says(explained.fields.back().second, "GX Works2");
}

TEST(McRefusals, AnIqRThatLacksItsCodesIsAskedWithThoseOfQ) {
  const Mc mc = codec(Frame::e3, Model::iq_r);
  const auto other = mc.instead_of(kWrite, 0xC059).value();
  EXPECT_EQ(message(mc, other), "01 14 00 00 64 00 00 A8 01 00 34 12");
  EXPECT_FALSE(mc.instead_of(other, 0xC059));
  EXPECT_FALSE(mc.instead_of(Force{kM, 1 << 24, true}, 0xC059)) << "three bytes name M0";
  EXPECT_FALSE(mc.instead_of(kWrite, 0xC056));
  EXPECT_FALSE(codec(Frame::e3).instead_of(kWrite, 0xC059));
  EXPECT_FALSE(mc.instead_of(kTwoWords, 0xC061)) << "a refused read shows the wrong model";
  const auto force = mc.instead_of(Force{kM, 1, true}, 0xC059).value();
  EXPECT_EQ(message(mc, force), "01 14 01 00 01 00 00 90 01 00 10");
  const auto scatter = mc.instead_of(Scatter{{std::get<Write>(kWrite)}}, 0xC059).value();
  EXPECT_EQ(message(mc, scatter), "02 14 00 00 01 00 64 00 00 A8 34 12");
}

TEST(McRefusals, OutputsOfAnIqRThatMayBeAnFx5AreNotWrittenByOtherCodes) {
  const Mc mc = codec(Frame::e3, Model::iq_r);
  const auto y = static_cast<std::uint16_t>(Space::y);
  EXPECT_FALSE(mc.instead_of(Force{y, 0x20, true}, 0xC059)) << "Y20 is number 16 of an FX5";
  EXPECT_FALSE(mc.instead_of(Force{static_cast<std::uint16_t>(Space::x), 0x20, true}, 0xC059));
  EXPECT_FALSE(mc.instead_of(Write{{y, 0, 16}, {0, 1}}, 0xC059));
  EXPECT_FALSE(mc.instead_of(Scatter{{std::get<Write>(kWrite), Write{{y, 1, 1}, {1}}}}, 0xC059));
}

// ---- the PLC itself ----------------------------------------------------------------------------

TEST(McPlc, TheTypeNameTellsTheModel) {
  constexpr std::pair<const char*, const char*> kTypes[] = {
      {"FX5U-32MT/ES", "FX5U"}, {"FX5UC-32MT/D", "FX5U"}, {"FX5UJ-24MT/ES", "FX5UJ"},
      {"FX5S-30MT/ES", "FX5S"}, {"Q02UCPU", "Q"},         {"QS001CPU", "Q"},
      {"L26CPU-BT", "L"},       {"L02SCPU", "L"},         {"L16HCPU", "iQ-R"},
      {"R120PCPU", "iQ-R"},     {"R08CPU", "iQ-R"},       {"RJ71EN71", ""},
      {"LJ71E71-100", ""},      {"KV-8000", ""}};
  const Mc mc = codec(Frame::e3, Model::unknown);
  // Other devices that use 3E answer with more or fewer bytes than in the manual.
  const Request asked = mc.identify().front();
  const auto named = [&](std::string_view data_length, std::string_view rest) {
    Bytes rx = hex("D0 00 00 FF FF 03 00 " + std::string(data_length) + " 00 00 00");
    for (const char c : std::string_view("FX5U-32MT/ES    "))
      rx.push_back(static_cast<std::uint8_t>(c));
    const Bytes behind = hex(rest);
    rx.insert(rx.end(), behind.begin(), behind.end());
    return mc.model_from({answer(mc, asked, rx).image});
  };
  EXPECT_EQ(named("14", "21 4A"), "FX5U");
  EXPECT_EQ(named("12", ""), "FX5U");
  EXPECT_EQ(named("18", "21 4A 00 00 00 00"), "FX5U");
  for (const char* rx :
       {"D0 00 00 FF FF 03 00 02 00 00 00", "D0 00 00 FF FF 03 00 05 00 00 00 46 58 35"}) {
    const Reply reply = answer(mc, asked, hex(rx));
    EXPECT_EQ(reply.kind, Reply::Kind::data);
    EXPECT_EQ(mc.model_from({reply.image}), std::nullopt);
  }
  for (const auto& [type, model] : kTypes) {
    std::string text = type;
    text.resize(16, ' ');
    Bytes image(text.begin(), text.end());
    image.insert(image.end(), {0x63, 0x02});
    const auto known = mc.model_from({image});
    EXPECT_EQ(known.value_or(""), model) << type;
    if (known) {
      ASSERT_NE(mc.with_model(*known), nullptr);
    }
  }
  EXPECT_FALSE(mc.model_from({}));
  EXPECT_FALSE(mc.model_from({Bytes{}}));  // refused, as by built-in ports of Q and L
  EXPECT_EQ(mc.with_model("FX3U"), nullptr);
}

TEST(McPlc, TheLowHalfByteOfSD203TellsWhetherItRuns) {
  const Mc mc = codec(Frame::e3);
  EXPECT_EQ(message(mc, mc.run_state()), "01 04 00 00 CB 00 00 A9 01 00");
  EXPECT_EQ(mc.run_state_from(hex("00 00")), true);
  EXPECT_EQ(mc.run_state_from(hex("F1 00")), true);
  EXPECT_EQ(mc.run_state_from(hex("02 00")), false);
  EXPECT_EQ(mc.run_state_from(hex("13 00")), false);
  EXPECT_EQ(mc.run_state_from({}), std::nullopt);
  expect_says(mc.run_hint(), "at RUN");
}

TEST(McPlc, ProbesHaveAnswersOfTheirOwnLengths) {
  for (const Code code : {Code::binary, Code::ascii}) {
    const Mc mc = codec(Frame::e3, Model::fx5u, code);
    std::vector<std::uint32_t> lengths;
    for (std::uint32_t i = 0; i < Codec::kProbes; ++i)
      lengths.push_back(mc.line_length(*mc.probe(i)).reply_chars);
    for (std::size_t i = 1; i < lengths.size(); ++i) EXPECT_NE(lengths[i - 1], lengths[i]);
  }
  const Mc mc = codec(Frame::e3);
  EXPECT_EQ(std::get<Read>(*mc.shorter_read(kTwoWords)).span.bits, 16U);
  EXPECT_FALSE(mc.shorter_read(Read{{kD, 0, 16}, kWordWay}));
  EXPECT_FALSE(mc.shorter_read(kWrite));
}

// ---- options of the config ---------------------------------------------------------------------

TEST(McOptions, RouteAndTimerGoIntoTheFrame) {
  Options options{{"model", std::string("FX5U")},
                  {"network", std::int64_t{1}},
                  {"pc", std::int64_t{2}},
                  {"module_io", std::int64_t{0x3E0}},
                  {"module_station", std::int64_t{3}},
                  {"monitoring_timer_ms", std::int64_t{1000}}};
  const auto made = Mc::make(Frame::e4, options).value();
  EXPECT_EQ(to_hex(*made->encode(kTwoWords, 0x1234)),
            "54 00 34 12 00 00 01 02 E0 03 03 0C 00 04 00 01 04 00 00 64 00 00 A8 02 00");
  EXPECT_EQ(made->gives_up_after(), std::chrono::seconds(1));
  options["monitoring_timer_ms"] = std::int64_t{1100};
  expect_says(error_of(Mc::make(Frame::e3, options)).text, "multiple of 250");
  EXPECT_FALSE(Mc::make(Frame::e3, {{"model", std::string("FX9")}}));
  expect_says(error_of(Mc::make(Frame::e3, {{"model", std::string("FX3U")}})).text, "mc-1e");
  const auto ascii = Mc::make(Frame::e3, {{"code", std::string("ascii")}}).value();
  EXPECT_EQ(ascii->encode(kTwoWords, 1)->front(), '5');
  EXPECT_EQ((*Mc::make(Frame::c4, {}))->gives_up_after(), std::chrono::milliseconds(0));
  const auto beyond = Mc::make(Frame::c4, {{"network", std::int64_t{1}}, {"pc", std::int64_t{2}}});
  EXPECT_EQ((*beyond)->gives_up_after(), std::chrono::seconds(5)) << "a module waits for another";
}

TEST(McOptions, BlocksAreNoLongerThanAsked) {
  const auto made = Mc::make(Frame::e3, {{"max_block_bytes", std::int64_t{64}}}).value();
  for (const ReadWay& way : made->addresses().read_ways(kD)) EXPECT_LE(way.max_bits, 512U);
  EXPECT_EQ(made->addresses().gathers().front().max_bits, 512U);
  EXPECT_EQ(sent(codec(Frame::e3), kTwoWords), sent(codec(Frame::e3), kTwoWords, 2));
}

}  // namespace
}  // namespace fxagent::mc
