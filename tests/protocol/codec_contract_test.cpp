// The rules that every protocol of the catalogue must follow, independent of its frames. A new
// protocol adds its exchanges to samples(); a protocol without any fails the first test.
#include <gtest/gtest.h>

#include <algorithm>

#include "protocol/catalog.h"
#include "protocol/mc/device.h"
#include "protocol/plc.h"
#include "tests/support/transcripts.h"

namespace fxagent {
namespace {

using test::hex;

/// One request and its answer.
struct Sample {
  std::string what;
  std::string model;
  Request request;
  Bytes reply;
  /// A late answer to another request, which must be rejected; empty: the protocol cannot detect
  /// one.
  Bytes stale;
  /// Bytes that may come first on a bad line.
  Bytes noise;
  /// A single character without a sum: only the byte itself distinguishes ACK from NAK.
  bool bare = false;
  // Limits of the protocol itself:
  bool no_sum = false;          ///< a damaged value looks like another value (Modbus TCP)
  bool answer_is_echo = false;  ///< Modbus 05, 06, 22: the answer equals the request
};

std::vector<Sample> programming_port_samples() {
  const std::uint16_t d = mc::id(mc::Space::d);
  const std::uint16_t y = mc::id(mc::Space::y);
  const std::uint16_t special_m = mc::id(mc::Space::special_m);
  const auto late = hex("02 33 34 31 32 03 43 44");
  return {
      {"read of two words", "FX3U", Read{{d, 123 * 16, 32}, 0},
       hex("02 33 34 31 32 43 44 41 42 03 44 37"), Bytes(), hex("FF 00 06 3F")},
      {"extended read of a word", "FX1N", Read{{d, 0, 16}, 1}, hex("02 41 42 31 35 03 45 43"),
       Bytes(), hex("03 30")},
      {"read of a byte of bits", "FX2N", Read{{special_m, 0, 8}, 0}, hex("02 30 39 03 36 43"),
       Bytes(), hex("06")},
      {"force", "FX3U", Force{y, 0, true}, hex("06"), late, hex("FF 3F"), true},
      {"refused write", "FX3U", Write{{d, 0, 16}, {0xAB, 0x15}}, hex("15"), late, hex("03"), true},
      {"enquiry", "FX3U", Enquire{}, hex("06"), late, hex("3F"), true},
  };
}

std::vector<Sample> computer_link_samples() {
  const std::uint16_t d = mc::id(mc::Space::d);
  const std::uint16_t m = mc::id(mc::Space::m);
  const std::uint16_t counters = mc::id(mc::Space::cn32);
  const auto other_station = hex("02 30 31 46 46 35 35 35 35 41 41 41 41 03 43 38");
  const auto late = hex("02 30 30 46 46 31 32 33 34 41 42 43 44 03 43 33");
  return {
      {"read of two words", "FX3U", Read{{d, 0, 32}, 1},
       hex("02 30 30 46 46 31 32 33 34 41 42 43 44 03 43 33"), other_station, hex("FF 3F 03")},
      {"read of a 32-bit counter", "FX2N", Read{{counters, 0, 32}, 1},
       hex("02 30 30 46 46 31 32 33 34 35 36 37 38 03 39 33"), hex("06 30 30 46 46"), hex("0A")},
      {"read of five bits", "FX1S", Read{{m, 0, 5}, 0},
       hex("02 30 30 46 46 30 31 31 30 31 03 45 32"), hex("15 30 31 46 46 30 36"), hex("FF")},
      {"force", "FX3U", Force{m, 0, true}, hex("06 30 30 46 46"), late, hex("FF 3F")},
      {"write of a word", "FX0N", Write{{d, 0, 16}, {0xAB, 0x15}}, hex("06 30 30 46 46"),
       hex("06 30 31 46 46"), hex("03")},
      {"two words in one frame", "FX2N",
       Scatter{{Write{{d, 0, 16}, {1, 2}}, Write{{d, 800, 16}, {3, 4}}}}, hex("06 30 30 46 46"),
       other_station, hex("0D 0A")},
      {"which CPU", "auto", Control{Control::Kind::identify}, hex("02 30 30 46 46 46 33 03 36 38"),
       other_station, hex("3F")},
  };
}

/// V1.1b3, 6.3, 6.2 and 6.12; unit 1. CRCs and LRCs were computed outside of this project.
std::vector<Sample> modbus_samples(std::string_view framing) {
  const std::uint16_t holding = 3;
  const Request words = Read{{holding, 0x6B * 16, 48}};
  const Request bits = Read{{0, 0x13, 19}};
  const Request write = Write{{holding, 16, 32}, {0x0A, 0x00, 0x02, 0x01}};
  const Request force = Force{0, 0xAC, true};
  const Request refused = Read{{0, 0x4A1, 1}};
  const auto sample = [](std::string what, Request request, std::string_view reply,
                         std::string_view stale, std::string_view noise) {
    return Sample{std::move(what), "auto", std::move(request), hex(reply), hex(stale), hex(noise)};
  };
  std::vector<Sample> all;
  if (framing == "modbus-rtu") {
    const auto other_unit = "11 03 06 02 2B 00 00 00 64 C8 BA";
    all = {
        sample("read of registers", words, "01 03 06 02 2B 00 00 00 64 05 7A", other_unit, "00 FF"),
        sample("read of coils", bits, "01 01 03 CD 6B 05 42 82", "11 01 03 CD 6B 05 40 12", "7F"),
        sample("write of registers", write, "01 10 00 01 00 02 10 08", "11 10 00 01 00 02 12 98",
               "00"),
        sample("write of a coil", force, "01 05 00 AC FF 00 4C 1B", "11 05 00 AC FF 00 4E 8B",
               "00"),
        sample("refused read", refused, "01 81 02 C1 91", "11 81 02 C0 54", "00")};
  } else if (framing == "modbus-ascii") {
    const auto text = [](std::string_view t) {
      Bytes frame(t.begin(), t.end());
      frame.insert(frame.end(), {'\r', '\n'});
      return to_hex(frame);
    };
    all = {
        sample("read of registers", words, text(":010306022B0000006465"),
               text(":110306022B0000006455"), "00 FF"),
        sample("write of registers", write, text(":011000010002EC"), text(":111000010002DC"),
               "30 31"),
        sample("refused read", refused, text(":0181027C"), text(":1181026C"), "3A 30"),
        sample("write of a coil", force, text(":010500ACFF004F"), text(":110500ACFF003F"), "3A")};
  } else {
    const auto late = "00 00 00 00 00 09 01 03 06 11 11 22 22 33 33";
    all = {sample("read of registers", words, "00 01 00 00 00 09 01 03 06 02 2B 00 00 00 64", late,
                  ""),
           sample("read of coils", bits, "00 01 00 00 00 06 01 01 03 CD 6B 05", late, ""),
           sample("write of registers", write, "00 01 00 00 00 06 01 10 00 01 00 02",
                  "00 00 00 00 00 06 01 10 00 01 00 02", ""),
           sample("write of a coil", force, "00 01 00 00 00 06 01 05 00 AC FF 00", late, ""),
           sample("refused read", refused, "00 01 00 00 00 03 01 81 02",
                  "00 00 00 00 00 03 01 81 01", "")};
    for (Sample& one : all) one.no_sum = true;
  }
  for (Sample& one : all) one.answer_is_echo = one.request == force;
  return all;
}

/// The frames are from tests/frames/mc_1e.txt. They have no length and no sum, so a stale answer is
/// undetectable; the agent instead drops a connection that might deliver one.
std::vector<Sample> mc_1e_samples() {
  const std::uint16_t d = mc::id(mc::Space::d);
  const std::uint16_t m = mc::id(mc::Space::m);
  const std::uint16_t counters = mc::id(mc::Space::cn32);
  std::vector<Sample> all = {
      {"read of two words", "FX3U", Read{{d, 350 * 16, 32}, 1}, hex("81 00 AB 56 0F 17"), {}, {}},
      {"read of two 32-bit counters",
       "FX3G",
       Read{{counters, 20 * 32, 64}, 1},
       hex("81 00 4E 61 BC 00 40 01 B9 02"),
       {},
       {}},
      {"read of eight bits", "FX3U", Read{{m, 100, 8}, 0}, hex("80 00 10 10 01 10"), {}, {}},
      {"write of five bits", "auto", Write{{m, 10, 5}, {0x15}}, hex("82 00"), {}, {}},
      {"write of three words",
       "Q",
       Write{{d, 1600, 48}, {0x34, 0x12, 0x76, 0x98, 0x09, 0x01}},
       hex("83 00"),
       {},
       {}},
      {"force", "L", Force{m, 0, true}, hex("82 00"), {}, {}},
      {"two bits in one frame",
       "FX3U",
       Scatter{{Write{{m, 50, 1}, {1}}, Write{{mc::id(mc::Space::ts), 3, 1}, {1}}}},
       hex("84 00"),
       {},
       {}},
      {"which PLC", "auto", Control{Control::Kind::identify}, hex("95 00 F3 00"), {}, {}},
      {"refused read", "FX3U", Read{{d, 7999 * 16, 16}, 1}, hex("81 57"), {}, {}},
      {"refused for its PC number", "Q", Read{{d, 0, 16}, 1}, hex("81 5B 10 00"), {}, {}},
  };
  for (Sample& one : all) one.no_sum = true;
  return all;
}

/// SH-080008, 8.1, 8.3 and 11.2, with the own station and serial number or block 1; sums computed
/// outside of this project. Spaces are numbered as in mc/device.h.
std::vector<Sample> mc_ethernet_samples(bool numbered) {
  const std::uint16_t d = 28;
  const std::uint16_t m = 4;
  const auto frame = [&](std::uint8_t serial, std::string_view content) {
    Bytes bytes = hex(numbered ? "D4 00 01 00 00 00 00 FF FF 03 00" : "D0 00 00 FF FF 03 00");
    if (numbered) bytes[2] = serial;
    const Bytes rest = hex(content);
    bytes.push_back(static_cast<std::uint8_t>(rest.size()));
    bytes.push_back(0);
    bytes.insert(bytes.end(), rest.begin(), rest.end());
    return bytes;
  };
  const auto sample = [&](std::string what, std::string model, Request request,
                          std::string_view content, std::string_view stale) {
    Sample one{std::move(what), std::move(model), std::move(request), frame(1, content), {}, {}};
    if (numbered) one.stale = frame(0, stale);
    one.no_sum = true;
    return one;
  };
  return {
      sample("read of two words", "Q", Read{{d, 350 * 16, 32}, 1}, "00 00 AB 56 0F 17",
             "00 00 11 11 22 22"),
      sample("read of eight bits", "FX5U", Read{{m, 100, 8}, 0}, "00 00 00 01 00 11",
             "00 00 11 11 11 11"),
      sample("random read", "iQ-R",
             Gather{{Read{{d, 1600, 16}, 3, 1}, Read{{m, 0, 16}, 3, 1}, Read{{d, 3200, 32}, 3, 1}}},
             "00 00 11 11 22 22 78 56 34 12", "00 00 33 33 44 44 78 56 34 12"),
      sample("force", "FX5U", Force{m, 101, true}, "00 00", "56 C0"),
      sample("write of a word", "auto", Write{{d, 0, 16}, {0xAB, 0x15}}, "00 00", "00 00"),
      sample("two words in one frame", "L",
             Scatter{{Write{{d, 0, 16}, {1, 2}}, Write{{d, 800, 16}, {3, 4}}}}, "00 00", "55 00"),
      sample("refused read", "FX5U", Read{{d, 0, 32}, 1}, "56 C0 00 FF FF 03 00 01 04 00 00",
             "00 00 01 02 03 04"),
      sample("which CPU", "auto", Control{Control::Kind::identify},
             "00 00 51 30 32 55 43 50 55 20 20 20 20 20 20 20 20 20 63 02", "59 C0"),
  };
}

std::vector<Sample> mc_serial_samples(bool is_4c) {
  const std::uint16_t d = 28;
  const std::uint16_t m = 4;
  const auto text = [](std::string_view t) {
    Bytes bytes;
    for (const char c : t)
      bytes.push_back(c == '<'   ? 0x02
                      : c == '>' ? 0x03
                      : c == '+' ? 0x06
                      : c == '-' ? 0x15
                                 : static_cast<std::uint8_t>(c));
    return bytes;
  };
  const Request words = Read{{m, 100, 32}, 1};
  const Request write = Write{{d, 1600, 32}, {0x34, 0x12, 0xCD, 0xAB}};
  if (is_4c)
    return {
        {"read of two words", "FX5U", words, text("<F80000FF03FF000012340002>08"),
         text("<F80100FF03FF000055550002>13"), hex("FF 3F 03")},
        {"read of five bits", "auto", Read{{m, 100, 5}, 0}, text("<F80000FF03FF000010110>6F"),
         text("+F80000FF03FF0000"), hex("0A")},
        {"write of words", "Q", write, text("+F80000FF03FF0000"), text("+F80100FF03FF0000"),
         hex("03")},
        {"refused read", "FX5U", words, text("-F80000FF03FF00007E4F"),
         text("<F80100FF03FF000055550002>13"), hex("FF")},
    };
  return {
      {"read of two words", "FX5U", words, text("<F90000FF0012340002>BA"),
       text("<F90100FF0055550002>C5"), hex("FF 3F 03")},
      {"write of words", "iQ-R", write, text("+F90000FF00"), text("<F90000FF0012340002>BA"),
       hex("03")},
      {"refused write", "Q", write, text("-F90000FF007167"), text("+F90100FF00"), hex("FF")},
  };
}

std::vector<Sample> samples(std::string_view protocol) {
  if (protocol == "mc-1e") return mc_1e_samples();
  if (protocol == "mc-3e" || protocol == "mc-4e") return mc_ethernet_samples(protocol == "mc-4e");
  if (protocol == "mc-3c" || protocol == "mc-4c") return mc_serial_samples(protocol == "mc-4c");
  if (protocol.starts_with("modbus-")) return modbus_samples(protocol);
  if (protocol == "fx-programming-port") return programming_port_samples();
  if (protocol == "fx-computer-link") return computer_link_samples();
  return {};
}

std::shared_ptr<const Codec> codec_of(const ProtocolInfo& info, const std::string& model) {
  Options options = default_options(info);
  options["model"] = model;
  auto codec = info.make(options);
  EXPECT_TRUE(codec.has_value()) << info.name;
  return codec ? *codec : nullptr;
}

Bytes joined(std::initializer_list<ByteView> parts) {
  Bytes all;
  for (const ByteView part : parts) all.insert(all.end(), part.begin(), part.end());
  return all;
}

/// Runs `test` for every sample of every protocol.
template <class Test>
void for_each_sample(Test test) {
  for (const ProtocolInfo& info : catalog()) {
    for (const Sample& sample : samples(info.name)) {
      SCOPED_TRACE(std::string(info.name) + ": " + sample.what);
      const auto codec = codec_of(info, sample.model);
      ASSERT_NE(codec, nullptr);
      const auto sent = codec->encode(sample.request, 1);
      ASSERT_TRUE(sent) << sent.error().text;
      test(sample, *codec, *sent);
    }
  }
}

Reply expected(const Sample& sample, const Codec& codec) {
  const auto reply = codec.decode(sample.request, 1, sample.reply);
  EXPECT_TRUE(reply && *reply);
  return reply && *reply ? **reply : Reply{};
}

bool same(const Result<std::optional<Reply>>& got, const Reply& wanted) {
  return got && *got && (*got)->kind == wanted.kind && (*got)->image == wanted.image;
}

bool need_more(const Result<std::optional<Reply>>& got) { return got && !*got; }

TEST(CodecContract, EveryProtocolHasSampleExchanges) {
  for (const ProtocolInfo& info : catalog()) EXPECT_FALSE(samples(info.name).empty()) << info.name;
}

TEST(CodecContract, AWholeAnswerIsUnderstoodAndConsumedToItsEnd) {
  for_each_sample([](const Sample& sample, const Codec& codec, const Bytes&) {
    const Reply reply = expected(sample, codec);
    EXPECT_EQ(reply.consumed, sample.reply.size());
    const auto* read = std::get_if<Read>(&sample.request);
    if (read != nullptr && reply.kind == Reply::Kind::data) {
      EXPECT_EQ(reply.image.size(), (read->span.bits + 7) / 8);
    }
  });
}

TEST(CodecContract, AnAnswerCutShortAnywhereNeedsMore) {
  for_each_sample([](const Sample& sample, const Codec& codec, const Bytes&) {
    for (std::size_t n = 0; n < sample.reply.size(); ++n)
      EXPECT_TRUE(need_more(codec.decode(sample.request, 1, ByteView(sample.reply).first(n)))) << n;
  });
}

TEST(CodecContract, BytesBehindAnAnswerAreNotConsumed) {
  for_each_sample([](const Sample& sample, const Codec& codec, const Bytes&) {
    const Reply wanted = expected(sample, codec);
    const auto got = codec.decode(sample.request, 1, joined({sample.reply, sample.noise}));
    ASSERT_TRUE(same(got, wanted));
    EXPECT_EQ((*got)->consumed, sample.reply.size());
  });
}

TEST(CodecContract, OneFlippedBitNeverMakesAnotherValue) {
  for_each_sample([](const Sample& sample, const Codec& codec, const Bytes&) {
    if (sample.bare || sample.no_sum) return;
    const Reply wanted = expected(sample, codec);
    for (std::size_t i = 0; i < sample.reply.size() * 8; ++i) {
      Bytes damaged = sample.reply;
      damaged[i / 8] ^= static_cast<std::uint8_t>(1U << (i % 8));
      const auto got = codec.decode(sample.request, 1, damaged);
      if (got && *got) {
        EXPECT_TRUE(same(got, wanted)) << "bit " << i << ": " << to_hex(damaged);
      }
    }
  });
}

/// A write that is refused is final, may be repeated, or is unclear. A hole, or a gateway that does
/// not reach the unit, would not show if the write has taken effect.
TEST(CodecContract, AnyRefusalOfAWriteShowsIfItHasTakenEffect) {
  for_each_sample([](const Sample& sample, const Codec& codec, const Bytes&) {
    const bool is_write = std::holds_alternative<Write>(sample.request) ||
                          std::holds_alternative<Force>(sample.request) ||
                          std::holds_alternative<Scatter>(sample.request);
    if (!is_write) return;
    for (int code = 0; code <= 0xFFFF; ++code) {
      const RefusalMeaning meaning = codec.meaning_of(sample.request, code);
      ASSERT_NE(meaning, RefusalMeaning::hole) << code;
      ASSERT_NE(meaning, RefusalMeaning::unreachable) << code;
    }
  });
}

TEST(CodecContract, OneFlippedBitNeverTurnsAnAckIntoANak) {
  for_each_sample([](const Sample& sample, const Codec& codec, const Bytes&) {
    if (!sample.bare) return;
    const Reply wanted = expected(sample, codec);
    for (int bit = 0; bit < 8; ++bit) {
      const Bytes damaged{static_cast<std::uint8_t>(sample.reply[0] ^ (1 << bit))};
      const auto got = codec.decode(sample.request, 1, damaged);
      if (got && *got) {
        EXPECT_EQ((*got)->kind, wanted.kind) << to_hex(damaged);
      }
    }
  });
}

TEST(CodecContract, TheEchoOfTheRequestIsSkippedHoweverItArrives) {
  for_each_sample([](const Sample& sample, const Codec& codec, const Bytes& sent) {
    if (sample.answer_is_echo) return;
    const Reply wanted = expected(sample, codec);
    const Bytes line = joined({sent, sample.reply});
    for (std::size_t n = 0; n < line.size(); ++n)
      EXPECT_TRUE(need_more(codec.decode(sample.request, 1, ByteView(line).first(n)))) << n;
    const auto got = codec.decode(sample.request, 1, line);
    ASSERT_TRUE(same(got, wanted));
    EXPECT_EQ((*got)->consumed, line.size());
  });
}

TEST(CodecContract, TheRequestItselfIsNeverTheAnswer) {
  for_each_sample([](const Sample& sample, const Codec& codec, const Bytes& sent) {
    if (sample.answer_is_echo) return;
    EXPECT_TRUE(need_more(codec.decode(sample.request, 1, sent)));
    EXPECT_TRUE(need_more(codec.decode(sample.request, 1, joined({sent, sent}))));
  });
}

TEST(CodecContract, AStaleAnswerBeforeTheRealOneIsSkipped) {
  for_each_sample([](const Sample& sample, const Codec& codec, const Bytes&) {
    if (sample.stale.empty()) return;
    EXPECT_TRUE(need_more(codec.decode(sample.request, 1, sample.stale)));
    const auto got = codec.decode(sample.request, 1, joined({sample.stale, sample.reply}));
    EXPECT_TRUE(same(got, expected(sample, codec)));
  });
}

TEST(CodecContract, NoiseBeforeAnAnswerIsSkipped) {
  for_each_sample([](const Sample& sample, const Codec& codec, const Bytes&) {
    const auto got = codec.decode(sample.request, 1, joined({sample.noise, sample.reply}));
    EXPECT_TRUE(same(got, expected(sample, codec)));
  });
}

TEST(CodecContract, WhereTheAnswerBeginsIsToldSoThatWhatIsOlderIsSeen) {
  for_each_sample([](const Sample& sample, const Codec& codec, const Bytes&) {
    if (sample.stale.empty()) return;
    const Bytes older = joined({sample.stale, sample.reply});
    const auto got = codec.decode(sample.request, 1, older);
    ASSERT_TRUE(got && *got);
    EXPECT_EQ((*got)->consumed, older.size());
    if (!sample.bare) {
      EXPECT_EQ(to_hex(ByteView(older).subspan((*got)->began)), to_hex(sample.reply));
    }
  });
}

TEST(CodecContract, EveryAnswerMayPassForAnAnswer) {
  for_each_sample([](const Sample& sample, const Codec& codec, const Bytes&) {
    EXPECT_TRUE(codec.may_pass_for_answer(sample.reply));
    EXPECT_TRUE(codec.may_pass_for_answer(joined({Bytes{0x00, 0xFF}, sample.reply})));
    if (codec.after_silence() == Recovery::none) return;  // identified by its number
    EXPECT_FALSE(codec.may_pass_for_answer({}));
    EXPECT_FALSE(codec.may_pass_for_answer(Bytes{0x00, 0xFF, 0x7F})) << "noise";
    EXPECT_FALSE(codec.may_pass_for_answer(Bytes(40, 0xFF))) << "an idle line that is broken";
  });
}

TEST(CodecContract, AQuestionThatIsToldApartHasAShorterAnswer) {
  for_each_sample([](const Sample& sample, const Codec& codec, const Bytes&) {
    const auto apart = codec.shorter_read(sample.request);
    if (!apart) return;
    EXPECT_LT(codec.line_length(*apart).reply_chars, codec.line_length(sample.request).reply_chars);
    EXPECT_TRUE(codec.encode(*apart, 1));
    const auto got = codec.decode(*apart, 1, sample.reply);
    const bool taken = got && *got && (*got)->kind == Reply::Kind::data;
    EXPECT_FALSE(taken);
  });
}

TEST(CodecContract, TheLineLengthIsWhatIsReallySent) {
  for_each_sample([](const Sample& sample, const Codec& codec, const Bytes& sent) {
    const LineLength length = codec.line_length(sample.request);
    EXPECT_EQ(length.request_chars, sent.size());
    if (expected(sample, codec).kind != Reply::Kind::nak || sample.bare) {
      EXPECT_EQ(length.reply_chars, sample.reply.size());
    }
  });
}

TEST(CodecContract, EveryReadWithinTheLimitsIsSentAndNoneBeyond) {
  for (const ProtocolInfo& info : catalog()) {
    std::vector<std::string> models(info.models.begin(), info.models.end());
    models.emplace_back("auto");
    for (const std::string& model : models) {
      const auto codec = codec_of(info, model);
      ASSERT_NE(codec, nullptr);
      for (std::uint16_t space = 0; space < 40; ++space) {
        for (const ReadWay& way : codec->addresses().read_ways(space)) {
          SCOPED_TRACE(std::string(info.name) + " " + model + " space " + std::to_string(space));
          const auto sent = [&](std::uint32_t first, std::uint32_t bits) {
            return codec->encode(Read{{space, first, bits}, way.way}, 1).has_value();
          };
          const std::uint32_t reach = way.end_bit - way.first_bit;
          const std::uint32_t most = std::min(way.max_bits, reach / way.unit_bits * way.unit_bits);
          EXPECT_TRUE(sent(way.first_bit, way.unit_bits));
          EXPECT_TRUE(sent(way.first_bit, most));
          EXPECT_FALSE(sent(way.first_bit, most + way.unit_bits));
          EXPECT_FALSE(sent(way.first_bit, 0));
          EXPECT_FALSE(sent(way.end_bit, way.unit_bits));
        }
      }
    }
  }
}

TEST(CodecContract, AnAnswerIsExplainedAsOne) {
  for_each_sample([](const Sample& sample, const Codec& codec, const Bytes& sent) {
    EXPECT_TRUE(codec.explain(sent, Direction::request).ok);
    EXPECT_TRUE(codec.explain(sample.reply, Direction::reply).ok);
  });
}

TEST(CodecContract, WhoHasModelsCanBeAskedForItAndWhetherItRuns) {
  for (const ProtocolInfo& info : catalog()) {
    SCOPED_TRACE(info.name);
    const auto codec = codec_of(info, "auto");
    const PlcServices* plc = codec->plc();
    ASSERT_EQ(plc != nullptr, !info.models.empty());
    if (plc == nullptr) continue;
    EXPECT_TRUE(must_ask_model(*codec));
    EXPECT_FALSE(must_ask_model(*plc->with_model(info.models.back())));
    EXPECT_EQ(plc->with_model("none of them"), nullptr);
    ASSERT_FALSE(plc->identify().empty());
    for (const Request& question : plc->identify()) EXPECT_TRUE(codec->encode(question, 1));
    EXPECT_TRUE(codec->encode(plc->run_state(), 1));
    EXPECT_FALSE(plc->run_hint().empty());
    const auto known = plc->with_model(info.models.back());
    for (const bool run : {true, false})
      EXPECT_TRUE(known->encode(known->plc()->run_request(run), 1)) << run;
  }
}

TEST(CodecContract, AnIdentifiedModelIsOneOfTheCatalogue) {
  for (const ProtocolInfo& info : catalog()) {
    const auto codec = codec_of(info, "auto");
    for (const std::string_view model : info.models) {
      ASSERT_NE(codec->plc(), nullptr) << info.name;
      const auto known = codec->plc()->with_model(model);
      ASSERT_NE(known, nullptr) << model;
      EXPECT_EQ(model_of(*known), model);
    }
  }
}

}  // namespace
}  // namespace fxagent
