#include "protocol/modbus/modbus.h"

#include <gtest/gtest.h>

#include "protocol/catalog.h"
#include "protocol/plan/plan.h"
#include "protocol/plc.h"
#include "tests/protocol/answers.h"
#include "tests/support/pick.h"

namespace fxagent::modbus {
namespace {

using namespace std::chrono_literals;
using namespace test;
using Settings = Modbus::Settings;

constexpr std::uint16_t kCoil = id(Space::coil);
constexpr std::uint16_t kInput = id(Space::discrete_input);
constexpr std::uint16_t kInputRegister = id(Space::input_register);
constexpr std::uint16_t kHolding = id(Space::holding_register);

Modbus unit(std::uint8_t number = 1, Framing framing = Framing::rtu) {
  return Modbus({.framing = framing, .unit = number});
}

Explanation explained(Framing framing, ByteView frame, std::optional<Direction> direction) {
  return unit(1, framing).explain(frame, direction);
}

Address address(std::string_view text, const Modbus& codec = unit()) {
  const auto parsed = codec.parse_address(text, std::nullopt);
  EXPECT_TRUE(parsed.has_value()) << text << ": " << parsed.error().text;
  return parsed.value_or(Address{});
}

std::string refusal(std::string_view text, const Modbus& codec = unit()) {
  SCOPED_TRACE(text);
  return error_of(codec.parse_address(text, std::nullopt)).text;
}

Bytes sent(const Modbus& codec, const Request& request, std::uint16_t tag = 0) {
  const auto frame = codec.encode(request, tag);
  EXPECT_TRUE(frame.has_value()) << frame.error().text;
  return frame.value_or(Bytes{});
}

// ---- transcripts ------------------------------------------------------------------------------

Framing framing_of(const test::Exchange& e) {
  return e.model == "rtu" ? Framing::rtu : e.model == "ascii" ? Framing::ascii : Framing::tcp;
}
Modbus codec_of(const test::Exchange& e) {
  return unit(static_cast<std::uint8_t>(std::stoul(e.command_set)), framing_of(e));
}
std::uint16_t transaction_of(const test::Exchange& e) {
  return static_cast<std::uint16_t>(std::stoul(e.command_set.substr(e.command_set.find('.') + 1)));
}
bool is_refused(const test::Exchange& e) {
  return e.operation.find("_refused") != std::string::npos;
}

std::optional<Request> request_of(const test::Exchange& e) {
  const std::string what = e.operation.substr(0, e.operation.find("_refused"));
  if (what == "explained") return std::nullopt;
  Span span = address(e.device).span;
  span.bits *= e.bytes;
  if (what == "read") return Read{span};
  if (what == "write_several")
    return Force{span.space, span.first_bit, (e.image[0] & 1) != 0, id(WriteWay::several)};
  if (what == "write") return Write{span, e.image};
  return Force{span.space, span.first_bit, what == "force_on"};
}

TEST(Modbus, SpeaksEveryFrameOfTheTranscripts) {
  const auto all = spoken_in("modbus.txt", request_of);
  for (const auto& [e, request] : all) {
    const Modbus codec = codec_of(e);
    expect_spoken(codec, request, e, transaction_of(e));
    EXPECT_EQ(codec.expects_reply(request), !e.reply.empty()) << e.where();
  }
  EXPECT_EQ(all.size(), 83U);
}

TEST(Modbus, UnderstandsEveryAnswerOfTheTranscripts) {
  const auto all = answered_in("modbus.txt", request_of);
  for (const auto& [e, request] : all) {
    SCOPED_TRACE(e.where());
    const Reply reply =
        expect_understood(codec_of(e), request, e, is_refused(e), transaction_of(e));
    if (is_refused(e)) {
      EXPECT_FALSE(reply.text.empty());
    }
    if (e.operation == "read_refused") {
      EXPECT_EQ(reply.device_code, e.image[0]);
    }
  }
  EXPECT_EQ(all.size(), 82U);
}

TEST(Modbus, ExplainsEveryFrameOfTheTranscripts) {
  int answers = 0;
  for (const test::Exchange& e : test::read_frames("modbus.txt")) {
    SCOPED_TRACE(e.where());
    const Explanation request = explained(framing_of(e), e.request, Direction::request);
    // A request sent in order to be refused violates the specification; the explanation says so.
    if (request_of(e)) {
      EXPECT_TRUE(request.ok) << request.error.value_or("");
      EXPECT_EQ(request.device, e.device);
      EXPECT_EQ(request.count, e.bytes);
    }
    EXPECT_FALSE(request.fields.empty());
    if (e.reply.empty()) continue;
    const Explanation reply = explained(framing_of(e), e.reply, Direction::reply);
    EXPECT_TRUE(reply.ok) << reply.error.value_or("");
    EXPECT_EQ(reply.operation == "nak",
              is_refused(e) || e.source.find("exception") != std::string::npos);
    ++answers;
  }
  EXPECT_EQ(answers, 110);
}

// ---- names --------------------------------------------------------------------------------------

TEST(Modbus, NamesAreTablesAndNumbersOrDigitsAlone) {
  struct Case {
    const char* text;
    const char* canonical;
    Span span;
    Unit unit;
    bool writable;
  };
  const Case cases[] = {
      {"hr:100", "hr:100", {kHolding, 1600, 16}, Unit::word, true},
      {"HR:0x64", "hr:100", {kHolding, 1600, 16}, Unit::word, true},
      {"ir:0", "ir:0", {kInputRegister, 0, 16}, Unit::word, false},
      {"co:5", "co:5", {kCoil, 5, 1}, Unit::bit, true},
      {"di:65535", "di:65535", {kInput, 65535, 1}, Unit::bit, false},
      {"hr:100.3", "hr:100.3", {kHolding, 1603, 1}, Unit::word_bit, true},
      {"ir:5.15", "ir:5.15", {kInputRegister, 95, 1}, Unit::word_bit, false},
      {"40001", "hr:0", {kHolding, 0, 16}, Unit::word, true},
      {"40101", "hr:100", {kHolding, 1600, 16}, Unit::word, true},
      {"400101", "hr:100", {kHolding, 1600, 16}, Unit::word, true},
      {"465536", "hr:65535", {kHolding, 1048560, 16}, Unit::word, true},
      {"49999.0", "hr:9998.0", {kHolding, 159968, 1}, Unit::word_bit, true},
      {"30009", "ir:8", {kInputRegister, 128, 16}, Unit::word, false},
      {"10197", "di:196", {kInput, 196, 1}, Unit::bit, false},
      {"00173", "co:172", {kCoil, 172, 1}, Unit::bit, true},
      {"000173", "co:172", {kCoil, 172, 1}, Unit::bit, true},
  };
  for (const Case& c : cases) {
    const Address a = address(c.text);
    EXPECT_EQ(a.text, c.canonical) << c.text;
    EXPECT_EQ(a.span, c.span) << c.text;
    EXPECT_EQ(a.unit, c.unit) << c.text;
    EXPECT_EQ(a.writable, c.writable) << c.text;
    EXPECT_EQ(address(a.text).span, a.span) << c.text;
    EXPECT_FALSE(unit().needs_type(c.text));
  }
}

TEST(Modbus, TheBaseIsThatOfTheFirstNumberAndOfNamesWithATableOnly) {
  const Modbus codec({.address_base = 1});
  EXPECT_EQ(address("hr:1", codec).span.first_bit, 0U);
  EXPECT_EQ(address("hr:65536", codec).text, "hr:65536");
  EXPECT_EQ(address("40001", codec).text, "hr:1");
  EXPECT_EQ(codec.name_of({kCoil, 0, 1}), "co:1");
  expect_says(refusal("hr:0", codec), "from 1 to 65536");
}

TEST(Modbus, WhatIsNoAddressIsRefusedWithTheForms) {
  for (const char* text : {"", "D100", "hr", "xx:5", ":5", "hr100"})
    expect_says(refusal(text), "the forms are");
  for (const char* text : {"hr:65536", "hr:99999999999"}) expect_says(refusal(text), "0 to 65535");
  for (const char* text : {"hr:", "hr:a", "co:-1", "hr:1x", "hr:0x", "di: 1"})
    expect_says(refusal(text), "right after the colon must come a number");
  EXPECT_TRUE(refusal("D100").starts_with("'D100' ")) << "as it was written: " << refusal("D100");
  expect_says(refusal("40000"), "from 40001 to 49999 or from 400001 to 465536; ");
  expect_says(refusal("40000"), "write hr:40000");
  expect_says(refusal("465537"), "from 400001 to 465536");
  expect_says(refusal("20001"), "first digit");
  expect_says(refusal("4001"), "5 or 6 digits");
  expect_says(refusal("hr:5.16"), ".0 to .15");
  expect_says(refusal("co:5.1"), "only registers have bits");
}

TEST(Modbus, RangesOfTheAllowList) {
  const Modbus codec = unit();
  EXPECT_EQ(*codec.parse_range("hr:100-hr:119"), (Span{kHolding, 1600, 320}));
  EXPECT_EQ(*codec.parse_range("hr:100-119"), (Span{kHolding, 1600, 320}));
  EXPECT_EQ(*codec.parse_range("hr:100..hr:119"), (Span{kHolding, 1600, 320}));
  EXPECT_EQ(*codec.parse_range("hr:100..119"), (Span{kHolding, 1600, 320}));
  EXPECT_EQ(*codec.parse_range("co:7"), (Span{kCoil, 7, 1}));
  EXPECT_EQ(*codec.parse_range("40101-40102"), (Span{kHolding, 1600, 32}));
  for (const auto& [text, why] :
       std::vector<std::pair<const char*, const char*>>{{"hr:5-co:7", "one table"},
                                                        {"hr:7-hr:5", "ends before"},
                                                        {"hr:5.1", "whole coil or register"},
                                                        {"hr:5-x", "must come a number"},
                                                        {"hr:100-40119", "write hr:40119"},
                                                        {"D5-D7", "the forms are"}}) {
    expect_says(error_of(codec.parse_range(text)).text, why);
  }
}

TEST(Modbus, OnlyCoilsAndHoldingRegistersAreWritten) {
  const Modbus codec = unit();
  EXPECT_TRUE(codec.check_write({kCoil, 3, 1}));
  EXPECT_TRUE(codec.check_write({kCoil, 3, 7}));
  EXPECT_TRUE(codec.check_write({kHolding, 1600, 32}));
  EXPECT_TRUE(codec.check_write({kHolding, 1603, 1}));
  EXPECT_FALSE(codec.check_write({kHolding, 1603, 2}));
  EXPECT_FALSE(codec.check_write({kHolding, 0, 0}));
  EXPECT_FALSE(codec.check_write({kInput, 0, 1}));
  EXPECT_FALSE(codec.check_write({kInputRegister, 0, 16}));
  EXPECT_EQ(test::error_of(codec.check_range({kHolding, 65535 * 16, 32})).text,
            "hr:65535 needs 2 registers, hr:65535 to hr:65536: the table ends at hr:65535");
  EXPECT_FALSE(codec.check_range({9, 0, 1}));
  EXPECT_EQ(codec.name_of({9, 0, 1}), "space 9");
}

// ---- limits -------------------------------------------------------------------------------------

TEST(Modbus, LimitsAreThoseOfTheSpecificationAndOfTheConfig) {
  const Modbus codec = unit();
  EXPECT_EQ(codec.read_ways(kHolding)[0].max_bits, 125U * 16);
  EXPECT_EQ(codec.read_ways(kCoil)[0].max_bits, 2000U);
  EXPECT_EQ(codec.max_write_bits(kHolding), 123U * 16);
  EXPECT_EQ(codec.max_write_bits(kCoil), 1968U);
  EXPECT_EQ(codec.max_write_bits(kInput), 0U);
  EXPECT_TRUE(codec.read_ways(4).empty());
  const Modbus narrow({.max_read = 50, .max_gap = 0});
  EXPECT_EQ(narrow.read_ways(kInputRegister)[0].max_bits, 800U);
  EXPECT_EQ(narrow.read_ways(kInputRegister)[0].max_gap_bits, 0U);
  EXPECT_FALSE(narrow.encode(Read{{kHolding, 0, 51 * 16}}, 0));
  EXPECT_TRUE(codec.encode(Write{{kHolding, 0, 123 * 16}, Bytes(246)}, 0));
  EXPECT_FALSE(codec.encode(Write{{kHolding, 0, 124 * 16}, Bytes(248)}, 0));
  EXPECT_FALSE(codec.encode(Write{{kHolding, 0, 16}, Bytes(1)}, 0));
  EXPECT_FALSE(codec.encode(Write{{kInput, 0, 8}, Bytes(1)}, 0));
  EXPECT_FALSE(codec.encode(Read{{kHolding, 65535 * 16, 32}}, 0));
  EXPECT_FALSE(codec.encode(Read{{kHolding, 8, 16}}, 0));
  EXPECT_FALSE(codec.encode(Read{{7, 0, 16}}, 0));
  EXPECT_FALSE(codec.encode(Force{kInput, 0, true}, 0));
  EXPECT_FALSE(codec.encode(Force{kCoil, 65536, true}, 0));
  EXPECT_FALSE(codec.encode(Force{kHolding, 65536 * 16, true}, 0));
  EXPECT_FALSE(codec.encode(Enquire{}, 0));
}

TEST(Modbus, UnusedBitsOfTheLastByteAreSentAsZero) {
  EXPECT_EQ(to_hex(sent(unit(17), Write{{kCoil, 19, 10}, {0xCD, 0xFD}})),
            "11 0F 00 13 00 0A 02 CD 01 BF 0B");
}

// ---- bits of registers --------------------------------------------------------------------------

TEST(Modbus, ABitOfARegisterGoesByTheMaskWrite) {
  // V1.1b3, 6.16: result = (contents AND and_mask) OR (or_mask AND NOT and_mask).
  const Modbus codec = unit(17, Framing::tcp);
  EXPECT_EQ(to_hex(sent(codec, Force{kHolding, 4 * 16 + 3, true}, 0x1509)),
            "15 09 00 00 00 08 11 16 00 04 FF F7 00 08");
  EXPECT_EQ(to_hex(sent(codec, Force{kHolding, 4 * 16 + 15, false}, 0x1509)),
            "15 09 00 00 00 08 11 16 00 04 7F FF 00 00");
}

TEST(Modbus, WhereTheMaskWriteIsMissingTheRegisterIsReadFirstIfThatIsAllowed) {
  const Force force{kHolding, 4 * 16 + 11, true};
  EXPECT_EQ(unit().instead_of(force, 1), std::nullopt);
  const Modbus codec({.allow_read_modify_write = true});
  EXPECT_EQ(codec.read_before(force), std::nullopt);
  const auto other = codec.instead_of(force, 1).value();
  EXPECT_EQ(codec.instead_of(other, 1), std::nullopt);
  EXPECT_EQ(codec.read_before(other), Request(Read{{kHolding, 64, 16}}));
  EXPECT_FALSE(codec.encode(other, 0)) << "it cannot go without its read";
  EXPECT_EQ(codec.with_read(other, Bytes{0x34, 0x12}),
            Request(Write{{kHolding, 64, 16}, {0x34, 0x1A}}));
  Force off = std::get<Force>(other);
  off.on = false;
  off.bit = 64 + 2;
  EXPECT_EQ(codec.with_read(off, Bytes{0x34, 0x12}),
            Request(Write{{kHolding, 64, 16}, {0x30, 0x12}}));
  EXPECT_EQ(codec.with_read(other, Bytes{1}), other);
}

TEST(Modbus, AFunctionThatTheDeviceLacksIsReplaced) {
  const Modbus codec = unit(17);
  const auto coil = codec.instead_of(Force{kCoil, 19, true}, 1).value();
  EXPECT_EQ(sent(codec, coil)[1], 0x0F);
  EXPECT_EQ(codec.instead_of(coil, 1), std::nullopt);
  const auto word = codec.instead_of(Write{{kHolding, 16, 16}, {3, 0}}, 1).value();
  EXPECT_EQ(sent(codec, word)[1], 0x10);
  EXPECT_EQ(codec.instead_of(word, 1), std::nullopt);
  EXPECT_EQ(codec.instead_of(Write{{kHolding, 16, 32}, {3, 0, 4, 0}}, 1), std::nullopt);
  EXPECT_EQ(codec.instead_of(Force{kCoil, 19, true}, 2), std::nullopt);
}

// ---- answers ------------------------------------------------------------------------------------

const Request kRead = Read{{kHolding, 0x6B * 16, 48}};
const std::string kRtuAnswer = "11 03 06 02 2B 00 00 00 64 C8 BA";
const std::string kTcpAnswer = "15 03 00 00 00 09 FF 03 06 02 2B 00 00 00 64";

std::string garbled(const Modbus& codec, const Request& request, std::string_view rx,
                    std::uint16_t tag = 0) {
  return fault(codec, request, hex(rx), tag);
}
bool needs_more(const Modbus& codec, const Request& request, std::string_view rx,
                std::uint16_t tag = 0) {
  return test::needs_more(codec, request, hex(rx), tag);
}

TEST(Modbus, AWrongSumIsNamed) {
  EXPECT_EQ(garbled(unit(17), kRead, "11 03 06 02 2B 00 00 00 65 C8 BA"),
            "CRC C8 BA given, 09 7A computed");
  EXPECT_EQ(garbled(unit(17, Framing::ascii), Read{{kInputRegister, 128, 16}},
                    to_hex(Bytes{':', '1', '1', '0', '4', '0', '2', '0', '0', '0', 'B', 'D', 'F',
                                 '\r', '\n'})),
            "LRC DF given, DE computed");
}

TEST(Modbus, AnswersOfOtherUnitsAreWaitedPast) {
  // The same answer from unit 18; the CRC is that of its own frame.
  EXPECT_TRUE(needs_more(unit(18), kRead, kRtuAnswer));
  EXPECT_TRUE(needs_more(unit(0x12, Framing::ascii), Read{{kInputRegister, 128, 16}},
                         "3A 31 31 30 34 30 32 30 30 30 41 44 46 0D 0A"));
  expect_says(garbled(unit(1, Framing::tcp), kRead, kTcpAnswer, 0x1503),
              "unit 255 answered, unit 1 was asked");
}

TEST(Modbus, ALateAnswerIsToldByItsNumberOnTcp) {
  const Modbus codec = unit(255, Framing::tcp);
  EXPECT_TRUE(needs_more(codec, kRead, kTcpAnswer, 0x1504));
  const Reply reply = answer(
      codec, kRead, hex(kTcpAnswer + " 15 04 00 00 00 09 FF 03 06 00 01 00 02 00 03"), 0x1504);
  EXPECT_EQ(reply.image, (Bytes{1, 0, 2, 0, 3, 0}));
}

TEST(Modbus, AHeaderOfNonsenseEndsTheConnection) {
  const Modbus codec = unit(255, Framing::tcp);
  expect_says(garbled(codec, kRead, "15 03 00 00 03 84 FF"), "length 900");
  expect_says(garbled(codec, kRead, "15 03 00 00 00 02 FF 03"), "length 2");
  expect_says(garbled(codec, kRead, "48 54 54 50 2F 31"), "protocol 5450");
  EXPECT_EQ(codec.after_nonsense(), Recovery::reconnect);
  EXPECT_EQ(codec.after_silence(), Recovery::none);
  EXPECT_EQ(unit().after_nonsense(), Recovery::drain);
  EXPECT_EQ(unit().after_silence(), Recovery::drain);
}

TEST(Modbus, AnAnswerToAnotherQuestionIsNamedOnTcp) {
  const Modbus codec = unit(255, Framing::tcp);
  expect_says(garbled(codec, kRead, "00 00 00 00 00 05 FF 04 02 00 0A"), "another function");
  expect_says(garbled(codec, kRead, "00 00 00 00 00 05 FF 03 02 00 0A"), "count");
  expect_says(garbled(codec, kRead, "00 00 00 00 00 05 FF 03 07 00 0A"), "byte count");
  expect_says(garbled(codec, kRead, "00 00 00 00 00 04 FF 83 02 00"), "exception of 3");
  expect_says(garbled(codec, Force{kCoil, 1, true}, "00 00 00 00 00 05 FF 05 00 01 FF"), "write");
}

TEST(Modbus, ALateAnswerToAnotherWriteIsPassedOver) {
  const Modbus codec = unit(17);
  const Request write = Write{{kHolding, 16, 16}, {4, 0}};
  EXPECT_TRUE(needs_more(codec, write, "11 06 00 01 00 03 9A 9B"));
  const Bytes right = sent(codec, write);
  const Reply reply = answer(codec, write, hex("11 06 00 01 00 03 9A 9B " + to_hex(right)), 0);
  EXPECT_EQ(reply.kind, Reply::Kind::ack);
  EXPECT_EQ(reply.consumed, 16U);
}

TEST(Modbus, AWholeAnswerThatIsNotThisOnesIsPassedOverWhateverItHolds) {
  const Modbus codec = unit(17);
  // One register, for an abandoned request; the expected answer follows directly.
  EXPECT_TRUE(needs_more(codec, kRead, "11 03 02 00 64 78 6C"));
  Reply reply = answer(codec, kRead, hex("11 03 02 00 64 78 6C " + kRtuAnswer), 0);
  EXPECT_EQ(reply.consumed, 18U);
  // Registers of unit 5 that look like the beginning of an answer from unit 17.
  const std::string other = "05 03 06 11 03 06 02 2B 00 EB 4C ";
  EXPECT_TRUE(needs_more(codec, kRead, other));
  reply = answer(codec, kRead, hex(other + kRtuAnswer), 0);
  EXPECT_EQ(reply.image, (Bytes{0x2B, 0x02, 0, 0, 0x64, 0}));
  // A function whose answers have no length field.
  EXPECT_TRUE(needs_more(codec, kRead, "11 07 6D E2 18"));
}

// Application Protocol V1.1b3, 6.21: the example of the basic identification, its second length put
// right (15 characters, printed 0D).
const std::string kIdentity =
    "2B 0E 01 01 00 00 03 00 16 43 6F 6D 70 61 6E 79 20 69 64 65 6E 74 69 66 69 63 61 74 69 6F 6E "
    "01 0F 50 72 6F 64 75 63 74 20 63 6F 64 65 20 58 58 02 05 56 32 2E 31 31";

TEST(Modbus, ADeviceSaysWhoMadeIt) {
  for (const Framing framing : {Framing::rtu, Framing::ascii, Framing::tcp}) {
    const Modbus codec({.framing = framing, .unit = 17});
    const auto request = codec.identity().value();
    EXPECT_EQ(sent(codec, request), framed(framing, 17, hex("2B 0E 01 00"), 0));
    const Bytes frame = framed(framing, 17, hex(kIdentity), 0);
    // Not before the last byte.
    for (std::size_t length = 0; length < frame.size(); ++length)
      ASSERT_TRUE(needs_more(codec, request, to_hex(ByteView(frame).first(length)))) << length;
    const Reply reply = answer(codec, request, frame, 0);
    EXPECT_EQ(std::string(reply.image.begin(), reply.image.end()),
              "Company identification, Product code XX, V2.11");
    EXPECT_EQ(reply.consumed, frame.size());
  }
}

TEST(Modbus, AnIdentityIsPrintable) {
  const Modbus codec = unit(17);
  const Reply reply =
      answer(codec, *codec.identity(),
             framed(Framing::rtu, 17, hex("2B 0E 01 01 00 00 01 00 03 41 1B C3"), 0), 0);
  EXPECT_EQ(reply.image, (Bytes{'A', '?', '?'}));
}

TEST(Modbus, AnIdentityMayHaveMore) {
  const Modbus codec = unit(17);
  const Reply reply = answer(codec, *codec.identity(),
                             framed(Framing::rtu, 17, hex("2B 0E 01 01 FF 01 01 00 01 41"), 0), 0);
  EXPECT_EQ(std::string(reply.image.begin(), reply.image.end()), "A, and more");
}

TEST(Modbus, AnotherEncapsulatedInterfaceIsNoIdentity) {
  EXPECT_TRUE(needs_more(unit(17), *unit(17).identity(), "11 2B 0D 01 01 00 00 01 00 01 41"));
  EXPECT_EQ(answer_length(hex("2B 0D 01 01 00 00 01 00 01 41")), std::nullopt);
}

TEST(Modbus, AnIdentityWithObjectsBeyondItsFrameIsBad) {
  const Modbus codec({.framing = Framing::tcp, .unit = 17});
  for (const std::string pdu : {"2B 0E 01 01 00 00 02 00 01 41", "2B 0E 01 01 00 00 01 00 05 41",
                                "2B 0E 01 01 00 00 00 00 01 41"})
    EXPECT_FALSE(codec.decode(*codec.identity(), 0, framed(Framing::tcp, 17, hex(pdu), 0))) << pdu;
}

TEST(Modbus, ADeviceWithoutAnIdentityRefuses) {
  const Modbus codec = unit(17);
  const Reply reply =
      answer(codec, *codec.identity(), framed(Framing::rtu, 17, hex("AB 01"), 0), 0);
  EXPECT_EQ(reply.device_code, 1);
  EXPECT_FALSE(unit(0).identity());
}

TEST(Modbus, AReadOfRegister768IsNotAnsweredByItsOwnEcho) {
  // Its bytes form a whole frame: function 03, three bytes of data.
  const Modbus codec = unit(17);
  const Request read = Read{{kHolding, 0x300 * 16, 32}};
  const std::string echo = "11 03 03 00 00 02 C6 DF";
  EXPECT_EQ(to_hex(sent(codec, read)), echo);
  EXPECT_TRUE(needs_more(codec, read, echo));
  const Reply reply = answer(codec, read, hex(echo + " 11 03 04 00 01 00 02 3B F3"), 0);
  EXPECT_EQ(reply.image, (Bytes{1, 0, 2, 0}));
}

// The protocol cannot distinguish these from an echo. They count as answers, because most lines
// have no echo; if a line has one, the device's `echo` removes the request first.
TEST(Modbus, AnAnswerWithTheBytesOfItsQuestionIsAnAnswer) {
  const Modbus codec = unit(17);
  const Request coils = Read{{kCoil, 0x3AB, 24}};
  const std::string line = "11 01 03 AB 00 18 4F 34";
  EXPECT_EQ(to_hex(sent(codec, coils)), line);
  const Reply reply = answer(codec, coils, hex(line), 0);
  EXPECT_EQ(reply.image, (Bytes{0xAB, 0x00, 0x18}));
  for (const Request& write :
       {Request(Force{kCoil, 0xAC, true}), Request(Write{{kHolding, 16, 16}, {3, 0}}),
        Request(Force{kHolding, 4 * 16 + 3, true})}) {
    const Reply echoed = answer(codec, write, sent(codec, write), 0);
    EXPECT_EQ(echoed.kind, Reply::Kind::ack);
  }
}

TEST(Modbus, AsciiBeginsAnewAtEveryColonAndTakesLowerCase) {
  const Modbus codec = unit(17, Framing::ascii);
  const Request read = Read{{kInputRegister, 128, 16}};
  const Reply reply = answer(codec, read, ascii("xx:11:1104:110402000adf\r\n"), 0);
  EXPECT_EQ(reply.image, (Bytes{10, 0}));
  EXPECT_FALSE(codec.decode(read, 0, ascii(":110402000AD\r\n")));
  EXPECT_FALSE(codec.decode(read, 0, ascii(":110402000ADF\rx")));
  EXPECT_FALSE(codec.decode(read, 0, ascii(":1104G2000ADF\r\n")));
  EXPECT_FALSE(codec.decode(read, 0, ascii(":11EF\r\n")));
  EXPECT_FALSE(codec.decode(read, 0, Bytes(600, ':')).has_value());
}

TEST(Modbus, ABabblingLineIsNamed) {
  expect_says(unit().decode(kRead, 0, Bytes(600, 0x7F)).error().text, "600 bytes");
  EXPECT_FALSE(unit(1, Framing::ascii).decode(kRead, 0, Bytes(1100, 0x7F)));
}

TEST(Modbus, AnExceptionThatTheSpecificationDoesNotKnowIsShownAsItIs) {
  const Modbus codec = unit(255, Framing::tcp);
  const Reply reply = answer(codec, kRead, hex("00 00 00 00 00 03 FF 83 7F"), 0);
  EXPECT_EQ(reply.text, "exception 7F: not in the specification");
  EXPECT_EQ(reply.device_code, 0x7F);
}

TEST(Modbus, ExceptionsMeanWhatTheyMeanToReadsAndToWrites) {
  const Modbus codec = unit();
  const Request write = Write{{kHolding, 0, 16}, {0, 0}};
  const auto meaning = [&](const Request& request, int code) {
    return codec.meaning_of(request, code);
  };
  using enum RefusalMeaning;
  const struct {
    int code;
    RefusalMeaning read, write;
  } cases[] = {{1, final, final},          {2, hole, final},      {3, hole, final},
               {4, final, unclear},        {5, busy, unclear},    {6, busy, busy},
               {7, final, final},          {8, final, final},     {10, unreachable, final},
               {11, unreachable, unclear}, {0x7F, final, unclear}};
  for (const auto& c : cases) {
    EXPECT_EQ(meaning(kRead, c.code), c.read) << c.code;
    EXPECT_EQ(meaning(write, c.code), c.write) << c.code;
    EXPECT_NE(exception_coded(c.code).text.empty(), c.code != 0x7F) << c.code;
  }
}

// ---- the line -----------------------------------------------------------------------------------

TEST(Modbus, RtuRestsForThreeAndAHalfCharactersAndNeverLessThan1750Microseconds) {
  EXPECT_EQ(unit().quiet_before(1145833ns), 4010415ns);  // 11 bits at 9600
  EXPECT_EQ(unit().quiet_before(95486ns), 1750us);       // 115200
  EXPECT_EQ(unit().quiet_before(0ns), 0ns);              // through a serial server
  EXPECT_EQ(unit(1, Framing::ascii).quiet_before(1ms), 0ns);
  EXPECT_EQ(unit(1, Framing::tcp).quiet_before(1ms), 0ns);
}

TEST(Modbus, ABroadcastIsNotAnsweredAndNotReadFrom) {
  const Modbus everybody = unit(0);
  const Request write = Write{{kHolding, 16, 16}, {0xAA, 0}};
  EXPECT_TRUE(everybody.is_broadcast());
  EXPECT_FALSE(everybody.expects_reply(write));
  EXPECT_EQ(everybody.pause_after(write), 200ms);
  EXPECT_EQ(unit().pause_after(write), 0ms);
  EXPECT_EQ(everybody.line_length(write).reply_chars, 0U);
  EXPECT_FALSE(everybody.encode(kRead, 0));
  EXPECT_FALSE(everybody.decode(write, 0, hex("00")));
  EXPECT_FALSE(everybody.read_ways(kHolding).empty()) << "a tag to write to needs a place";
  EXPECT_FALSE(unit(0, Framing::tcp).is_broadcast());
}

TEST(Modbus, HasNothingThatOnlyAPlcHas) {
  const Modbus codec = unit();
  EXPECT_FALSE(codec.resync());
  EXPECT_FALSE(codec.probe(0));
  EXPECT_EQ(codec.plc(), nullptr);
  EXPECT_EQ(model_of(codec), "");
  EXPECT_FALSE(must_ask_model(codec));
}

TEST(Modbus, IsMadeFromItsOptions) {
  const ProtocolInfo* rtu = find_protocol("modbus-rtu");
  ASSERT_NE(rtu, nullptr);
  Options options = default_options(*rtu);
  auto made = rtu->make(options);
  ASSERT_TRUE(made);
  EXPECT_EQ((*made)->addresses().default_order(), ByteOrder::abcd);
  options["byte_order"] = std::string("CDAB");
  options["max_read"] = std::int64_t{10};
  made = rtu->make(options);
  ASSERT_TRUE(made);
  EXPECT_EQ((*made)->addresses().default_order(), ByteOrder::cdab);
  EXPECT_EQ((*made)->addresses().read_ways(kHolding)[0].max_bits, 160U);
  options["unit"] = std::int64_t{250};
  expect_says(rtu->make(options).error().text, "reserved");
  EXPECT_TRUE(find_protocol("modbus-tcp")->make(options));
  EXPECT_TRUE(find_protocol("modbus-ascii")->make(default_options(*rtu)));
  options["byte_order"] = std::string("XYZ");
  EXPECT_FALSE(find_protocol("modbus-tcp")->make(options));
}

TEST(Modbus, APlanKeepsToTheGap) {
  const Modbus codec({.max_gap = 2});
  std::vector<Point> points;
  for (const char* text : {"hr:0", "hr:3", "hr:7", "co:0", "co:20"}) {
    Point point{.address = address(text, codec)};
    point.type = default_type(point.address);
    points.push_back(point);
  }
  const Plan plan = make_plan(codec, points, LineCost{1ms, 30ms}, 0);
  ASSERT_EQ(plan.reads.size(), 3U);
  EXPECT_EQ(plan.reads[0].read.span, (Span{kCoil, 0, 21}));
  EXPECT_EQ(plan.reads[1].read.span, (Span{kHolding, 0, 64}));
  EXPECT_EQ(plan.reads[2].read.span, (Span{kHolding, 112, 16}));
}

TEST(Modbus, EveryPlanIsSendableBringsEveryPointAndKeepsToGapAndLength) {
  Pick pick(20261121);
  for (int round = 0; round < 60; ++round) {
    const Settings settings{.max_read = pick(2, 125), .max_gap = pick(0, 20)};
    const Modbus codec(settings);
    std::vector<Point> points;
    for (int i = 0; i < 40; ++i) {
      const auto space = static_cast<Space>(pick(0, 3));
      // Half of them are at the end of the table, where there is no room to round up.
      const std::uint32_t number = pick(0, 1) == 0 ? pick(0, 600) : pick(65000, 65534);
      Point point{.address = address(name_of(space, number, 0), codec)};
      point.type = default_type(point.address);
      if (width_of(space) == 16 && pick(0, 2) == 0) point.type = DataType::float32;
      points.push_back(point);
    }
    const Plan plan = make_plan(codec, points, LineCost{1ms, 5ms}, 0);
    EXPECT_TRUE(plan.unreachable.empty());
    for (std::size_t i = 0; i < points.size(); ++i) {
      ASSERT_EQ(plan.sources[i].count, 1U);
      const Span& read = plan.reads[plan.sources[i].first_read].read.span;
      EXPECT_TRUE(read.contains(*span_of(points[i]))) << std::string_view(points[i].address.text);
    }
    for (const PlannedRead& planned : plan.reads) {
      const Span& span = planned.read.span;
      EXPECT_TRUE(codec.encode(planned.read, 0)) << codec.name_of(span);
      EXPECT_LE(span.bits, settings.max_read * 16);
      std::vector<bool> asked(span.bits, false);
      for (const std::uint32_t index : planned.points) {
        const Span place = *span_of(points[index]);
        for (std::uint32_t bit = 0; bit < place.bits; ++bit)
          asked[place.first_bit - span.first_bit + bit] = true;
      }
      std::uint32_t unasked = 0;
      for (const bool wanted : asked) {
        unasked = wanted ? 0 : unasked + 1;
        EXPECT_LE(unasked, settings.max_gap * 16) << codec.name_of(span);
      }
    }
  }
}

// ---- decode ------------------------------------------------------------------------------------

TEST(ModbusExplain, TellsARequestFromAnAnswer) {
  const auto request = explained(Framing::rtu, hex("11 03 00 6B 00 03 76 87"), std::nullopt);
  EXPECT_TRUE(request.ok);
  EXPECT_EQ(request.direction, Direction::request);
  EXPECT_FALSE(request.ambiguous);
  EXPECT_EQ(request.operation, "read");
  EXPECT_EQ(request.command, "03");
  EXPECT_EQ(request.device, "hr:107");
  EXPECT_EQ(request.count, 3U);
  EXPECT_EQ(request.checksum_given, "76 87");
  const auto reply = explained(Framing::rtu, hex(kRtuAnswer), std::nullopt);
  EXPECT_EQ(reply.direction, Direction::reply);
  EXPECT_EQ(reply.operation, "data");
  EXPECT_EQ(reply.values, (std::vector<std::string>{"022B", "0000", "0064"}));
  const auto both = explained(Framing::rtu, hex("11 05 00 AC FF 00 4E 8B"), std::nullopt);
  EXPECT_TRUE(both.ambiguous);
  EXPECT_EQ(both.operation, "force_on");
}

TEST(ModbusExplain, SaysWhatIsWrong) {
  const auto error = [](Framing framing, std::string_view frame,
                        std::optional<Direction> direction = std::nullopt) {
    const auto out = explained(framing, hex(frame), direction);
    EXPECT_FALSE(out.ok) << frame;
    return out.error.value_or("");
  };
  expect_says(error(Framing::rtu, "11 03 00 6B 00 03 76 88"), "CRC 76 88 given, 76 87 computed");
  expect_says(error(Framing::rtu, "11 03"), "too short");
  expect_says(error(Framing::tcp, "15 03 00 00 00 06 FF 03 00"), "shorter");
  expect_says(error(Framing::tcp, kTcpAnswer + " 00"), "1 bytes follow");
  expect_says(error(Framing::tcp, "15 03 00 01 00 06 FF 03 00 6B 00 03"), "protocol 0001");
  expect_says(error(Framing::ascii, "3A 31 31"), "CR LF");
  const auto request = Direction::request;
  const auto reply = Direction::reply;
  expect_says(error(Framing::tcp, "00 00 00 00 00 06 FF 03 00 00 00 7E", request), "1 to 125");
  expect_says(error(Framing::tcp, "00 00 00 00 00 06 FF 05 00 00 12 34", request), "FF00 or 0000");
  expect_says(error(Framing::tcp, "00 00 00 00 00 06 FF 03 FF FF 00 02", request), "65535");
  expect_says(error(Framing::tcp, "00 00 00 00 00 03 FF 83 02", request), "not a request");
  expect_says(error(Framing::tcp, "00 00 00 00 00 04 FF 83 02 00", reply), "2 belong");
  expect_says(error(Framing::tcp, "00 00 00 00 00 05 FF 10 00 01 00", request), "before its data");
  expect_says(error(Framing::tcp, "00 00 00 00 00 05 FF 17 00 01 00", request), "before its data");
  expect_says(error(Framing::tcp, "00 00 00 00 00 0B FF 10 00 01 00 02 03 00 0A 01 02", request),
              "byte count 3");
  expect_says(error(Framing::tcp, "00 00 00 00 00 05 FF 03 04 00 0A", reply), "byte count");
  expect_says(error(Framing::tcp, "00 00 00 00 00 06 FF 03 03 00 0A 0B", reply), "odd count");
  expect_says(error(Framing::tcp, "00 00 00 00 00 05 FF 10 00 01 00", reply), "5 belong");
}

TEST(ModbusExplain, AFunctionThatIsNeverSentIsStillAFrame) {
  const auto out = explained(Framing::rtu, hex("02 07 41 12"), std::nullopt);
  EXPECT_TRUE(out.ok);
  EXPECT_EQ(out.operation, "other");
  EXPECT_EQ(out.command, "07");
  EXPECT_EQ(out.direction, Direction::request);
  EXPECT_FALSE(out.ambiguous);
  const auto answer = explained(Framing::rtu, hex("11 07 6D E2 18"), std::nullopt);
  EXPECT_TRUE(answer.ok);
  EXPECT_EQ(answer.direction, Direction::reply);
  EXPECT_FALSE(explained(Framing::rtu, hex("11 07 6D E2 18"), Direction::request).ok);
  EXPECT_FALSE(explained(Framing::rtu, hex("02 07 41 12"), Direction::reply).ok);
  const auto own = explained(Framing::rtu, hex("11 42 00 00 00 00 7B 55"), std::nullopt);
  EXPECT_TRUE(own.ok);
  EXPECT_TRUE(own.ambiguous);
  EXPECT_FALSE(explained(Framing::rtu, hex("11 00 01 E0 05"), std::nullopt).ok);
}

TEST(ModbusExplain, AFrameThatFitsNeitherWayIsTakenForWhatItLooksLike) {
  const auto direction = [](std::string_view pdu) {
    Bytes frame = hex("00 00 00 00 00 00 FF " + std::string(pdu));
    frame[5] = static_cast<std::uint8_t>(frame.size() - 6);
    const auto out = explained(Framing::tcp, frame, std::nullopt);
    EXPECT_FALSE(out.ok) << pdu;
    return out.direction;
  };
  EXPECT_EQ(direction("03 00 00 00 7E"), Direction::request);
  EXPECT_EQ(direction("03 04 00 0A"), Direction::reply);
  EXPECT_EQ(direction("10 00 01 00 02 03 00"), Direction::request);
  EXPECT_EQ(direction("83 02 00"), Direction::reply);
  EXPECT_EQ(direction("00"), Direction::request);
}

TEST(ModbusExplain, BothSumsAreShownWhereTheyDiffer) {
  const std::string_view text = ":110402000AD0\r\n";
  const auto ascii = explained(Framing::ascii, Bytes(text.begin(), text.end()), std::nullopt);
  EXPECT_FALSE(ascii.ok);
  EXPECT_EQ(ascii.checksum_given, "D0");
  EXPECT_EQ(ascii.checksum_computed, "DF");
  EXPECT_EQ(ascii.operation, "data");
  // The specification's example with one byte changed and the original sum.
  const auto rtu = explained(Framing::rtu, hex("01 02 03 AC DB 35 22 78"), Direction::reply);
  EXPECT_FALSE(rtu.ok);
  EXPECT_EQ(rtu.checksum_given, "22 78");
  EXPECT_EQ(rtu.checksum_computed, "22 88");
  const auto tcp = explained(Framing::tcp, hex(kTcpAnswer), std::nullopt);
  EXPECT_FALSE(tcp.checksum_given);
}

}  // namespace
}  // namespace fxagent::modbus
