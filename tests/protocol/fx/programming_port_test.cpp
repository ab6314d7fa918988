#include "protocol/fx/programming_port.h"

#include <gtest/gtest.h>

#include "protocol/catalog.h"
#include "protocol/plan/plan.h"
#include "protocol/value/pack.h"
#include "tests/protocol/answers.h"

namespace fxagent::fx {
namespace {

using namespace test;
using Commands = ProgrammingPort::Commands;

ProgrammingPort port(Model model = Model::fx3u, Commands commands = Commands::automatic,
                     std::uint32_t max_block_bytes = 64) {
  return ProgrammingPort({model, commands, max_block_bytes});
}

Span span(std::string_view address, std::uint32_t bytes) {
  const auto parsed = fx::parse_address(Model::unknown_fx, address, std::nullopt);
  EXPECT_TRUE(parsed.has_value()) << address;
  const std::uint32_t first = parsed->span.first_bit;
  return {parsed->span.space, first - first % 8, bytes * 8};
}

// ---- transcripts ------------------------------------------------------------------------------

/// The codec with the transcript's settings.
ProgrammingPort port_of(const test::Exchange& e) {
  const auto commands = e.command_set == "extended" ? Commands::extended : Commands::classic;
  return port(*model_named(e.model), commands);
}

std::optional<Request> request_of(const test::Exchange& e) {
  const std::uint8_t way = e.command_set == "extended" ? 1 : 0;
  if (e.operation == "enquire") return Enquire{};
  if (e.operation == "read") return Read{span(e.device, e.bytes), way};
  if (e.operation == "write") return Write{span(e.device, e.bytes), e.image};
  if (e.operation != "force_on" && e.operation != "force_off") return std::nullopt;
  const auto address = fx::parse_address(Model::unknown_fx, e.device, std::nullopt);
  return Force{address->span.space, address->span.first_bit, e.operation == "force_on"};
}

TEST(ProgrammingPort, ExtensionRegistersAreRefusedWithTheProtocolThatReachesThem) {
  const auto codec = port();
  for (const auto& refused :
       {codec.parse_address("R0", std::nullopt).map([](auto) {}),
        codec.parse_range("R0-R9").map([](auto) {}), codec.check_range({id(Space::r), 0, 16})})
    expect_says(error_of(refused).text, "computer link");
}

TEST(ProgrammingPort, SpeaksEveryFrameOfTheTranscripts) {
  const auto all = spoken_in("fx_programming_port.txt", request_of);
  for (const auto& [e, request] : all) expect_spoken(port_of(e), request, e);
  EXPECT_EQ(all.size(), 184U);
}

TEST(ProgrammingPort, UnderstandsEveryAnswerOfTheTranscripts) {
  const auto all = answered_in("fx_programming_port.txt", request_of);
  for (const auto& [e, request] : all) expect_understood(port_of(e), request, e, false);
  EXPECT_GT(all.size(), 100U);
}

TEST(ProgrammingPort, TheWordThatWasPrintedAs3584Is33845) {
  // The printed frame ends with D6, but the sum of its digits is D7; 35 84 is 8435h.
  const Read read{span("D123", 2), 0};
  EXPECT_EQ(error_of(port().decode(read, 0, hex("02 33 35 38 34 03 44 36"))).text,
            "sum D6 given, D7 computed");
  const auto right = port().decode(read, 0, hex("02 33 35 38 34 03 44 37"));
  const Point point{.address = *fx::parse_address(Model::fx3u, "D123", std::nullopt),
                    .type = DataType::uint16};
  EXPECT_EQ(unpack(point, (*right)->image, read.span.first_bit), Value(std::int64_t{33845}));
}

// ---- requests ----------------------------------------------------------------------------------

TEST(ProgrammingPort, ClassicCommandsAreTakenWhereverTheyReach) {
  EXPECT_EQ(*port().encode(Force{id(Space::y), 0, true}, 0), hex("02 37 30 30 30 35 03 46 46"));
  EXPECT_EQ(*port().encode(Force{id(Space::m), 1536, true}, 0), ascii("<E70046>49"));
  EXPECT_EQ(*port().encode(Write{span("D1023", 2), {0x34, 0x12}}, 0)->begin(), 0x02);
  EXPECT_EQ((*port().encode(Write{span("D1023", 2), {0x34, 0x12}}, 0))[1], '1');
  EXPECT_EQ((*port().encode(Write{span("D1024", 2), {0x34, 0x12}}, 0))[1], 'E');
  // A write that starts within the classic range and ends outside is not split.
  EXPECT_EQ((*port().encode(Write{span("D1023", 4), {1, 2, 3, 4}}, 0))[1], 'E');
}

TEST(ProgrammingPort, AnUnknownModelIsSpokenToInClassicCommandsOnly) {
  const auto codec = port(Model::unknown_fx);
  for (const ReadWay& way : codec.read_ways(id(Space::d))) EXPECT_EQ(way.way, 0);
  EXPECT_EQ(codec.read_ways(id(Space::d)).size(), 1U);
  const auto error = error_of(codec.encode(Write{span("D1024", 2), {1, 2}}, 0));
  EXPECT_EQ(error.code, ErrorCode::unsupported);
  expect_says(error.text, "the model is not known");
  EXPECT_EQ(codec.with_model("FX3U")->addresses().read_ways(id(Space::d)).size(), 2U);
  EXPECT_TRUE(port(Model::unknown_fx, Commands::extended).read_ways(id(Space::d)).empty());
}

TEST(ProgrammingPort, ClassicIsTierZeroAndExtendedTierOne) {
  const auto ways = port().read_ways(id(Space::m));
  ASSERT_EQ(ways.size(), 2U);
  EXPECT_EQ(ways[0].tier, 0);
  EXPECT_EQ(ways[0].end_bit, 1536U);
  EXPECT_EQ(ways[1].tier, 1);
  EXPECT_EQ(ways[1].first_bit, 0U);
  EXPECT_EQ(ways[1].end_bit, 7680U);
  EXPECT_EQ(port(Model::fx3u, Commands::extended).read_ways(id(Space::m)).size(), 1U);
  EXPECT_EQ(port(Model::fx3u, Commands::classic).read_ways(id(Space::m)).size(), 1U);
  EXPECT_EQ(port(Model::fx1s).read_ways(id(Space::m)).size(), 1U);
  EXPECT_TRUE(port().read_ways(id(Space::tc)).empty());
  EXPECT_TRUE(port().read_ways(99).empty());
}

TEST(ProgrammingPort, NoReadGoesBeyondTheModelsLastDevice) {
  EXPECT_EQ(port(Model::fx1s).read_ways(id(Space::y))[0].end_bit, 16U);  // Y0-Y15, in whole bytes
  EXPECT_EQ(port(Model::fx0n).read_ways(id(Space::d))[0].end_bit, 4096U);
  EXPECT_EQ(port(Model::fx3s).read_ways(id(Space::d))[1].end_bit, 48000U);
  const auto contacts = port(Model::fx0n).read_ways(id(Space::cs));
  ASSERT_EQ(contacts.size(), 2U);
  EXPECT_EQ(contacts[0].end_bit, 32U);
  EXPECT_EQ(contacts[1].first_bit, 232U);
  EXPECT_EQ(contacts[1].end_bit, 256U);
  const auto counters = port(Model::fx1s).read_ways(id(Space::cn32));
  ASSERT_EQ(counters.size(), 1U);
  EXPECT_EQ(counters[0].first_bit, 35U * 32);
  EXPECT_EQ(error_of(port(Model::fx0n).encode(Read{span("D255", 4), 0}, 0)).code,
            ErrorCode::unsupported);
}

TEST(ProgrammingPort, ReadsThatBreakTheLimitsAreNotSent) {
  const auto refused = [](const Request& request, const ProgrammingPort& codec) {
    return error_of(codec.encode(request, 0)).code;
  };
  EXPECT_TRUE(port().encode(Read{span("D0", 64), 0}, 0));
  EXPECT_EQ(refused(Read{span("D0", 66), 0}, port()), ErrorCode::bad_request);
  EXPECT_EQ(refused(Read{{id(Space::m), 4, 8}, 0}, port()), ErrorCode::bad_request);
  EXPECT_EQ(refused(Read{{id(Space::m), 0, 4}, 0}, port()), ErrorCode::bad_request);
  EXPECT_EQ(refused(Read{{id(Space::m), 0, 0}, 0}, port()), ErrorCode::bad_request);
  EXPECT_EQ(refused(Read{{id(Space::d), 8, 16}, 0}, port()), ErrorCode::bad_request);
  EXPECT_EQ(refused(Read{span("D2000", 2), 0}, port()), ErrorCode::unsupported);
  EXPECT_EQ(refused(Read{span("D0", 2), 1}, port(Model::fx1s)), ErrorCode::unsupported);
  EXPECT_EQ(refused(Read{{99, 0, 8}, 0}, port()), ErrorCode::unsupported);
}

TEST(ProgrammingPort, LongFramesAreForExtendedReadsOfAnFx3ThatAsksForThem) {
  const Read read{span("D0", 254), 1};
  EXPECT_TRUE(port(Model::fx3u, Commands::extended, 254).encode(read, 0));
  EXPECT_FALSE(port(Model::fx3u, Commands::extended).encode(read, 0));
  EXPECT_FALSE(port(Model::fx2n, Commands::extended, 254).encode(read, 0));
  EXPECT_FALSE(port(Model::fx3u, Commands::automatic, 254).encode(Read{span("D0", 254), 0}, 0));
  EXPECT_EQ(port(Model::fx3u, Commands::automatic, 254).max_write_bits(id(Space::d)), 512U);
  EXPECT_EQ(port(Model::fx3u, Commands::automatic, 10).max_write_bits(id(Space::d)), 80U);
  EXPECT_EQ(port(Model::fx3u, Commands::automatic, 2).read_ways(id(Space::cn32))[0].max_bits, 32U);
  EXPECT_EQ(port().max_write_bits(99), 0U);
}

TEST(ProgrammingPort, MaxBlockBytesComesFromTheOptions) {
  const auto made = ProgrammingPort::make({{"model", std::string("FX3U")},
                                           {"command_set", std::string("extended")},
                                           {"max_block_bytes", std::int64_t{128}}});
  ASSERT_TRUE(made);
  EXPECT_EQ((*made)->addresses().read_ways(id(Space::d))[0].max_bits, 1024U);
}

TEST(ProgrammingPort, WritesThatBreakTheLimitsAreNotSent) {
  const auto refused = [](const Request& request) {
    return error_of(port().encode(request, 0)).text;
  };
  EXPECT_TRUE(port().encode(Write{span("D0", 64), Bytes(64)}, 0));
  expect_says(refused(Write{span("D0", 66), Bytes(66)}), "at most 512");
  expect_says(refused(Write{span("D0", 4), Bytes(2)}), "with 2 bytes");
  expect_says(refused(Write{{id(Space::m), 0, 1}, Bytes(1)}), "whole bytes");
  expect_says(refused(Write{{id(Space::m), 12, 8}, Bytes(1)}),
              "M12: a write of several bits must begin at a multiple of 8, such as M8, and fill "
              "whole bytes");
  expect_says(refused(Write{{id(Space::y), 9, 8}, Bytes(1)}), "such as Y10,");
  expect_says(refused(Write{span("M8032", 1), Bytes(1)}), "M8118");
  expect_says(refused(Force{id(Space::special_m), 118, true}), "M8118");
  expect_says(refused(Force{id(Space::special_m), 36, false}), "M8118");
  expect_says(refused(Force{id(Space::d), 5, true}), "only whole words");
  expect_says(refused(Force{id(Space::m), 7680, true}), "does not exist");
  expect_says(refused(Control{Control::Kind::run}), "M8037");
  const auto classic = port(Model::fx3u, Commands::classic);
  expect_says(error_of(classic.encode(Force{id(Space::m), 2000, true}, 0)).text,
              "which is not in use");
}

// ---- answers with data --------------------------------------------------------------------------

// D123 and D124 hold 1234h and ABCDh.
const Read kRead{{id(Space::d), 123 * 16, 32}, 0};
const std::string kRequest = "<010F604>74";
const std::string kAnswer = "<3412CDAB>D7";

Result<std::optional<Reply>> answer(const std::string& rx, const Request& request = kRead) {
  return port().decode(request, 0, ascii(rx));
}

/// Returns the image of a good answer; empty if there is none, which no test expects.
Bytes image(const std::string& rx) { return test::answer(port(), kRead, ascii(rx)).image; }

std::string bad_frame(const std::string& rx, const Request& request = kRead) {
  return fault(port(), request, ascii(rx));
}

bool needs_more(const std::string& rx, const Request& request = kRead) {
  return test::needs_more(port(), request, ascii(rx));
}

const Bytes kImage{0x34, 0x12, 0xCD, 0xAB};

TEST(ProgrammingPort, DataComeLowByteFirst) { EXPECT_EQ(image(kAnswer), kImage); }

TEST(ProgrammingPort, EveryBeginningOfAnAnswerNeedsMore) {
  for (std::size_t n = 0; n < kAnswer.size(); ++n)
    EXPECT_TRUE(needs_more(kAnswer.substr(0, n))) << n;
}

TEST(ProgrammingPort, NoiseBeforeTheAnswerIsSkipped) {
  EXPECT_EQ(image(std::string("\xFF\x00?>", 4) + kAnswer), kImage);
  const auto reply = answer("??" + kAnswer);
  EXPECT_EQ((*reply)->consumed, kAnswer.size() + 2);
}

TEST(ProgrammingPort, AStrayAckBeforeTheAnswerIsSkipped) {
  EXPECT_EQ(image("+" + kAnswer), kImage);
  EXPECT_TRUE(needs_more("+"));
}

TEST(ProgrammingPort, ANakBeforeAnyStxIsARefusal) {
  for (const std::string rx : {"-", "?-", "->"}) {
    const auto reply = answer(rx);
    ASSERT_TRUE(reply && *reply);
    EXPECT_EQ((*reply)->kind, Reply::Kind::nak);
    EXPECT_EQ((*reply)->device_code, 0);
    EXPECT_FALSE((*reply)->text.empty());
    EXPECT_TRUE((*reply)->image.empty());
  }
  EXPECT_EQ((*answer("?->"))->consumed, 2U);
}

TEST(ProgrammingPort, TheEchoOfARequestIsSkipped) {
  EXPECT_EQ(image(kRequest + kAnswer), kImage);
  EXPECT_EQ(image(kRequest + "+" + kAnswer), kImage);
  const auto refused = answer(kRequest + "-");
  EXPECT_EQ((*refused)->kind, Reply::Kind::nak);
}

TEST(ProgrammingPort, AnEchoStillOnItsWayNeedsMore) {
  for (std::size_t n = 0; n <= kRequest.size(); ++n)
    EXPECT_TRUE(needs_more(kRequest.substr(0, n))) << n;
}

TEST(ProgrammingPort, AFrameThatEqualsTheRequestIsNeverAnAnswer) {
  EXPECT_TRUE(needs_more("?" + kRequest));
  EXPECT_TRUE(needs_more(kRequest + kRequest));
  EXPECT_EQ(image(kRequest + kRequest + kAnswer), kImage);
}

TEST(ProgrammingPort, AFrameCutOffByAnotherStxBeginsAgain) {
  EXPECT_EQ(image("<34" + kAnswer), kImage);
  EXPECT_EQ(image("<3412>" + kAnswer), kImage);
  EXPECT_EQ(image("<3412>C" + kAnswer), kImage);
}

TEST(ProgrammingPort, AWrongSumIsABadFrameThatNamesBothSums) {
  EXPECT_EQ(bad_frame("<3412CDAB>D8"), "sum D8 given, D7 computed");
  EXPECT_EQ(bad_frame("<3412CDAC>D7"), "sum D7 given, D8 computed");
}

TEST(ProgrammingPort, ASumThatIsNotHexIsABadFrame) {
  EXPECT_EQ(bad_frame("<3412CDAB>G7"), "sum 47 37 is not two hex digits");
  EXPECT_EQ(bad_frame("<3412CDAB>D+"), "sum 44 06 is not two hex digits");
}

TEST(ProgrammingPort, AnAnswerOfAnotherLengthIsABadFrame) {
  EXPECT_EQ(bad_frame("<3412>CD"), "4 data digits given, 8 expected");
  EXPECT_EQ(bad_frame("<>03"), "0 data digits given, 8 expected");
  EXPECT_EQ(bad_frame("<3412CDAB00>37"), "10 data digits given, 8 expected");
}

TEST(ProgrammingPort, DataThatAreNotHexAreABadFrame) {
  EXPECT_EQ(bad_frame("<3412CDAG>DC"), "data 41 47 is not two hex digits");
  EXPECT_EQ(bad_frame("<34 2CDAB>C6"), "data 20 32 is not two hex digits");
}

TEST(ProgrammingPort, LowerCaseDigitsAreUnderstood) { EXPECT_EQ(image("<3412cdab>57"), kImage); }

TEST(ProgrammingPort, MoreThanTheLongestFrameWithoutAnEndIsABadFrame) {
  EXPECT_TRUE(needs_more("<" + std::string(511, '0')));
  expect_says(bad_frame("<" + std::string(512, '0')), "513 bytes");
  EXPECT_TRUE(needs_more(std::string(512, '?')));
  expect_says(bad_frame(std::string(513, '?')), "513 bytes");
}

TEST(ProgrammingPort, WhatFollowsTheAnswerIsNotConsumed) {
  const auto reply = answer(kAnswer + ">+");
  ASSERT_TRUE(reply && *reply);
  EXPECT_EQ((*reply)->consumed, kAnswer.size());
}

// ---- bare ACK and NAK ---------------------------------------------------------------------------

const Force kForce{id(Space::y), 0, true};
const std::string kForceRequest = "<70005>FF";

Reply::Kind verdict(const std::string& rx, const Request& request = kForce) {
  return test::answer(port(), request, ascii(rx)).kind;
}

TEST(ProgrammingPort, AckAndNakAnswerWritesForcesAndEnquiries) {
  for (const Request& request :
       {Request(kForce), Request(Enquire{}), Request(Write{span("D0", 2), {1, 2}})}) {
    EXPECT_EQ(verdict("+", request), Reply::Kind::ack);
    EXPECT_EQ(verdict("-", request), Reply::Kind::nak);
    EXPECT_TRUE(needs_more("", request));
  }
}

TEST(ProgrammingPort, TheEchoOfAnOrderIsSkipped) {
  EXPECT_EQ(verdict(kForceRequest + "+"), Reply::Kind::ack);
  EXPECT_EQ(verdict(kForceRequest + "-"), Reply::Kind::nak);
  EXPECT_EQ(verdict("%+", Enquire{}), Reply::Kind::ack);
  EXPECT_TRUE(needs_more("%", Enquire{}));
  for (std::size_t n = 0; n <= kForceRequest.size(); ++n)
    EXPECT_TRUE(needs_more(kForceRequest.substr(0, n), kForce)) << n;
}

TEST(ProgrammingPort, TheLateAnswerToAnOldReadIsSkippedBeforeAnAck) {
  EXPECT_EQ(verdict(kAnswer + "+"), Reply::Kind::ack);
  EXPECT_EQ(verdict(kAnswer + "-"), Reply::Kind::nak);
  EXPECT_EQ(verdict(kForceRequest + kAnswer + "+"), Reply::Kind::ack);
  EXPECT_EQ(verdict("?>" + kAnswer + "?+"), Reply::Kind::ack);
  EXPECT_TRUE(needs_more(kAnswer, kForce));
}

TEST(ProgrammingPort, AnAckInsideAFrameIsNoAnswer) {
  // A digit F in an echo, turned into 06 by one flipped bit.
  EXPECT_TRUE(needs_more("<70005>F+", kForce));
  EXPECT_TRUE(needs_more("<70+", kForce));
}

TEST(ProgrammingPort, AnAckIsConsumedAloneAndLeavesAStrayEtx) {
  const auto reply = answer("+>", kForce);
  ASSERT_TRUE(reply && *reply);
  EXPECT_EQ((*reply)->consumed, 1U);
}

TEST(ProgrammingPort, EndlessNoiseInPlaceOfAnAckIsABadFrame) {
  EXPECT_TRUE(needs_more(std::string(512, '?'), kForce));
  expect_says(bad_frame(std::string(513, '?'), kForce), "513 bytes");
  expect_says(bad_frame("<" + std::string(512, '0'), kForce), "513");
}

TEST(ProgrammingPort, ARequestThatCannotBeSentHasNoAnswer) {
  EXPECT_EQ(error_of(answer("+", Control{Control::Kind::reset})).code, ErrorCode::unsupported);
}

// ---- the PLC itself ----------------------------------------------------------------------------

TEST(ProgrammingPort, TheModelIsAskedForInClassicCommands) {
  for (const auto& codec : {port(Model::unknown_fx), port(Model::unknown_fx, Commands::extended)}) {
    const auto requests = codec.identify();
    ASSERT_EQ(requests.size(), 2U);
    EXPECT_EQ(*codec.encode(requests[0], 0), hex("02 30 30 45 30 32 30 32 03 36 43"));
    EXPECT_EQ(*codec.encode(requests[1], 0), ascii("<00ECA02>8E"));
  }
}

Bytes word(std::uint32_t value) {
  return {static_cast<std::uint8_t>(value), static_cast<std::uint8_t>(value >> 8)};
}

TEST(ProgrammingPort, TheModelIsToldByTheTypeInD8001AndD8101) {
  const auto codec = port(Model::unknown_fx);
  const auto model = [&](const std::vector<Bytes>& images) {
    return codec.model_from(images).value_or("?");
  };
  EXPECT_EQ(model({word(22210), {}}), "FX1S");
  EXPECT_EQ(model({word(26210), {}}), "FX1N");
  EXPECT_EQ(model({word(26210), word(0)}), "FX1N");
  EXPECT_EQ(model({word(24310), word(24310)}), "FX2N");
  EXPECT_EQ(model({word(24310), {}}), "FX2N");
  EXPECT_EQ(model({word(24310)}), "FX2N");
  EXPECT_EQ(model({word(26231), word(26231)}), "FX3G");
  EXPECT_EQ(model({word(24241), word(16241)}), "FX3U");
  EXPECT_EQ(model({word(28100), word(28100)}), "FX3S");
}

TEST(ProgrammingPort, AModelThatCannotBeToldApartStaysUnknown) {
  const auto codec = port(Model::unknown_fx);
  // GX Works2 takes D8101 = 0 for an FX3U. A clone with this value may use the map of an FX2N.
  EXPECT_EQ(codec.model_from({word(24241), word(0)}), std::nullopt);
  EXPECT_EQ(codec.model_from({word(20100), word(0)}), std::nullopt);
  EXPECT_EQ(codec.model_from({word(0), {}}), std::nullopt);
  EXPECT_EQ(codec.model_from({Bytes{}, Bytes{}}), std::nullopt);
  EXPECT_EQ(codec.model_from({}), std::nullopt);
}

TEST(ProgrammingPort, AFoundModelKeepsTheOtherSettings) {
  const auto found = port(Model::unknown_fx, Commands::extended, 254).with_model("FX3G");
  ASSERT_NE(found, nullptr);
  EXPECT_EQ(model_of(*found), "FX3G");
  EXPECT_EQ(found->addresses().read_ways(id(Space::d))[0].max_bits, 2032U);
  EXPECT_EQ(port().with_model("FX9"), nullptr);
  for (const std::string_view name : find_protocol("fx-programming-port")->models)
    EXPECT_EQ(model_of(*port().with_model(name)), name);
}

TEST(ProgrammingPort, RunIsReadFromTheByteOfM8000) {
  const auto frame = [](const ProgrammingPort& codec) {
    return *codec.encode(codec.run_state(), 0);
  };
  EXPECT_EQ(frame(port()), ascii("<001E001>6A"));
  EXPECT_EQ(frame(port(Model::unknown_fx, Commands::extended)), ascii("<001E001>6A"));
  EXPECT_EQ(frame(port(Model::fx1n, Commands::extended)), ascii("<E0001C001>DD"));
  EXPECT_EQ(frame(port(Model::fx3u, Commands::extended)), ascii("<E008C0001>E4"));
  EXPECT_EQ(port().probe(0), port().run_state());
  EXPECT_EQ(port().run_state_from(Bytes{0x09}), true);
  EXPECT_EQ(port().run_state_from(Bytes{0x0A}), false);
  EXPECT_EQ(port().run_state_from(Bytes{}), std::nullopt);
}

TEST(ProgrammingPort, StopForcesM8037OnAndRunForcesItOff) {
  const auto frame = [](const ProgrammingPort& codec, bool run) {
    return *codec.encode(codec.run_request(run), 0);
  };
  const auto fx2n = port(Model::fx2n, Commands::extended);
  const auto fx3u = port(Model::fx3u, Commands::extended);
  EXPECT_EQ(frame(fx2n, false), hex("02 45 37 32 35 30 45 03 35 42"));
  EXPECT_EQ(frame(fx3u, false), hex("02 45 37 32 35 36 30 03 34 43"));
  EXPECT_EQ(frame(fx3u, true), ascii("<E82560>4D"));
  EXPECT_EQ(frame(port(), false), ascii("<7250F>17"));
  EXPECT_EQ(frame(port(), true), ascii("<8250F>18"));
  EXPECT_FALSE(port().run_hint().empty());
}

TEST(ProgrammingPort, ARefusalIsCurableExceptForRunAndStop) {
  EXPECT_EQ(port().meaning_of(kForce, 0), RefusalMeaning::curable);
  EXPECT_EQ(port().meaning_of(Write{span("D0", 2), {1, 2}}, 0), RefusalMeaning::curable);
  EXPECT_EQ(port().meaning_of(port().run_request(true), 0), RefusalMeaning::final);
  EXPECT_EQ(port().meaning_of(port().run_request(false), 0), RefusalMeaning::final);
  EXPECT_EQ(port().meaning_of(kRead, 0), RefusalMeaning::curable);
}

TEST(ProgrammingPort, NamesAreThoseOfItsModel) {
  const auto codec = port(Model::fx1s);
  EXPECT_FALSE(codec.parse_address("D256", std::nullopt));
  EXPECT_TRUE(codec.parse_address("T5", DataType::boolean));
  EXPECT_TRUE(codec.needs_type("T5"));
  EXPECT_FALSE(codec.parse_range("Y0-Y17"));
  EXPECT_FALSE(codec.check_range({id(Space::d), 256 * 16, 16}));
  EXPECT_FALSE(codec.check_write({id(Space::d), 0, 8}));
  EXPECT_EQ(codec.name_of({id(Space::y), 13, 1}), "Y15");
  EXPECT_EQ(codec.default_order(), ByteOrder::cdab);
  EXPECT_EQ(codec.resync(), Request(Enquire{}));
  EXPECT_TRUE(codec.expects_reply(Enquire{}));
}

}  // namespace
}  // namespace fxagent::fx
