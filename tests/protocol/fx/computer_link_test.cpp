#include "protocol/fx/computer_link.h"

#include <gtest/gtest.h>

#include "protocol/plan/plan.h"
#include "tests/protocol/answers.h"

namespace fxagent::fx {
namespace {

using namespace test;
using Settings = ComputerLink::Settings;

ComputerLink station(Model model = Model::fx3u) { return ComputerLink({.model = model}); }

/// `points` bits or words starting at `address`.
Span span(std::string_view address, std::uint32_t points) {
  const auto parsed = fx::parse_address(Model::unknown_fx, address, std::nullopt);
  EXPECT_TRUE(parsed.has_value()) << address;
  return {parsed->span.space, parsed->span.first_bit, parsed->span.bits * points};
}

std::string text_of(const Bytes& frame) { return {frame.begin(), frame.end()}; }

/// Returns a frame as text without ENQ; for a refused request, the error text.
std::string sent(const ComputerLink& codec, const Request& request) {
  const auto frame = codec.encode(request, 0);
  return frame ? text_of(*frame).substr(1) : frame.error().text;
}

// ---- transcripts ------------------------------------------------------------------------------

ComputerLink codec_of(const test::Exchange& e) {
  Settings settings{.model = *model_named(e.model)};
  std::istringstream words(e.command_set);
  std::string word;
  std::getline(words, word, '.');
  settings.station = static_cast<std::uint8_t>(std::stoul(word));
  std::getline(words, word, '.');
  settings.wait_tens = static_cast<std::uint32_t>(std::stoul(word)) / 10;
  std::getline(words, word, '.');
  settings.format = word == "4" ? 4 : 1;
  std::getline(words, word, '.');
  settings.sum_check = word == "sum";
  return ComputerLink(settings);
}

std::optional<Request> request_of(const test::Exchange& e) {
  const std::string& what = e.operation;
  if (what == "read_bits") return Read{span(e.device, e.bytes), ComputerLink::kBitWay};
  if (what == "read_words" || what == "write") {
    Span place = span(e.device, e.bytes);
    const bool in_words = e.image.size() >= e.bytes * 2;
    if (place.bits == e.bytes && in_words) place.bits *= 16;  // words of a bit device
    if (what == "write") return Write{place, e.image};
    return Read{place, ComputerLink::kWordWay};
  }
  if (what == "scatter") return scatter_of(e, [](const auto& device) { return span(device, 1); });
  if (what == "run" || what == "nak") return Control{Control::Kind::run};
  if (what == "stop") return Control{Control::Kind::stop};
  if (what == "identify") return Control{Control::Kind::identify};
  if (what == "reset") return Control{Control::Kind::reset};
  return std::nullopt;
}

TEST(ComputerLink, SpeaksEveryFrameOfTheTranscripts) {
  const auto all = spoken_in("fx_computer_link.txt", request_of);
  for (const auto& [e, request] : all) expect_spoken(codec_of(e), request, e);
  EXPECT_EQ(all.size(), 41U);
}

TEST(ComputerLink, UnderstandsEveryAnswerOfTheTranscripts) {
  const auto all = answered_in("fx_computer_link.txt", request_of);
  for (const auto& [e, request] : all) {
    const auto codec = codec_of(e);
    const bool refused = e.operation == "nak";
    const Reply reply = expect_understood(codec, request, e, refused);
    EXPECT_EQ(reply.closing.size(), codec.line_length(request).closing_chars) << e.where();
    if (refused) {
      EXPECT_TRUE(reply.text.starts_with("nak " + e.device + ": ")) << reply.text;
    }
  }
  EXPECT_EQ(all.size(), 39U);
}

TEST(ComputerLink, TheSumOfTheManualsExampleIsBd) {
  for (const test::Exchange& e : test::read_frames("fx_computer_link.txt")) {
    if (e.operation != "sum_only") continue;
    EXPECT_EQ(byte_sum(ByteView(e.request).subspan(1, e.request.size() - 3)), 0xBD);
    return;
  }
  FAIL() << "the example is not in the transcripts";
}

// ---- the manual's limits ------------------------------------------------------------------------

TEST(ComputerLink, ReadsAreAsLongAsTheModelAllows) {
  const auto longest = [](Model model, Space space, std::uint8_t id) {
    std::uint32_t bits = 0;
    for (const ReadWay& way : station(model).read_ways(fx::id(space)))
      if (way.way == id) bits = std::max(bits, way.max_bits);
    return bits;
  };
  for (const Model model : {Model::fx1n, Model::fx2n, Model::fx3s, Model::fx3g, Model::fx3u}) {
    EXPECT_EQ(longest(model, Space::m, 0), 256U);
    EXPECT_EQ(longest(model, Space::m, 1), 512U);
    EXPECT_EQ(longest(model, Space::d, 1), 64U * 16);
    EXPECT_EQ(longest(model, Space::cn32, 1), 32U * 32);
  }
  for (const Model model : {Model::fx0n, Model::fx1s}) {
    EXPECT_EQ(longest(model, Space::m, 0), 54U);
    EXPECT_EQ(longest(model, Space::m, 1), 13U * 16);
    EXPECT_EQ(longest(model, Space::d, 1), 13U * 16);
    EXPECT_EQ(longest(model, Space::cn32, 1), 6U * 32);
  }
  EXPECT_EQ(longest(Model::fx3u, Space::ts, 0), 256U);
}

TEST(ComputerLink, ContactsAreReadBitByBitAndWordsAsWords) {
  for (const Space space : {Space::ts, Space::cs}) {
    const auto ways = station().read_ways(id(space));
    ASSERT_EQ(ways.size(), 1U);
    EXPECT_EQ(ways[0].way, ComputerLink::kBitWay);
  }
  for (const Space space : {Space::tn, Space::cn, Space::d, Space::special_d}) {
    const auto ways = station().read_ways(id(space));
    ASSERT_EQ(ways.size(), 1U);
    EXPECT_EQ(ways[0].way, ComputerLink::kWordWay);
  }
  EXPECT_EQ(station(Model::fx1s).read_ways(id(Space::cs)).size(), 2U);
  EXPECT_TRUE(station().read_ways(id(Space::tc)).empty());
  EXPECT_TRUE(station().read_ways(99).empty());
}

TEST(ComputerLink, NoWordOfBitsRunsPastTheLastDevice) {
  const auto codec = station(Model::fx2n);  // X0 to X267: 184 points, eleven and a half words
  const auto read = [&](std::uint32_t first, std::uint32_t bits) {
    return codec.encode(Read{{id(Space::x), first, bits}, ComputerLink::kWordWay}, 0).has_value();
  };
  EXPECT_TRUE(read(168, 16));
  EXPECT_TRUE(read(0, 176));
  EXPECT_FALSE(read(176, 16));
  EXPECT_FALSE(read(0, 192));
  EXPECT_FALSE(read(4, 16));
  // Y0 to Y15 of an FX1S do not fill whole words.
  EXPECT_EQ(station(Model::fx1s).read_ways(id(Space::y)).size(), 1U);
}

TEST(ComputerLink, AnUnknownModelIsAskedForNothingThatSomeModelLacks) {
  const auto ways = station(Model::unknown_fx).read_ways(id(Space::m));
  ASSERT_EQ(ways.size(), 1U);
  EXPECT_EQ(ways[0].way, ComputerLink::kBitWay);
  EXPECT_EQ(ways[0].max_bits, 54U);
  EXPECT_EQ(station(Model::unknown_fx).read_ways(id(Space::d))[0].max_bits, 13U * 16);
  EXPECT_EQ(
      station(Model::unknown_fx).with_model("FX3U")->addresses().read_ways(id(Space::m)).size(),
      2U);
}

TEST(ComputerLink, ABlockLimitLowersReadsAndWrites) {
  const ComputerLink codec({.model = Model::fx3u, .max_block_bytes = 5});
  EXPECT_EQ(codec.read_ways(id(Space::d))[0].max_bits, 32U);
  EXPECT_EQ(codec.read_ways(id(Space::m))[0].max_bits, 40U);
  EXPECT_EQ(codec.read_ways(id(Space::m))[1].max_bits, 32U);
  EXPECT_EQ(codec.max_write_bits(id(Space::d)), 32U);
  const ComputerLink least({.model = Model::fx3u, .max_block_bytes = 2});
  EXPECT_EQ(least.read_ways(id(Space::cn32))[0].max_bits, 32U);
}

TEST(ComputerLink, WritesAreAsLongAsTheModelAllows) {
  const auto words = [](Model model, std::string_view first, std::uint32_t count) {
    const Span place = span(first, count);
    return station(model).encode(Write{place, Bytes(place.bits / 8)}, 0).has_value();
  };
  EXPECT_TRUE(words(Model::fx3u, "D0", 64));
  EXPECT_FALSE(words(Model::fx3u, "D0", 65));
  EXPECT_TRUE(words(Model::fx1s, "D0", 11));
  EXPECT_FALSE(words(Model::fx1s, "D0", 12));
  EXPECT_TRUE(words(Model::fx3u, "CN200", 32));
  EXPECT_FALSE(words(Model::fx3u, "CN200", 33));
  EXPECT_TRUE(words(Model::fx1s, "CN235", 6));
  EXPECT_FALSE(words(Model::fx1s, "CN235", 7));
  EXPECT_TRUE(words(Model::fx3u, "M0", 160));
  EXPECT_FALSE(words(Model::fx3u, "M0", 176));
  EXPECT_TRUE(words(Model::fx3u, "TS0", 160));
  EXPECT_FALSE(words(Model::fx3u, "TS0", 168));
  EXPECT_TRUE(words(Model::fx1s, "M0", 40));
  EXPECT_FALSE(words(Model::fx1s, "M0", 56));
}

TEST(ComputerLink, WhateverTheLongestWriteLeavesOverCanBeWritten) {
  for (const Model model : {Model::fx1s, Model::fx3u, Model::unknown_fx})
    for (const Space space : {Space::m, Space::ts, Space::d, Space::cn}) {
      const auto codec = station(model);
      const std::uint32_t unit = kind_of(space).bits == 1 ? 8 : 16;
      for (std::uint32_t bits = unit; bits <= codec.max_write_bits(id(space)); bits += unit)
        EXPECT_TRUE(codec.encode(Write{{id(space), 0, bits}, Bytes(bits / 8)}, 0)) << bits;
    }
  EXPECT_EQ(station().max_write_bits(id(Space::m)), 160U);
  EXPECT_EQ(station(Model::fx1s).max_write_bits(id(Space::m)), 40U);
  EXPECT_EQ(station().max_write_bits(id(Space::cn32)), 1024U);
  EXPECT_EQ(station().max_write_bits(99), 0U);
}

TEST(ComputerLink, HalfBytesAndWhatStopsThePlcAreNotWritten) {
  // A frame could do it, but K1M0 is never written.
  EXPECT_FALSE(station().check_write(span("M0", 4)));
  EXPECT_FALSE(station().check_write(span("M4", 8)));
  EXPECT_TRUE(station().check_write(span("M8", 8)));
  expect_says(sent(station(), Write{span("M8030", 8), Bytes(1)}), "cannot be written by address");
  expect_says(sent(station(), Write{span("M7676", 5), Bytes(1)}), "M7680 does not exist");
  expect_says(sent(station(), Write{{id(Space::m), 0, 0}, {}}), "nothing");
  expect_says(sent(station(), Write{span("D0", 1), Bytes(1)}), "with 1 bytes");
  expect_says(sent(station(), Force{id(Space::special_m), 37, true}),
              "cannot be written by address");
  expect_says(sent(station(), Force{id(Space::d), 5, true}), "only whole words");
  expect_says(sent(station(), Force{id(Space::tc), 5, true}), "not in the memory");
  expect_says(sent(station(), Force{id(Space::m), 7680, true}), "does not exist");
  EXPECT_EQ(station().encode(Enquire{}, 0).error().code, ErrorCode::unsupported);
}

// ---- requests ----------------------------------------------------------------------------------

TEST(ComputerLink, AForceIsAWriteOfOnePoint) {
  EXPECT_EQ(sent(station(), Force{id(Space::y), 15, true}), "00FFBW0Y001701168");
  EXPECT_EQ(sent(station(), Force{id(Space::special_m), 511, false}), "00FFBW0M851101062");
}

TEST(ComputerLink, WholeWordsOfBitsGoByWwAndOthersByBw) {
  EXPECT_EQ(sent(station(), Write{span("M8", 16), {0x34, 0x12}}).substr(0, 18),
            "00FFWW0M0008011234");
  EXPECT_EQ(sent(station(), Write{span("Y20", 8), {0x81}}).substr(0, 22), "00FFBW0Y00200810000001");
  EXPECT_EQ(sent(station(), Write{span("TS0", 16), {0x01, 0x80}}).substr(0, 30),
            "00FFBW0TS000101000000000000001");
}

TEST(ComputerLink, A32BitCounterIsWrittenHighWordFirst) {
  EXPECT_EQ(sent(station(), Write{span("CN200", 1), {0x78, 0x56, 0x34, 0x12}}).substr(0, 22),
            "00FFWW0CN2000112345678");
}

TEST(ComputerLink, BitsTogetherAreBtAndWordsTogetherAreWt) {
  const auto codec = station(Model::fx2n);
  const auto two = codec.combine({Force{id(Space::m), 50, true}, Force{id(Space::y), 1, false}});
  ASSERT_TRUE(two);
  EXPECT_EQ(sent(codec, *two).substr(0, 21), "00FFBT002M00501Y00010");
  const auto words =
      codec.combine({Write{span("D500", 2), {0x34, 0x12, 0x78, 0x56}},
                     Write{span("Y100", 16), {0xA9, 0xBC}}, Write{span("CN100", 1), {0x64, 0x00}}});
  ASSERT_TRUE(words);
  EXPECT_EQ(sent(codec, *words).substr(0, 45), "00FFWT004D05001234D05015678Y0100BCA9CN1000064");
  const auto both = codec.combine({Write{span("M16", 8), {0x80}}, Force{id(Space::ts), 3, true}});
  ASSERT_TRUE(both);
  EXPECT_EQ(sent(codec, *both).substr(0, 15), "00FFBT009M00160");
}

// JY997D16901 7.3, 7.6, 7.9: the Q commands use names of seven characters; the last one's sum is
// from its list of fields.
TEST(ComputerLink, ExtensionRegistersGoByTheQCommands) {
  const auto codec = station();
  EXPECT_EQ(sent(codec, Read{span("R5", 2), ComputerLink::kWordWay}).substr(0, 16),
            "00FFQR0R00000502");
  EXPECT_EQ(sent(codec, Write{span("R32767", 1), {0x34, 0x12}}).substr(0, 20),
            "00FFQW0R032767011234");
  const ComputerLink five({.model = Model::fx3u, .station = 5});
  const auto both =
      five.combine({Write{span("R12000", 1), {0x34, 0x12}}, Write{span("Y100", 16), {0xA9, 0xBC}}});
  ASSERT_TRUE(both);
  EXPECT_EQ(sent(five, *both), "05FFQT002R0120001234Y000100BCA9E0");
  const Request read = Read{span("R5", 2), ComputerLink::kWordWay};
  EXPECT_EQ(codec.line_length(read).request_chars, codec.encode(read, 0)->size());
  EXPECT_EQ(codec.read_ways(id(Space::r))[0].max_bits, 64U * 16);
  for (const Model model : {Model::unknown_fx, Model::fx2n, Model::fx3s})
    EXPECT_TRUE(station(model).read_ways(id(Space::r)).empty());
}

TEST(ComputerLink, WhatOneFrameCannotCarryIsNotCombined) {
  const auto forces = [](std::uint32_t count) { return forces_of(id(Space::m), count); };
  const auto words = [](std::uint32_t count) { return writes_of(id(Space::d), count); };
  EXPECT_TRUE(station().combine(forces(20)));
  EXPECT_FALSE(station().combine(forces(21)));
  EXPECT_TRUE(station(Model::fx1s).combine(forces(10)));
  EXPECT_FALSE(station(Model::fx1s).combine(forces(11)));
  EXPECT_TRUE(station().combine(words(10)));
  EXPECT_FALSE(station().combine(words(11)));
  EXPECT_TRUE(station(Model::fx1s).combine(words(6)));
  EXPECT_FALSE(station(Model::fx1s).combine(words(7)));
  EXPECT_FALSE(station().combine({forces(1)[0], words(1)[0]}));
  EXPECT_FALSE(station().combine({words(1)[0], Write{span("CN200", 1), Bytes(4)}}));
  EXPECT_FALSE(station().combine({words(1)[0], Control{Control::Kind::run}}));
  EXPECT_FALSE(station().combine({forces(1)[0], Force{id(Space::special_m), 37, true}}));
  EXPECT_FALSE(station().combine(forces(1)));
  EXPECT_FALSE(station().combine({}));
}

TEST(ComputerLink, APlanMixesBitsAndWordsWhereThatIsLeastLineTime) {
  const auto codec = station();
  std::vector<Point> points;
  const auto add = [&](std::string_view text) {
    Point point{.address = *codec.parse_address(text, std::nullopt)};
    point.type = default_type(point.address);
    points.push_back(point);
  };
  add("M3");
  for (int i = 1000; i < 1200; i += 10) add("M" + std::to_string(i));
  const LineCost cost{std::chrono::microseconds(1042), std::chrono::milliseconds(30)};
  const Plan plan = make_plan(codec, points, cost, 0);
  ASSERT_EQ(plan.reads.size(), 2U);
  EXPECT_EQ(plan.reads[0].read.way, ComputerLink::kBitWay);
  EXPECT_EQ(plan.reads[0].read.span.bits, 1U);
  EXPECT_EQ(plan.reads[1].read.way, ComputerLink::kWordWay);
  EXPECT_EQ(plan.reads[1].read.span.bits, 192U);
}

// ---- answers -----------------------------------------------------------------------------------

const Read kWords{{id(Space::d), 0, 32}, ComputerLink::kWordWay};  // D0, D1
const Read kBits{{id(Space::m), 0, 5}, ComputerLink::kBitWay};     // M0 to M4
const Force kForce{id(Space::y), 0, true};

/// STX, text, ETX and the correct sum.
std::string data(std::string_view text) {
  const std::string summed = std::string(text) + ">";
  Bytes sum;
  append_hex(sum, byte_sum(ascii(summed)), 2);
  return "<" + summed + text_of(sum);
}

const std::string kAnswer = data("00FF1234ABCD");
const std::string kAckFrame = "+00FF";
const std::string kNakFrame = "-00FF06";

bool needs_more(const std::string& rx, const Request& request = kWords,
                const ComputerLink& codec = station()) {
  return test::needs_more(codec, request, ascii(rx));
}

Reply good(const std::string& rx, const Request& request = kWords,
           const ComputerLink& codec = station()) {
  return answer(codec, request, ascii(rx));
}

std::string bad_frame(const std::string& rx, const Request& request = kWords,
                      const ComputerLink& codec = station()) {
  return fault(codec, request, ascii(rx));
}

const Bytes kImage{0x34, 0x12, 0xCD, 0xAB};

TEST(ComputerLink, DataAreAcknowledgedWhereTheManualAsksForIt) {
  EXPECT_EQ(good(kAnswer).image, kImage);
  EXPECT_EQ(good(kAnswer).closing, ascii(kAckFrame));
  Settings settings{.acknowledge_data = false};
  const ComputerLink silent(settings);
  EXPECT_TRUE(good(kAnswer, kWords, silent).closing.empty());
  EXPECT_EQ(silent.line_length(kWords).closing_chars, 0U);
  settings.acknowledge_data = true;
  settings.format = 4;
  EXPECT_EQ(good(kAnswer + "\r\n", kWords, ComputerLink(settings)).closing,
            ascii(kAckFrame + "\r\n"));
}

TEST(ComputerLink, EveryBeginningOfAnAnswerNeedsMore) {
  for (std::size_t n = 0; n < kAnswer.size(); ++n)
    EXPECT_TRUE(needs_more(kAnswer.substr(0, n))) << n;
  for (std::size_t n = 0; n < kNakFrame.size(); ++n)
    EXPECT_TRUE(needs_more(kNakFrame.substr(0, n), kForce)) << n;
}

TEST(ComputerLink, NoiseAndAcksBeforeDataAreSkipped) {
  EXPECT_EQ(good("\x7F?>" + kAnswer).image, kImage);
  EXPECT_EQ(good(kAckFrame + kAnswer).image, kImage);
  EXPECT_TRUE(needs_more(kAckFrame));
}

TEST(ComputerLink, AnswersOfOtherStationsAreSkipped) {
  EXPECT_EQ(good(data("01FF5555AAAA") + kAnswer).image, kImage);
  EXPECT_TRUE(needs_more(data("01FF5555AAAA")));
  EXPECT_EQ(good("+01FF" + kAckFrame, kForce).consumed, 10U);
  EXPECT_TRUE(needs_more("-01FF06", kForce));
  EXPECT_TRUE(needs_more("+00FE", kForce));
}

TEST(ComputerLink, AFrameOnDemandIsNoAnswer) {
  EXPECT_EQ(good(data("00FE12345678") + kAnswer).image, kImage);
  EXPECT_TRUE(needs_more(data("00FE1234ABCD")));
}

TEST(ComputerLink, LateDataBeforeTheAckOfAWriteAreSkipped) {
  EXPECT_EQ(good(kAnswer + kAckFrame, kForce).kind, Reply::Kind::ack);
  EXPECT_EQ(good(kAnswer + kNakFrame, kForce).kind, Reply::Kind::nak);
  EXPECT_TRUE(needs_more(kAnswer, kForce));
  // An ACK inside late data is a digit with one bit flipped.
  EXPECT_TRUE(needs_more("<00FF12+00FF", kForce));
}

TEST(ComputerLink, WhatCameBeforeTheEchoOfTheRequestIsOlder) {
  const std::string echo = "%" + sent(station(), kForce);
  EXPECT_TRUE(needs_more(kAckFrame + echo, kForce));
  EXPECT_TRUE(needs_more(kAckFrame + "%", kForce));
  EXPECT_EQ(good(kAckFrame + echo + kNakFrame, kForce).kind, Reply::Kind::nak);
}

TEST(ComputerLink, ARefusalTellsItsReason) {
  const Reply reply = good(kNakFrame);
  EXPECT_EQ(reply.kind, Reply::Kind::nak);
  EXPECT_EQ(reply.device_code, 6);
  EXPECT_EQ(reply.text, "nak 06: the device does not exist, or too many points");
  EXPECT_TRUE(reply.closing.empty());
  EXPECT_EQ(good("-00ff0a", kForce).device_code, 0x0A);
  EXPECT_EQ(bad_frame("-00FF0G"), "NAK with the reason 30 47");
  EXPECT_FALSE(link_refusal(0x55).empty());
}

TEST(ComputerLink, AFrameCutOffByAnotherStxBeginsAgain) {
  EXPECT_EQ(good("<00FF12" + kAnswer).image, kImage);
  EXPECT_EQ(good("<" + kAnswer).image, kImage);
  EXPECT_EQ(good("<01F" + kAnswer + kAckFrame, kForce).kind, Reply::Kind::ack);
}

TEST(ComputerLink, AWrongSumIsABadFrameThatNamesBothSums) {
  std::string wrong = kAnswer;
  wrong.back() = '0';
  const std::string right = kAnswer.substr(kAnswer.size() - 2);
  EXPECT_EQ(bad_frame(wrong), "sum " + right.substr(0, 1) + "0 given, " + right + " computed");
  wrong.back() = 'G';
  expect_says(bad_frame(wrong), "is not two hex digits");
}

TEST(ComputerLink, AnAnswerOfAnotherLengthIsABadFrame) {
  EXPECT_EQ(bad_frame(data("00FF1234")), "4 data characters given, 8 expected");
  EXPECT_EQ(bad_frame(data("00FF")), "0 data characters given, 8 expected");
  EXPECT_EQ(bad_frame("<00FF1234ABCD1"), "more data characters given, 8 expected");
}

TEST(ComputerLink, DataThatAreNotDigitsAreABadFrame) {
  EXPECT_EQ(bad_frame(data("00FF1234ABCG")), "data 43 47 is not two hex digits");
  EXPECT_EQ(bad_frame(data("00FF01201"), kBits), "data 32 is neither 0 nor 1");
}

TEST(ComputerLink, LowerCaseDigitsAreUnderstood) {
  EXPECT_EQ(good(data("00ff1234abcd")).image, kImage);
}

TEST(ComputerLink, BitsComeLowestFirst) {
  const Reply reply = good(data("00FF01101"), kBits);
  EXPECT_EQ(reply.image, Bytes{0x16});
  EXPECT_EQ(reply.consumed, 13U);
}

TEST(ComputerLink, Format4IsCompleteWithCrLfAndNotBefore) {
  const ComputerLink codec({.format = 4});
  EXPECT_TRUE(needs_more(kAnswer, kWords, codec));
  EXPECT_TRUE(needs_more(kAnswer + "\r", kWords, codec));
  EXPECT_EQ(good(kAnswer + "\r\n", kWords, codec).consumed, kAnswer.size() + 2);
  expect_says(bad_frame(kAnswer + "00", kWords, codec), "CR LF");
  EXPECT_TRUE(needs_more(kAckFrame + "\r", kForce, codec));
  EXPECT_EQ(good(kAckFrame + "\r\n", kForce, codec).consumed, 7U);
  EXPECT_EQ(good(kNakFrame + "\r\n", kForce, codec).consumed, 9U);
  expect_says(bad_frame(kAckFrame + "??", kForce, codec), "CR LF");
  EXPECT_EQ(codec.line_length(kForce).reply_chars, 7U);
}

TEST(ComputerLink, EndlessNoiseIsABadFrame) {
  EXPECT_TRUE(needs_more(std::string(532, '?')));
  expect_says(bad_frame(std::string(533, '?')), "533 bytes");
  expect_says(bad_frame("<" + std::string(799, '0'), kForce), "800 bytes");
}

TEST(ComputerLink, AnswerBehindMuchNoiseIsAwaited) {
  EXPECT_TRUE(needs_more(std::string(532, '?') + kAckFrame.substr(0, 4), kForce));
  EXPECT_EQ(good(std::string(532, '?') + kAckFrame, kForce).kind, Reply::Kind::ack);
}

TEST(ComputerLink, NothingAnswersAnEot) {
  const Request reset = *station().resync();
  EXPECT_EQ(reset, Request(Control{Control::Kind::reset}));
  EXPECT_FALSE(station().expects_reply(reset));
  EXPECT_TRUE(station().expects_reply(kForce));
  EXPECT_EQ(station().line_length(reset).request_chars, 1U);
  EXPECT_EQ(station().line_length(reset).reply_chars, 0U);
  EXPECT_EQ(station().decode(reset, 0, ascii(kAckFrame)).error().code, ErrorCode::unsupported);
}

// ---- the PLC itself ----------------------------------------------------------------------------

TEST(ComputerLink, TheModelIsToldByItsCode) {
  const auto codec = station(Model::unknown_fx);
  const auto questions = codec.identify();
  ASSERT_EQ(questions.size(), 1U);
  EXPECT_EQ(good(data("00FFF3"), questions[0]).image, Bytes{0xF3});
  const auto model = [&](std::uint8_t code) { return codec.model_from({{code}}).value_or("?"); };
  EXPECT_EQ(model(0x8E), "FX0N");
  EXPECT_EQ(model(0xF2), "FX1S");
  EXPECT_EQ(model(0x9E), "FX1N");
  EXPECT_EQ(model(0x9D), "FX2N");
  EXPECT_EQ(model(0xF4), "FX3G");
  EXPECT_EQ(model(0xF3), "FX3U");
  EXPECT_EQ(model(0x8D), "?");
  EXPECT_EQ(codec.model_from({}), std::nullopt);
  EXPECT_EQ(codec.model_from({Bytes{}}), std::nullopt);
}

TEST(ComputerLink, AFoundModelKeepsTheOtherSettings) {
  const auto found = ComputerLink({.station = 7, .wait_tens = 15}).with_model("FX1N");
  ASSERT_NE(found, nullptr);
  EXPECT_EQ(model_of(*found), "FX1N");
  EXPECT_EQ(text_of(*found->encode(*found->resync(), 0)), "\x04");
  EXPECT_EQ(text_of(*found->encode(found->plc()->run_request(true), 0)).substr(1, 7), "07FFRRF");
  EXPECT_EQ(found->plc()->with_model("FX9"), nullptr);
}

TEST(ComputerLink, RunIsM8000AndIsOrderedByRrAndRs) {
  EXPECT_EQ(sent(station(), station().run_state()).substr(0, 14), "00FFBR0M800001");
  EXPECT_EQ(station().probe(0), station().run_state());
  EXPECT_EQ(station().run_state_from(Bytes{1}), true);
  EXPECT_EQ(station().run_state_from(Bytes{0}), false);
  EXPECT_EQ(station().run_state_from({}), std::nullopt);
  EXPECT_EQ(sent(station(), station().run_request(true)), "00FFRR0C0");
  EXPECT_EQ(sent(station(), station().run_request(false)), "00FFRS0C1");
  expect_says(station().run_hint(), "STOP");
}

TEST(ComputerLink, OnlyAWrongSumIsCuredByARepeatAndNeverForRunAndStop) {
  for (const Request& request : {Request(kWords), Request(kForce), Request(Scatter{}),
                                 Request(Control{Control::Kind::identify})}) {
    EXPECT_EQ(station().meaning_of(request, 0x02), RefusalMeaning::curable);
    const bool reads = std::holds_alternative<Read>(request);
    EXPECT_EQ(station().meaning_of(request, 0x06),
              reads ? RefusalMeaning::hole : RefusalMeaning::final);
    EXPECT_EQ(station().meaning_of(request, 0x18), RefusalMeaning::final);
  }
  for (const bool run : {true, false})
    EXPECT_EQ(station().meaning_of(station().run_request(run), 0x02), RefusalMeaning::final);
}

TEST(ComputerLink, IsMadeFromItsOptions) {
  const auto made = ComputerLink::make({{"model", std::string("FX2N")},
                                        {"station", std::int64_t{15}},
                                        {"format", std::int64_t{4}},
                                        {"sum_check", false},
                                        {"message_wait_ms", std::int64_t{100}},
                                        {"acknowledge_data", false}});
  ASSERT_TRUE(made);
  EXPECT_EQ(*(*made)->encode(Control{}, 0), ascii("%0FFFPCA!"));
  EXPECT_EQ((*made)->line_length(Control{}).closing_chars, 0U);
  EXPECT_TRUE(ComputerLink::make({}));
  EXPECT_FALSE(ComputerLink::make({{"model", std::string("FX9")}}));
  EXPECT_FALSE(ComputerLink::make({{"format", std::int64_t{3}}}));
  EXPECT_FALSE(ComputerLink::make({{"message_wait_ms", std::int64_t{15}}}));
}

TEST(ComputerLink, NamesAreThoseOfItsModel) {
  const auto codec = station(Model::fx1s);
  EXPECT_FALSE(codec.parse_address("D256", std::nullopt));
  EXPECT_TRUE(codec.parse_address("T5", DataType::boolean));
  EXPECT_TRUE(codec.needs_type("T5"));
  EXPECT_FALSE(codec.parse_range("Y0-Y17"));
  EXPECT_FALSE(codec.check_range({id(Space::d), 256 * 16, 16}));
  EXPECT_EQ(codec.name_of({id(Space::y), 13, 1}), "Y15");
  EXPECT_EQ(codec.default_order(), ByteOrder::cdab);
}

}  // namespace
}  // namespace fxagent::fx
