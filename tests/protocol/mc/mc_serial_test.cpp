// mc-3c and mc-4c beyond the transcripts: the bytes a line may deliver in each format.
#include <gtest/gtest.h>

#include "protocol/mc/mc.h"
#include "protocol/plan/plan.h"
#include "tests/protocol/answers.h"

namespace fxagent::mc {
namespace {

using namespace test;

constexpr std::uint16_t kD = id(Space::d);
constexpr std::uint16_t kM = id(Space::m);

Mc codec(std::uint32_t format, Frame frame = Frame::c4, bool sum = true) {
  Mc::Settings settings;
  settings.frame = frame;
  settings.model = Model::fx5u;
  settings.format = format;
  settings.sum_check = sum;
  settings.max_block_bytes = 512;
  return Mc(settings);
}

const Request kTwoWords = Read{{kM, 100, 32}, kWordWay};
const Request kWrite = Write{{kD, 1600, 32}, {0x34, 0x12, 0xCD, 0xAB}};

TEST(McSerial, WhatIsWrongWithAnAnswerIsSaid) {
  const Mc one = codec(1);
  expect_says(fault(one, kTwoWords, ascii("<F80000FF03FF000012340002>09")),
              "sum 09 given, 08 computed");
  expect_says(fault(one, kTwoWords, ascii("<F80000FF03FF000012340002>GG")), "not two hex digits");
  expect_says(fault(one, kTwoWords, ascii("<F80000FF03FF00001234000>1A")), "7 data characters");
  expect_says(fault(one, kTwoWords, ascii("<F80000FF03FF0000123400021>1A")),
              "more data characters");
  expect_says(fault(one, kTwoWords, ascii("-F80000FF03FF00007E4G")), "not four hex digits");
  const Mc four = codec(4);
  expect_says(fault(four, kTwoWords, ascii("<F80000FF03FF000012340002>08xx")), "CR LF is missing");
  expect_says(fault(four, kWrite, ascii("+F80000FF03FF0000xx")), "CR LF is missing");
  expect_says(fault(four, kWrite, ascii("-F80000FF03FF00007167xx")), "CR LF is missing");
  const Mc three = codec(3);
  expect_says(fault(three, kWrite, ascii("<F80000FF03FF0000QNAK7167x")), "ETX is missing");
  Bytes babble(9000, '0');
  expect_says(fault(one, kTwoWords, babble), "9000 bytes without an answer");
}

TEST(McSerial, WithoutSumsNeitherSideHasThem) {
  const Mc mc = codec(1, Frame::c3, false);
  EXPECT_EQ(*mc.encode(kTwoWords, 1), ascii("%F90000FF0004010000M*0001000002"));
  const Bytes reply = ascii("<F90000FF0012340002>");
  EXPECT_EQ(answer(mc, kTwoWords, reply).image, hex("34 12 02 00"));
  EXPECT_EQ(mc.line_length(kTwoWords).reply_chars, reply.size());
  const Mc five = codec(5, Frame::c4, false);
  const Bytes done = hex("10 02 0C 00 F8 00 00 FF FF 03 00 00 FF FF 00 00 10 03");
  EXPECT_EQ(answer(five, kWrite, done).kind, Reply::Kind::ack);
  EXPECT_EQ(five.line_length(kWrite).reply_chars, done.size());
}

TEST(McSerial, ABlockNumberTellsAnOldAnswerFromTheRightOne) {
  const Mc mc = codec(2, Frame::c3);
  EXPECT_TRUE(needs_more(mc, kTwoWords, ascii("<79F90000FF0055550002>42"), 0x7A));
  const Reply reply =
      answer(mc, kTwoWords, ascii("<79F90000FF0055550002>42<7AF90000FF0012340002>32"), 0x7A);
  EXPECT_EQ(reply.image, hex("34 12 02 00"));
  EXPECT_EQ(reply.began, 24U);
  EXPECT_TRUE(needs_more(mc, kWrite, ascii("+79F90000FF00"), 0x7A));
  EXPECT_EQ(answer(mc, kWrite, ascii("+7AF90000FF00"), 0x7A).kind, Reply::Kind::ack);
}

TEST(McSerial, AnswersOfOtherStationsAndOfTheOtherKindArePassedOver) {
  const Mc one = codec(1);
  const Bytes own = ascii("<F80000FF03FF000012340002>08");
  const auto behind = [&](const Mc& mc, std::string_view before, const Bytes& right) {
    Bytes rx = ascii(before);
    const bool waits = needs_more(mc, kTwoWords, rx);
    EXPECT_TRUE(waits) << before;
    rx.insert(rx.end(), right.begin(), right.end());
    EXPECT_EQ(answer(mc, kTwoWords, rx).image, hex("34 12 02 00")) << before;
  };
  behind(one, "<F80100FF03FF000055550002>12", own);  // another station
  behind(one, "<F90000FF0055550002>00", own);        // a 3C frame
  behind(one, "+F80000FF03FF0000", own);             // an acknowledgement instead of data
  behind(one, "-F80100FF03FF00007E4F", own);         // another station refuses
  behind(one, "%F80000FF03FF000004010000M*000100000258", own);  // the echo of the request
  behind(one, "<F80000FF03FF00001234", own);                    // truncated by the right one
  EXPECT_TRUE(needs_more(one, kWrite, own));  // data instead of an acknowledgement
  EXPECT_EQ(answer(one, kWrite, ascii("<F80000FF03FF000012340002>08+F80000FF03FF0000")).kind,
            Reply::Kind::ack);
}

TEST(McSerial, Format3TellsAnswersByQackAndQnak) {
  const Mc mc = codec(3);
  const Bytes request = *mc.encode(kTwoWords, 1);
  EXPECT_EQ(request, ascii("<F80000FF03FF000004010000M*0001000002>5B"));
  EXPECT_TRUE(needs_more(mc, kTwoWords, request));
  Bytes rx = request;
  const Bytes late = ascii("<F80000FF03FF0000QACK>");
  rx.insert(rx.end(), late.begin(), late.end());
  EXPECT_TRUE(needs_more(mc, kTwoWords, rx));
  const Bytes own = ascii("<F80000FF03FF0000QACK12340002>28");
  rx.insert(rx.end(), own.begin(), own.end());
  EXPECT_EQ(answer(mc, kTwoWords, rx).image, hex("34 12 02 00"));
  const Reply refused = answer(mc, kTwoWords, ascii("<F80000FF03FF0000QNAK7E4F>"));
  EXPECT_EQ(refused.device_code, 0x7E4F);
  EXPECT_EQ(answer(mc, kWrite, ascii("<F80000FF03FF0000QACK>")).kind, Reply::Kind::ack);
  // A late answer with data and a refusal for another station, before the right answer.
  EXPECT_EQ(answer(mc, kWrite,
                   ascii("<F80000FF03FF0000QACK12340002>28<F80100FF03FF0000QNAK7167>"
                         "<F80000FF03FF0000QACK>"))
                .kind,
            Reply::Kind::ack);
  for (std::size_t n = 0; n < own.size(); ++n)
    EXPECT_TRUE(needs_more(mc, kTwoWords, first(own, n)));
}

TEST(McSerial, Format5DoublesEvery10AndFindsItsFramesAgain) {
  const Mc mc = codec(5);
  const Request word = Read{{kD, 256, 16}, kWordWay};
  const Bytes own = hex("10 02 0E 00 F8 00 00 FF FF 03 00 00 FF FF 00 00 10 10 10 10 10 03 32 35");
  EXPECT_EQ(answer(mc, word, own).image, hex("10 10"));
  for (std::size_t n = 0; n < own.size(); ++n) EXPECT_TRUE(needs_more(mc, word, first(own, n)));
  const auto behind = [&](std::string_view before) {
    Bytes rx = hex(before);
    rx.insert(rx.end(), own.begin(), own.end());
    const Reply reply = answer(mc, word, rx);
    EXPECT_EQ(reply.image, hex("10 10")) << before;
    EXPECT_EQ(reply.consumed, rx.size());
  };
  behind(to_hex(*mc.encode(word, 1)));  // its echo
  behind("FF 10 03 00");
  behind("10 02 0E 00 10 05");  // a single 10 inside: not a frame
  behind("10 02 0C 00 F8 00 00 FF FF 03 00 00 FF FF 00 00 10 03 30 33");  // a late acknowledgement
  expect_says(fault(mc, word,
                    hex("10 02 0E 00 F8 00 00 FF FF 03 00 00 FF FF 00 00 "
                        "10 10 10 10 10 03 32 36")),
              "sum 26 given, 25 computed");
  expect_says(fault(mc, word,
                    hex("10 02 0F 00 F8 00 00 FF FF 03 00 00 FF FF 00 00 "
                        "10 10 10 10 10 03 32 36")),
              "length 15 given, 14 bytes received");
  expect_says(fault(mc, word,
                    hex("10 02 10 10 00 F8 00 00 FF FF 03 00 00 FF FF 00 00 "
                        "01 02 03 04 10 03 31 31")),
              "4 bytes of data given, 2 expected");
  expect_says(fault(mc, word, hex("10 02 0A 00 F8 00 00 FF FF 03 00 00 FF FF 10 03 30 31")),
              "without end code");
  const Reply refused =
      answer(mc, word, hex("10 02 0C 00 F8 00 00 FF FF 03 00 00 FF FF 56 C0 10 03 31 39"));
  EXPECT_EQ(refused.device_code, 0xC056);
}

TEST(McSerial, OtherMastersAndNoiseAreToldFromAnswers) {
  for (const std::uint32_t format : {1U, 2U, 3U, 4U}) {
    const Mc mc = codec(format);
    EXPECT_TRUE(mc.may_pass_for_answer(ascii("<F8")));
    EXPECT_TRUE(mc.may_pass_for_answer(ascii("x%F80000FF")));
    EXPECT_FALSE(mc.may_pass_for_answer(ascii("<xyz")));
    EXPECT_FALSE(mc.may_pass_for_answer({}));
  }
  const Mc five = codec(5);
  EXPECT_TRUE(five.may_pass_for_answer(hex("00 10 02")));
  EXPECT_TRUE(five.may_pass_for_answer(hex("00 10")));
  EXPECT_FALSE(five.may_pass_for_answer(hex("00 10 03")));
}

TEST(McSerial, TheLineLengthIsWhatGoesOverTheLineInEveryFormat) {
  for (const Frame frame : {Frame::c3, Frame::c4}) {
    for (std::uint32_t format = 1; format <= (frame == Frame::c4 ? 5U : 4U); ++format) {
      const Mc mc = codec(format, frame);
      for (const Request& request : {kTwoWords, kWrite, Request(Control{Control::Kind::stop})})
        EXPECT_EQ(mc.line_length(request).request_chars, mc.encode(request, 0)->size()) << format;
      EXPECT_EQ(mc.line_length(kTwoWords).closing_chars, 0U);
    }
  }
  EXPECT_EQ(codec(1).line_length(kWrite).reply_chars, 17U);
  EXPECT_EQ(codec(3).line_length(kWrite).reply_chars, 22U);
  EXPECT_EQ(codec(4).line_length(kTwoWords).reply_chars, 30U);
  EXPECT_EQ(codec(5).line_length(kTwoWords).reply_chars, 25U);  // its length, 10h, is doubled
  // Data of nothing but 10h take twice the characters. A deadline must allow for that; a plan need
  // not.
  const LineLength five = codec(5).line_length(kTwoWords);
  const Bytes doubled =
      hex("10 02 10 10 00 F8 00 00 FF FF 03 00 00 FF FF 00 00 10 10 10 10 10 10 10 10 10 03 34 37");
  EXPECT_EQ(five.reply_chars + five.more_reply_chars, doubled.size());
  EXPECT_EQ(answer(codec(5), kTwoWords, doubled).image, hex("10 10 10 10"));
  const LineCost cost{std::chrono::milliseconds(1), {}};
  EXPECT_EQ(five.doubled_chars, 1U);
  EXPECT_EQ(cost.of(five), std::chrono::milliseconds(five.request_chars + five.reply_chars - 1));
  EXPECT_EQ(codec(5).line_length(kWrite).more_reply_chars, 0U);
  EXPECT_EQ(codec(1).line_length(kTwoWords).more_reply_chars, 0U);
}

TEST(McSerial, APlanReckonsWithoutTheBytesThatAreDoubled) {
  const Mc five = codec(5);
  const LineCost cost{std::chrono::milliseconds(1), {}};
  const auto of_read = [&](std::uint32_t word, std::uint32_t words) {
    const std::uint16_t d = five.parse_address("D0", std::nullopt)->span.space;
    return five.line_length(Read{{d, word * 16, words * 16}, kWordWay});
  };
  // The numbers 10h and 310h take one more byte on the wire.
  EXPECT_EQ(of_read(0, 16).request_chars, of_read(0, 15).request_chars + 1);
  EXPECT_EQ(of_read(0x310, 1).request_chars, of_read(0, 1).request_chars + 1);
  for (std::uint32_t words = 1; words <= 256; ++words)
    ASSERT_EQ(cost.of(of_read(words, words)) - cost.of(of_read(0, 1)),
              std::chrono::milliseconds(2 * (words - 1)))
        << words;
}

TEST(McSerial, OptionsOfTheConfigAreItsSettings) {
  const auto made = Mc::make(Frame::c4, {{"model", std::string("FX5U")},
                                         {"station", std::int64_t{5}},
                                         {"format", std::int64_t{4}},
                                         {"sum_check", false}});
  ASSERT_TRUE(made);
  EXPECT_EQ(*(*made)->encode(kTwoWords, 1), ascii("%F80500FF03FF000004010000M*0001000002!"));
  const auto three = Mc::make(Frame::c3, {{"format", std::int64_t{1}}});
  ASSERT_TRUE(three);
  EXPECT_EQ((*three)->encode(kTwoWords, 1)->front(), kEnq);
}

}  // namespace
}  // namespace fxagent::mc
