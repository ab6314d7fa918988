#include "protocol/mc/one_e.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "protocol/plan/plan.h"
#include "tests/protocol/answers.h"

namespace fxagent::mc {
namespace {

using namespace test;
using Settings = OneE::Settings;

OneE plc(Model model = Model::fx3u, Code code = Code::binary) {
  return OneE({.model = model, .code = code, .timer = 10});
}

const OneE kBinary = plc();
const OneE kAscii = plc(Model::fx3u, Code::ascii);

/// `points` devices starting at `address`.
Span span(std::string_view address, std::uint32_t points, Model model = Model::fx3u) {
  const auto parsed = parse_address(model, address, std::nullopt);
  EXPECT_TRUE(parsed.has_value()) << address;
  return {parsed->span.space, parsed->span.first_bit, parsed->span.bits * points};
}

/// Returns a frame in hex; for a refused request, the error text.
std::string sent(const OneE& codec, const Request& request) {
  const auto frame = codec.encode(request, 0);
  return frame ? to_hex(*frame) : frame.error().text;
}

// ---- transcripts ------------------------------------------------------------------------------

OneE codec_of(const test::Exchange& e) {
  Settings settings{.model = *model_named(e.model)};
  std::istringstream words(e.command_set);
  std::string word;
  std::getline(words, word, '.');
  settings.code = word == "ascii" ? Code::ascii : Code::binary;
  std::getline(words, word, '.');
  settings.timer = static_cast<std::uint32_t>(std::stoul(word)) / 250;
  std::getline(words, word, '.');
  settings.route.pc = static_cast<std::uint8_t>(std::stoul(word));
  return OneE(settings);
}

/// Returns nullopt for a request that this product never sends.
std::optional<Request> request_of(const test::Exchange& e) {
  const std::string& what = e.operation;
  if (what == "scatter") return scatter_of(e, [](const auto& device) { return span(device, 1); });
  if (what == "run") return Control{Control::Kind::run};
  if (what == "stop") return Control{Control::Kind::stop};
  if (what == "identify") return Control{Control::Kind::identify};
  if (what == "beyond") return std::nullopt;
  Span place = span(e.device, 1, *model_named(e.model));
  const bool in_words = what != "read_bits" && (what != "write" || e.image.size() >= 2 * e.bytes);
  place.bits = in_words ? e.bytes * 16 : e.bytes;
  if (what == "write") return Write{place, e.image};
  return Read{place, in_words ? kWordWay : kBitWay};
}

TEST(OneE, SpeaksEveryFrameOfTheTranscripts) {
  const auto all = spoken_in("mc_1e.txt", request_of);
  for (const auto& [e, request] : all) expect_spoken(codec_of(e), request, e);
  EXPECT_EQ(all.size(), 24U);
}

TEST(OneE, UnderstandsEveryAnswerOfTheTranscripts) {
  const auto all = answered_in("mc_1e.txt", request_of);
  for (const auto& [e, request] : all)
    expect_understood(codec_of(e), request, e, e.operation == "nak");
  EXPECT_EQ(all.size(), 22U);
}

// ---- names and limits ---------------------------------------------------------------------------

TEST(OneE, OctalIsThatOfAnFx3AndHexadecimalThatOfAnE71) {
  EXPECT_EQ(sent(plc(), Read{span("X17", 1), kBitWay}), "00 FF 0A 00 0F 00 00 00 20 58 01 00");
  EXPECT_EQ(sent(plc(Model::q), Read{span("X1F", 1, Model::q), kBitWay}),
            "00 FF 0A 00 1F 00 00 00 20 58 01 00");
  EXPECT_FALSE(plc().parse_address("X8", std::nullopt));
  EXPECT_EQ(sent(plc(Model::l), Read{span("W1A", 2, Model::l), kWordWay}),
            "01 FF 0A 00 1A 00 00 00 20 57 02 00");
  EXPECT_EQ(sent(plc(Model::q), Force{id(Space::b), 0xFF, true}),
            "02 FF 0A 00 FF 00 00 00 20 42 01 00 10");
  EXPECT_EQ(sent(plc(Model::q), Force{id(Space::f), 5, false}),
            "02 FF 0A 00 05 00 00 00 20 46 01 00 00");
}

TEST(OneE, SpecialDevicesAndLongCountersOfAnFx3HaveTheNumbersThatTheyAreCalledBy) {
  EXPECT_EQ(sent(plc(), Read{span("M8000", 1), kBitWay}), "00 FF 0A 00 40 1F 00 00 20 4D 01 00");
  EXPECT_EQ(sent(plc(), Read{span("D8511", 1), kWordWay}), "01 FF 0A 00 3F 21 00 00 20 44 01 00");
  EXPECT_EQ(sent(plc(), Read{span("CN200", 1), kWordWay}), "01 FF 0A 00 C8 00 00 00 4E 43 02 00");
  // On a Q, M8000 is an ordinary M, and CN200 has 16 bits.
  EXPECT_EQ(sent(plc(Model::q), Read{span("M8000", 1, Model::q), kBitWay}),
            "00 FF 0A 00 40 1F 00 00 20 4D 01 00");
  EXPECT_EQ(plc(Model::q).parse_address("CN200", std::nullopt)->unit, Unit::word);
}

// Q03UD(E) 5.1.2: 1E accesses SM1000 up and SD1000 up of a Q as M9000 up and D9000 up.
TEST(OneE, AnE71ReachesWhatAnASeriesPlcHasAndNothingThatIsSomethingElse) {
  struct Row {
    const char* last;
    const char* beyond;
  };
  for (const std::string_view model : {"Q", "L"}) {
    const auto made = OneE::make({{"model", std::string(model)}}).value();
    const auto& places = made->addresses();
    EXPECT_EQ(made->plc()->model(), model);
    for (const Row& row : {Row{"X7FF", "X800"}, Row{"Y7FF", "Y800"}, Row{"M8191", "M8192"},
                           Row{"F2047", "F2048"}, Row{"BFFF", "B1000"}, Row{"D6143", "D6144"},
                           Row{"WFFF", "W1000"}, Row{"TN2047", "TN2048"}, Row{"TS2047", "TS2048"},
                           Row{"CN1023", "CN1024"}, Row{"R8191", "R8192"}, Row{"D6143", "D9000"},
                           Row{"M8191", "M9000"}, Row{"M8191", "M9255"}}) {
      EXPECT_TRUE(places.parse_address(row.last, std::nullopt)) << row.last;
      EXPECT_FALSE(places.parse_address(row.beyond, std::nullopt)) << row.beyond;
      EXPECT_FALSE(places.parse_range(row.beyond)) << row.beyond;
    }
    EXPECT_EQ(places.read_ways(id(Space::d)).front().end_bit, 6144U * 16);
    EXPECT_FALSE(places.check_write({id(Space::d), 9000 * 16, 16}));
    EXPECT_EQ(places.parse_address("D9000", std::nullopt).error().text,
              "D9000 does not exist: " + std::string(model) + " by 1E frames has D0-D6143");
    const auto told = plc().with_model(model);
    ASSERT_NE(told, nullptr);
    EXPECT_FALSE(told->addresses().parse_address("D9000", std::nullopt));
  }
}

TEST(OneE, WhatA1EFrameHasNoCodeForIsSaid) {
  const auto why = [](Model model, std::string_view address) {
    const auto parsed = plc(model).parse_address(address, std::nullopt);
    return parsed ? "" : parsed.error().text;
  };
  EXPECT_EQ(why(Model::q, "L0"), "L0: 1E frames do not reach L of this model");
  EXPECT_EQ(why(Model::q, "SM400"), "SM400: 1E frames do not reach SM of this model");
  EXPECT_EQ(why(Model::q, "ZR0"), "ZR0: 1E frames do not reach ZR of this model");
  EXPECT_EQ(why(Model::q, "S0"), "S0: 1E frames do not reach S of this model");
  EXPECT_EQ(why(Model::fx3u, "TC0"), "TC0: 1E frames do not reach TC of an FX3");
  EXPECT_EQ(why(Model::fx3g, "CC0"), "CC0: 1E frames do not reach CC of an FX3");
  EXPECT_EQ(why(Model::q, "TC0"), "");
  EXPECT_NE(why(Model::fx3u, "W0"), "");
  EXPECT_EQ(plc(Model::q).parse_range("L0-L5").error().text,
            "L0: 1E frames do not reach L of this model");
  EXPECT_TRUE(plc(Model::q).read_ways(id(Space::l)).empty());
  EXPECT_EQ(plc(Model::q).max_write_bits(id(Space::l)), 0U);
  EXPECT_FALSE(plc(Model::q).check_write(span("L0", 1, Model::q)));
  EXPECT_TRUE(plc().read_ways(99).empty());
  EXPECT_EQ(plc().max_write_bits(99), 0U);
}

TEST(OneE, ReadsAreAsLongAsTheManualAllows) {
  const auto most = [](Space space, std::uint8_t id) {
    std::uint32_t bits = 0;
    for (const ReadWay& way : plc().read_ways(mc::id(space)))
      if (way.way == id) bits = std::max(bits, way.max_bits);
    return bits;
  };
  EXPECT_EQ(most(Space::m, kBitWay), 256U);
  EXPECT_EQ(most(Space::m, kWordWay), 512U);
  EXPECT_EQ(most(Space::ts, kBitWay), 256U);
  EXPECT_EQ(most(Space::ts, kWordWay), 0U);
  EXPECT_EQ(most(Space::d, kWordWay), 64U * 16);
  EXPECT_EQ(most(Space::d, kBitWay), 0U);
  EXPECT_EQ(most(Space::cn32, kWordWay), 32U * 32);
  // A count of 256 points is written as 00.
  EXPECT_EQ(sent(plc(), Read{span("M0", 256), kBitWay}), "00 FF 0A 00 00 00 00 00 20 4D 00 00");
}

TEST(OneE, WordsOfBitsBeginAtAMultipleOf16) {
  const auto goes = [](std::uint32_t first, std::uint32_t bits) {
    return plc().encode(Read{{id(Space::m), first, bits}, kWordWay}, 0).has_value();
  };
  EXPECT_TRUE(goes(16, 32));
  EXPECT_FALSE(goes(8, 16));
  EXPECT_FALSE(goes(0, 8));
  EXPECT_TRUE(goes(7664, 16));
  EXPECT_FALSE(goes(7664, 32));
  EXPECT_TRUE(plc().encode(Read{span("M8", 16), kBitWay}, 0));
}

TEST(OneE, WritesAreAsLongAsTheManualAllows) {
  const auto goes = [](std::string_view first, std::uint32_t count) {
    const Span place = span(first, count);
    return plc().encode(Write{place, Bytes((place.bits + 7) / 8)}, 0).has_value();
  };
  EXPECT_TRUE(goes("D0", 64));
  EXPECT_FALSE(goes("D0", 65));
  EXPECT_TRUE(goes("CN200", 32));
  EXPECT_FALSE(goes("CN200", 33));
  EXPECT_TRUE(goes("M0", 160));
  EXPECT_FALSE(goes("M0", 176));
  EXPECT_TRUE(goes("M1", 160));
  EXPECT_FALSE(goes("M1", 161));
  EXPECT_FALSE(goes("M7679", 2));
  EXPECT_FALSE(goes("M8030", 8));
  EXPECT_FALSE(plc().encode(Write{span("D0", 1), Bytes(1)}, 0));
  EXPECT_FALSE(plc().encode(Write{{id(Space::m), 0, 0}, {}}, 0));
  EXPECT_EQ(plc().max_write_bits(id(Space::m)), 160U);
  EXPECT_EQ(plc().max_write_bits(id(Space::d)), 1024U);
}

TEST(OneE, WholeWordsOfBitsGoBy03AndOthersBy02) {
  EXPECT_EQ(sent(plc(), Write{span("Y20", 16), {0x29, 0x7B}}),
            "03 FF 0A 00 10 00 00 00 20 59 01 00 29 7B");
  EXPECT_EQ(sent(plc(), Write{span("TS0", 16), {0x01, 0x80}}),
            "02 FF 0A 00 00 00 00 00 53 54 10 00 10 00 00 00 00 00 00 01");
  EXPECT_EQ(sent(plc(), Force{id(Space::y), 15, true}), "02 FF 0A 00 0F 00 00 00 20 59 01 00 10");
  EXPECT_EQ(sent(plc(), Force{id(Space::d), 15, true}), "D0: only whole words can be written");
}

TEST(OneE, OneFrameCarries80BitsOrTenWords) {
  const auto forces = [](std::uint32_t count) { return forces_of(id(Space::m), count); };
  const auto words = [](std::uint32_t count) { return writes_of(id(Space::d), count); };
  EXPECT_TRUE(plc().combine(forces(80)));
  EXPECT_FALSE(plc().combine(forces(81)));
  EXPECT_TRUE(plc().combine(words(10)));
  EXPECT_FALSE(plc().combine(words(11)));
  EXPECT_FALSE(plc().combine(words(1)));
  EXPECT_FALSE(plc().combine({forces(1)[0], words(1)[0]}));
  // 05 does not accept 32-bit counters.
  EXPECT_FALSE(plc().combine({words(1)[0], Write{span("CN200", 1), Bytes(4)}}));
  EXPECT_FALSE(plc().combine({words(1)[0], Control{Control::Kind::run}}));
  EXPECT_FALSE(plc().combine({forces(1)[0], Force{id(Space::special_m), 34, true}}));
  const auto both = plc().combine({Write{span("M16", 16), {1, 2}}, words(1)[0]}).value();
  EXPECT_EQ(sent(plc(), both), "05 FF 0A 00 02 00 10 00 00 00 20 4D 01 02 00 00 00 00 20 44 00 00");
}

TEST(OneE, APlanReadsBitsByWhatTakesFewerExchanges) {
  std::vector<Point> points;
  for (int i = 0; i < 500; i += 10) {
    Point& point = points.emplace_back();
    point.address = *plc().parse_address("M" + std::to_string(i), std::nullopt);
    point.type = DataType::boolean;
  }
  const Plan plan = make_plan(plc(), points, {{}, std::chrono::milliseconds(10)}, 0);
  ASSERT_EQ(plan.reads.size(), 1U);
  EXPECT_EQ(plan.reads[0].read.way, kWordWay);
}

// ---- an unknown model --------------------------------------------------------------------------

TEST(OneE, AnUnknownModelIsAskedForNothingThatAnotherSeriesHasElsewhere) {
  const auto unknown = plc(Model::unknown_fx);
  for (const Space space : {Space::x, Space::y, Space::special_m, Space::special_d, Space::cn32}) {
    EXPECT_TRUE(unknown.read_ways(id(space)).empty());
    EXPECT_EQ(unknown.max_write_bits(id(space)), 0U);
    EXPECT_FALSE(plc().read_ways(id(space)).empty());
    EXPECT_FALSE(unknown.with_model("FX3G")->addresses().read_ways(id(space)).empty());
  }
  const auto error = error_of(unknown.encode(Read{span("X0", 1), kBitWay}, 0));
  EXPECT_EQ(error.code, ErrorCode::unsupported);
  expect_says(error.text, "once the model is known");
  EXPECT_EQ(error_of(unknown.encode(Force{id(Space::y), 0, true}, 0)).code, ErrorCode::unsupported);
  // Devices that only an FX3U has are left out too; all others are read.
  EXPECT_TRUE(unknown.encode(Read{span("R23999", 1), kWordWay}, 0));
  EXPECT_FALSE(unknown.encode(Read{span("R24000", 1), kWordWay}, 0));
  EXPECT_TRUE(unknown.encode(Read{span("M0", 1), kBitWay}, 0));
  // The device names are those of an FX3U, because a config has to be written.
  EXPECT_TRUE(unknown.parse_address("X377", std::nullopt));
  EXPECT_FALSE(unknown.run_state_from(Bytes{1}).has_value());
}

TEST(OneE, TheModelIsToldByItsCode) {
  const auto codec = plc(Model::unknown_fx);
  const auto model = [&](std::uint8_t code) { return codec.model_from({{code, 0}}).value_or("?"); };
  EXPECT_EQ(model(0xF3), "FX3U");
  EXPECT_EQ(model(0xF4), "FX3G");
  EXPECT_EQ(model(0xA3), "?");
  EXPECT_EQ(codec.model_from({}), std::nullopt);
  EXPECT_EQ(codec.model_from({Bytes{}}), std::nullopt);
  EXPECT_EQ(codec.with_model("FX5U"), nullptr);
  EXPECT_EQ(codec.with_model("nonsense"), nullptr);
  EXPECT_EQ(model_of(*codec.with_model("FX3GE")), "FX3G");
}

TEST(OneE, RunIsM8000OfAnFx3AndNotToldByAnE71) {
  EXPECT_EQ(sent(plc(), plc().run_state()), "00 FF 0A 00 40 1F 00 00 20 4D 01 00");
  EXPECT_EQ(plc().run_state_from(Bytes{1}), true);
  EXPECT_EQ(plc().run_state_from(Bytes{0}), false);
  EXPECT_EQ(plc().run_state_from({}), std::nullopt);
  EXPECT_EQ(sent(plc(), plc().run_request(true)), "13 FF 0A 00");
  EXPECT_EQ(sent(plc(), plc().run_request(false)), "14 FF 0A 00");
  const auto q = plc(Model::q);
  EXPECT_TRUE(q.encode(q.run_state(), 0));
  EXPECT_EQ(q.run_state_from(Bytes{1, 0}), std::nullopt);
  const auto error = error_of(q.encode(q.run_request(true), 0));
  EXPECT_EQ(error.code, ErrorCode::unsupported);
  EXPECT_EQ(error.text, "1E frames have no RUN, STOP and model for Q: use mc-3e");
  EXPECT_EQ(plc().encode(Control{Control::Kind::reset}, 0).error().code, ErrorCode::unsupported);
  EXPECT_EQ(plc().encode(Enquire{}, 0).error().code, ErrorCode::unsupported);
  EXPECT_EQ(plc().encode(Gather{}, 0).error().code, ErrorCode::unsupported);
}

// ---- answers -----------------------------------------------------------------------------------

const Read kWords{{id(Space::d), 0, 32}, kWordWay};  // D0, D1
const Read kBits{{id(Space::m), 0, 5}, kBitWay};     // M0 to M4
const Force kForce{id(Space::y), 0, true};
const Bytes kImage{0x34, 0x12, 0xCD, 0xAB};

TEST(OneE, EveryBeginningOfAnAnswerNeedsMore) {
  const Bytes binary = hex("81 00 34 12 CD AB");
  for (std::size_t n = 0; n < binary.size(); ++n)
    EXPECT_TRUE(needs_more(kBinary, kWords, first(binary, n))) << n;
  EXPECT_EQ(answer(kBinary, kWords, binary).image, kImage);
  const Bytes digits = ascii("81001234ABCD");
  for (std::size_t n = 0; n < digits.size(); ++n)
    EXPECT_TRUE(needs_more(kAscii, kWords, first(digits, n))) << n;
  EXPECT_EQ(answer(kAscii, kWords, digits).image, kImage);
  EXPECT_EQ(answer(kAscii, kWords, ascii("81001234abcd")).image, kImage);
}

TEST(OneE, AnAnswerLongerThanAskedIsNoValue) {
  expect_says(fault(kBinary, kWords, hex("81 00 34 12 CD AB 00")), "7 bytes where 6 were due");
  expect_says(fault(kAscii, kWords, ascii("81001234ABCD0")), "13 bytes where 12 were due");
  expect_says(fault(kBinary, kForce, hex("82 00 00")), "3 bytes where 2");
  expect_says(fault(kBinary, kBits, hex("80 00 10 10 10 10")), "6 bytes where 5");
}

TEST(OneE, AnEndCodeWithDataIsNoAnswer) {
  expect_says(fault(kBinary, kWords, hex("81 57 34 12 CD AB")), "6 bytes where 4");
  expect_says(fault(kBinary, kWords, hex("81 5B 10 00 34 12")), "6 bytes where 4");
  EXPECT_TRUE(needs_more(kBinary, kWords, hex("81 5B 10")));
}

TEST(OneE, AnAnswerToAnotherCommandIsNeverTaken) {
  EXPECT_EQ(fault(kBinary, kForce, hex("81 00 34 12")),
            "an answer that begins with 81 where 82 is due");
  EXPECT_EQ(fault(kBinary, kWords, hex("82 00")), "an answer that begins with 82 where 81 is due");
  EXPECT_EQ(fault(kBinary, kWords, hex("06")), "an answer that begins with 06 where 81 is due");
  EXPECT_EQ(fault(kAscii, kWords, ascii("8300")), "an answer that begins with 83 where 81 is due");
}

TEST(OneE, AnAnswerOfAnotherFrameKindOrCodeNamesTheSetting) {
  expect_says(fault(kBinary, kWords, hex("D0 00 00 FF FF 03 00 02 00 00 00")),
              "an answer of 3E or 4E frames");
  expect_says(fault(kAscii, kWords, ascii("D00000FF03FF00")), "an answer of 3E or 4E frames");
  expect_says(fault(kBinary, kWords, ascii("8100")), "it is in ASCII; `code`");
  expect_says(fault(kAscii, kWords, hex("81 00 34 12 CD AB")), "it is in binary; `code`");
}

TEST(OneE, DataThatCannotBeAreABadFrame) {
  expect_says(fault(kBinary, kBits, hex("80 00 10 20 10")), "are not bits");
  expect_says(fault(kAscii, kWords, ascii("8100123GABCD")), "not all hex digits");
  // The padding after an odd count may have any value.
  EXPECT_EQ(answer(kBinary, kBits, hex("80 00 01 10 1F")).image, Bytes{0x16});
}

TEST(OneE, ARefusalTellsItsReason) {
  const Reply beyond = answer(kBinary, kWords, hex("81 57"));
  EXPECT_EQ(beyond.kind, Reply::Kind::nak);
  EXPECT_EQ(beyond.device_code, 0x57);
  EXPECT_EQ(beyond.text, "nak 57: too many points, or beyond the last device");
  const Reply pc = answer(kBinary, kWords, hex("81 5B 10 00"));
  EXPECT_EQ(pc.device_code, 0x105B);
  EXPECT_EQ(pc.text, "nak 5B 10: no PLC has this PC number (`pc`)");
  EXPECT_EQ(answer(kBinary, kForce, hex("82 5B 15 00")).text,
            "nak 5B 15: the Ethernet module cannot reach the PLC");
  // An E71 may add an abnormal code to other end codes too.
  EXPECT_EQ(answer(kBinary, kForce, hex("82 55 01 00")).device_code, 0x0155);
  expect_says(answer(kAscii, kForce, ascii("8255")).text, "\"Enable online change\"");
  expect_says(answer(kAscii, kForce, ascii("8255")).text,
              "FX3U-ENET: \"Enable Write at RUN time\"");
  expect_says(answer(kAscii, kForce, ascii("8254")).text, "`code`");
  for (const char* code : {"50", "56", "58", "60", "7F"})
    EXPECT_TRUE(answer(kAscii, kForce, ascii(std::string("82") + code)).text.starts_with("nak "));
}

TEST(OneE, WhatARefusalMeans) {
  const Request read = kWords;
  const Request write = kForce;
  const Request run = Control{Control::Kind::run};
  struct Row {
    int code;
    RefusalMeaning of_read;
    RefusalMeaning of_write;
  };
  using M = RefusalMeaning;
  for (const Row& row :
       {Row{0x50, M::final, M::final}, Row{0x54, M::final, M::final}, Row{0x55, M::final, M::final},
        Row{0x56, M::hole, M::final}, Row{0x57, M::hole, M::final}, Row{0x58, M::hole, M::final},
        Row{0x105B, M::unreachable, M::final}, Row{0x185B, M::final, M::final},
        Row{0x155B, M::unreachable, M::unclear}, Row{0x60, M::unreachable, M::unclear},
        Row{0x7F, M::final, M::unclear}}) {
    EXPECT_EQ(plc().meaning_of(read, row.code), row.of_read) << row.code;
    EXPECT_EQ(plc().meaning_of(write, row.code), row.of_write) << row.code;
    EXPECT_EQ(plc().meaning_of(run, row.code), row.of_write) << row.code;
    // A request for the model changes nothing.
    EXPECT_EQ(plc().meaning_of(Control{Control::Kind::identify}, row.code), row.of_read)
        << row.code;
  }
}

TEST(OneE, ASilenceEndsTheConnectionForNoAnswerHasANumber) {
  EXPECT_EQ(plc().after_silence(), Recovery::reconnect);
  EXPECT_EQ(plc().after_nonsense(), Recovery::reconnect);
  EXPECT_EQ(plc().resync(), std::nullopt);
  EXPECT_EQ(plc().gives_up_after(), std::chrono::milliseconds(2500));
  EXPECT_TRUE(plc().expects_reply(kForce));
}

TEST(OneE, ProbesHaveAnswersThatNoOtherProbeAndNoWriteHas) {
  std::set<std::uint32_t> lengths;
  for (const Code data_code : {Code::binary, Code::ascii}) {
    lengths.clear();
    const OneE codec = plc(Model::l, data_code);
    for (std::uint32_t number = 0; number < Codec::kProbes; ++number) {
      const auto probe = codec.probe(number).value();
      EXPECT_TRUE(is_read(probe));
      EXPECT_TRUE(codec.encode(probe, 0).has_value());
      lengths.insert(codec.line_length(probe).reply_chars);
    }
    EXPECT_EQ(lengths.size(), Codec::kProbes);
    EXPECT_FALSE(lengths.contains(codec.line_length(kForce).reply_chars));
  }
}

TEST(OneE, AQuestionThatIsToldApartIsShorter) {
  EXPECT_EQ(plc().shorter_read(kWords), Request(Read({{id(Space::d), 0, 16}, kWordWay})));
  EXPECT_EQ(plc().shorter_read(kBits), Request(Read({{id(Space::m), 0, 3}, kBitWay})));
  EXPECT_EQ(plc().shorter_read(Read{{id(Space::m), 0, 2}, kBitWay}), std::nullopt);
  EXPECT_EQ(plc().shorter_read(Read{span("CN200", 1), kWordWay}), std::nullopt);
  EXPECT_EQ(plc().shorter_read(kForce), std::nullopt);
}

TEST(OneE, OnlyWhatBeginsLikeAnAnswerMayPassForOne) {
  EXPECT_TRUE(kBinary.may_pass_for_answer(hex("00 96 00")));
  EXPECT_FALSE(kBinary.may_pass_for_answer(hex("00 86 92 97 C0")));
  EXPECT_TRUE(kAscii.may_pass_for_answer(ascii("??85")));
  // The rest may still be on its way.
  EXPECT_TRUE(kAscii.may_pass_for_answer(ascii("8")));
  EXPECT_TRUE(kAscii.may_pass_for_answer(ascii("9")));
  EXPECT_FALSE(kAscii.may_pass_for_answer(ascii("0G13")));
}

// ---- options of the config ---------------------------------------------------------------------

TEST(OneE, IsMadeFromItsOptions) {
  const auto made = OneE::make({{"model", std::string("FX3GE")},
                                {"code", std::string("ascii")},
                                {"pc", std::int64_t{2}},
                                {"monitoring_timer_ms", std::int64_t{1000}}})
                        .value();
  EXPECT_EQ(model_of(*made), "FX3G");
  EXPECT_EQ(made->encode(Control{Control::Kind::stop}, 0).value(), ascii("14020004"));
  const auto plain = OneE::make({}).value();
  EXPECT_EQ(model_of(*plain), "");
  EXPECT_EQ(to_hex(*plain->encode(Control{Control::Kind::stop}, 0)), "14 FF 10 00");
  EXPECT_EQ(OneE::make({{"monitoring_timer_ms", std::int64_t{1100}}}).error().text,
            "monitoring_timer_ms must be a multiple of 250");
  EXPECT_EQ(OneE::make({{"model", std::string("FX5U")}}).error().text,
            "model 'FX5U' has no frames of this protocol");
  EXPECT_FALSE(OneE::make({{"model", std::string("FX1N")}}));
}

}  // namespace
}  // namespace fxagent::mc
