#include "tests/sim/mc.h"

#include <gtest/gtest.h>

#include <array>
#include <random>

#include "tests/sim/mc_transcripts.h"

namespace fxsim {
namespace {

using std::chrono::milliseconds;

constexpr std::string_view kRouteOf3E = "00 FF FF 03 00";

std::string number(unsigned value, unsigned bytes) {
  Bytes out;
  append_mc(out, McCode::binary, value, bytes);
  return to_hex(out);
}

/// Builds a 3E request from `message`, which begins with the command.
Bytes request_3e(std::string_view message, std::string_view route = kRouteOf3E) {
  const auto size = static_cast<unsigned>(hex(message).size());
  return hex("50 00 " + std::string(route) + number(size + 2, 2) + "10 00" + std::string(message));
}

class McPlc : public testing::Test {
 protected:
  void use(std::string_view model, Protocol protocol = Protocol::mc_3e) {
    settings_ = {};
    settings_.family = find_mc_model(model)->family;
    protocol_ = protocol;
    plc_ = std::make_unique<Plc>(make_plc(model));
  }
  void SetUp() override { use("FX5U"); }

  Bytes answer(ByteView request) {
    return replies_of(*make_mc_ethernet(protocol_, settings_), *plc_, request);
  }
  /// Returns end code and data of the answer to a binary 3E request; for a refusal only the end
  /// code.
  std::string asked(std::string_view message, std::string_view route = kRouteOf3E) {
    const auto reply = answer(request_3e(message, route));
    if (reply.size() < 11) return "";
    const auto end_code = static_cast<unsigned>(reply[9] | reply[10] << 8U);
    if (end_code == 0) return to_hex(ByteView(reply).subspan(9));
    Bytes code;
    append_mc(code, McCode::ascii, end_code, 2);
    EXPECT_EQ(reply.size(), 20U);
    return std::string(as_text(code));
  }

  McSettings settings_;
  Protocol protocol_ = Protocol::mc_3e;
  std::unique_ptr<Plc> plc_;
};

TEST(McFrames, OfTheTranscriptsAreAnswered) {
  for (const auto& [e, station, model] : mc_exchanges()) {
    SCOPED_TRACE(e.where());
    if (!e.reply.empty()) expect_exchange(e, *station, make_plc(model));
  }
}

TEST(McFrames, RequestsWithoutAKnownReplyAreUnderstood) {
  for (const auto& [e, station, model] : mc_exchanges()) {
    if (!e.reply.empty()) continue;
    SCOPED_TRACE(e.where());
    const auto frames = frames_of(*station->make_framer(), e.request);
    ASSERT_EQ(frames.size(), 1U);
    ASSERT_TRUE(frames[0].whole);
    ASSERT_TRUE(station->hears(frames[0]));
    auto plc = make_plc(model);
    const auto ruling = station->execute(frames[0], plc);
    EXPECT_EQ(ruling.verdict, Verdict::data);
    EXPECT_EQ(ruling.device, e.device.substr(0, e.device.find('*')));
    unsigned points = e.device.find('*') == std::string::npos ? e.bytes : 0;
    for (std::size_t star = 0; (star = e.device.find('*', star)) != std::string::npos; ++star)
      points += static_cast<unsigned>(std::stoul(e.device.substr(star + 1)));
    EXPECT_EQ(ruling.points, points);
  }
}

TEST_F(McPlc, XAndYAreOctalOnFx5AndHexadecimalElsewhere) {
  preset(*plc_, "X17=1");
  EXPECT_EQ(asked("01 04 01 00 0F 00 00 9C 01 00"), "00 00 10");
  use("iQ-R");
  preset(*plc_, "X1F=1");
  EXPECT_EQ(asked("01 04 01 00 1F 00 00 9C 01 00"), "00 00 10");
}

TEST_F(McPlc, AsciiNumbersAreInTheDevicesOwnBase) {
  settings_.code = McCode::ascii;
  preset(*plc_, "X20=1; B1F=1; D16=ABCD");
  const auto asks = [this](std::string_view device, std::string_view subcommand) {
    const auto text =
        "500000FF03FF00001800100401" + std::string(subcommand) + std::string(device) + "0001";
    const auto reply = answer(mc_bytes(text, McCode::ascii));
    return std::string(as_text(ByteView(reply).subspan(22)));
  };
  EXPECT_EQ(asks("X*000020", "0001"), "1");
  EXPECT_EQ(asks("B*00001F", "0001"), "1");
  EXPECT_EQ(asks("D*000016", "0000"), "ABCD");
  EXPECT_EQ(asks("D*    16", "0000"), "ABCD");
  EXPECT_EQ(to_hex(answer(mc_bytes("500000FF03FF000018001004010000D*00001F0001", McCode::ascii))),
            to_hex(mc_bytes("D00000FF03FF000016C05000FF03FF0004010000", McCode::ascii)));
}

TEST_F(McPlc, LimitsAreThoseOfTheModel) {
  const auto words = [this](unsigned points) {
    return asked("01 04 00 00 00 00 00 A8 " + number(points, 2)).substr(0, 5);
  };
  const auto bits = [this](unsigned points) {
    return asked("01 04 01 00 00 00 00 90 " + number(points, 2)).substr(0, 5);
  };
  EXPECT_EQ(words(960), "00 00");
  EXPECT_EQ(words(961), "C052");
  EXPECT_EQ(words(0), "C052");
  EXPECT_EQ(bits(3584), "00 00");
  EXPECT_EQ(bits(3585), "C051");
  use("L");
  EXPECT_EQ(words(961), "C051");
  EXPECT_EQ(bits(7168), "00 00");
  EXPECT_EQ(bits(7169), "C052");
}

TEST_F(McPlc, RandomLimitsCountEveryItem) {
  const auto devices = [](unsigned count, std::string_view each) {
    std::string text;
    for (unsigned i = 0; i < count; ++i) text += each;
    return text;
  };
  EXPECT_EQ(asked("03 04 00 00 C0 00 " + devices(192, "00 00 00 A8")).substr(0, 5), "00 00");
  EXPECT_EQ(asked("03 04 00 00 C1 00 " + devices(193, "00 00 00 A8")), "C054");
  EXPECT_EQ(asked("02 14 00 00 A0 00 " + devices(160, "00 00 00 A8 00 00")), "00 00");
  EXPECT_EQ(asked("02 14 00 00 A1 00 " + devices(161, "00 00 00 A8 00 00")), "C054");
  EXPECT_EQ(asked("02 14 01 00 BC " + devices(188, "00 00 00 90 00")), "00 00");
  EXPECT_EQ(asked("02 14 01 00 BD " + devices(189, "00 00 00 90 00")), "C053");
  use("iQ-R");
  EXPECT_EQ(asked("03 04 02 00 60 00 " + devices(96, "00 00 00 00 A8 00")).substr(0, 5), "00 00");
  EXPECT_EQ(asked("03 04 02 00 61 00 " + devices(97, "00 00 00 00 A8 00")), "C054");
}

TEST_F(McPlc, PastTheLastDeviceAndInAHoleIsNothing) {
  EXPECT_EQ(asked("01 04 00 00 3F 1F 00 A8 01 00"), "00 00 00 00");
  EXPECT_EQ(asked("01 04 00 00 3F 1F 00 A8 02 00"), "C056");
  EXPECT_EQ(asked("01 04 00 00 40 1F 00 A8 01 00"), "C056");
  settings_.cpu.holes = {{Kind::d, {100, 109}}};
  EXPECT_EQ(asked("01 04 00 00 63 00 00 A8 01 00"), "00 00 00 00");
  EXPECT_EQ(asked("01 04 00 00 63 00 00 A8 02 00"), "C056");
  EXPECT_EQ(asked("01 04 00 00 6E 00 00 A8 01 00"), "00 00 00 00");
  use("iQ-R");
  EXPECT_EQ(asked("01 04 00 00 00 48 00 A8 01 00"), "4031");
}

TEST_F(McPlc, WhatItDoesNotKnowIsRefusedByItsEndCode) {
  EXPECT_EQ(asked("01 08 00 00 01 00 00 00 00 A8"), "C059");        // unknown command
  EXPECT_EQ(asked("01 04 02 00 64 00 00 00 A8 00 01 00"), "C059");  // iQ-R codes
  EXPECT_EQ(asked("01 04 00 00 00 00 00 77 01 00"), "C05B");        // unknown device
  EXPECT_EQ(asked("01 04 00 00 00 00 00 A2 01 00"), "C05B");        // DX
  EXPECT_EQ(asked("01 04 01 00 00 00 00 A8 01 00"), "C05C");        // bit access to D
  EXPECT_EQ(asked("01 04 00 00 00 00 00 52 01 00"), "C05C");        // LTN
  EXPECT_EQ(asked("01 14 01 00 00 00 00 90 01 00 20"), "C060");     // neither 0 nor 1
  EXPECT_EQ(asked("01 04 00 00 64 00 00 A8 01 00 00"), "C061");     // too long
  EXPECT_EQ(asked("01 14 00 00 64 00 00 A8 02 00 01 00"), "C061");  // too short
  EXPECT_EQ(asked("01 04"), "C061");
  use("iQ-R");
  EXPECT_EQ(asked("01 04 02 00 00 00 00 00 59 00 01 00"), "4030");  // LSTS
  use("Q");
  for (const auto* message :
       {"01 01 00 00", "06 04 00 00 01 00 00 00 00 A8 01 00", "19 06 00 00 01 00 41"})
    EXPECT_EQ(asked(message), "C059") << message;
  use("Q", Protocol::mc_4e);
  EXPECT_EQ(asked("01 04 02 00 64 00 00 00 A8 00 01 00"), "C061");
  EXPECT_EQ(asked("01 01 00 00").substr(0, 5), "00 00");
}

TEST_F(McPlc, LongTimersComeByFourWordsAndLongDevicesByDoubleWords) {
  use("iQ-R");
  preset(*plc_, "LTN1=12345678; LTS1=1; LCN0=89ABCDEF; LZ1=1");
  EXPECT_EQ(asked("01 04 00 00 01 00 00 52 04 00"), "00 00 78 56 34 12 02 00 00 00");
  EXPECT_EQ(asked("01 04 00 00 01 00 00 52 02 00"), "4030");
  EXPECT_EQ(asked("03 04 00 00 00 03 01 00 00 52 00 00 00 56 01 00 00 62"),
            "00 00 78 56 34 12 EF CD AB 89 01 00 00 00");
  EXPECT_EQ(asked("03 04 00 00 01 00 00 00 00 56"), "4030");
  EXPECT_EQ(asked("02 14 00 00 00 01 00 00 00 56 44 33 22 11"), "00 00");
  EXPECT_EQ(differences(*plc_, "LCN0=11223344"), "");
}

TEST_F(McPlc, BlocksAreReadAndWrittenInTheOrderOfTheManual) {
  preset(*plc_, "D0=1111 2222; W100=3333; M16=1 1");
  EXPECT_EQ(asked("06 04 00 00 02 01 00 00 00 A8 02 00 00 01 00 B4 01 00 10 00 00 90 01 00"),
            "00 00 11 11 22 22 33 33 03 00");
  EXPECT_EQ(asked("06 04 00 00 01 00 00 00 00 90 01 00"), "C05C");  // bits as a word block
  EXPECT_EQ(asked("06 14 00 00 02 00 00 00 00 A8 01 00 AA AA 05 00 00 A8 01 00 BB BB"), "00 00");
  EXPECT_EQ(differences(*plc_, "D0=AAAA; D5=BBBB"), "");
}

TEST_F(McPlc, RemoteOrdersFollowTheSwitchAndTheState) {
  EXPECT_EQ(asked("01 04 00 00 CB 00 00 A9 01 00"), "00 00 00 00");  // SD203
  EXPECT_EQ(asked("05 10 00 00 01 00"), "4013");                     // latch clear in RUN
  EXPECT_EQ(asked("02 10 00 00 01 00"), "00 00");
  EXPECT_FALSE(plc_->running());
  EXPECT_EQ(asked("01 04 00 00 CB 00 00 A9 01 00"), "00 00 02 00");
  EXPECT_EQ(asked("01 10 00 00 01 00 00 00"), "00 00");
  EXPECT_TRUE(plc_->running());
  EXPECT_EQ(asked("03 10 00 00 01 00"), "00 00");
  EXPECT_EQ(asked("01 04 00 00 CB 00 00 A9 01 00"), "00 00 03 00");
  plc_->set_run_switch(false);
  EXPECT_EQ(asked("01 10 00 00 01 00 00 00"), "00 00");
  EXPECT_FALSE(plc_->running());
  EXPECT_EQ(asked("01 10 00 00 02 00 00 00"), "C05C");
}

TEST_F(McPlc, RunClearsWhatItIsToldTo) {
  preset(*plc_, "D0=1; L0=1");
  EXPECT_EQ(asked("01 10 00 00 01 00 01 00"), "00 00");
  EXPECT_EQ(differences(*plc_, "D0=0; L0=1"), "");
  EXPECT_EQ(asked("01 10 00 00 01 00 02 00"), "00 00");
  EXPECT_EQ(differences(*plc_, "L0=0"), "");
}

TEST_F(McPlc, WritesInRunCanBeForbidden) {
  settings_.cpu.write_in_run = false;
  EXPECT_EQ(asked("01 14 00 00 00 00 00 A8 01 00 01 00"), "0055");
  EXPECT_EQ(asked("01 04 00 00 00 00 00 A8 01 00"), "00 00 00 00");
  plc_->set_running(false);
  EXPECT_EQ(asked("01 14 00 00 00 00 00 A8 01 00 01 00"), "00 00");
}

TEST_F(McPlc, AnotherRouteIsRefusedOrNotHeard) {
  constexpr std::string_view kRead = "01 04 00 00 00 00 00 A8 01 00";
  EXPECT_EQ(asked(kRead, "01 01 FF 03 00"), "C05F");
  EXPECT_EQ(asked(kRead, "00 FF E0 03 00"), "00 00 00 00");  // CPU No. 1
  settings_.refuses_foreign = false;
  EXPECT_EQ(asked(kRead, "01 01 FF 03 00"), "");
  use("iQ-R");
  EXPECT_EQ(asked(kRead, "01 01 FF 03 00"), "4A00");
  settings_.route = {1, 2, 0x3FF, 0};
  EXPECT_EQ(asked(kRead, "01 02 FF 03 00"), "00 00 00 00");
  settings_.neighbours = {{1, 3, 0x3FF, 0}};
  EXPECT_EQ(asked(kRead, "01 03 FF 03 00"), "");
}

TEST_F(McPlc, TheOtherCodeAndAnotherFrameAreMetWithSilence) {
  const auto ascii = mc_bytes("500000FF03FF000018001004010000D*0000000001", McCode::ascii);
  const auto binary = request_3e("01 04 00 00 00 00 00 A8 01 00");
  EXPECT_EQ(to_hex(answer(ascii)), "");
  EXPECT_EQ(to_hex(answer(hex("01 FF 0A 00 00 00 00 00 20 44 01 00"))), "");
  settings_.code = McCode::ascii;
  EXPECT_EQ(to_hex(answer(binary)), "");
  EXPECT_NE(to_hex(answer(ascii)), "");
}

TEST_F(McPlc, BuiltInPortOfQAndLIsSilentTo4E) {
  const auto request =
      hex("54 00 34 12 00 00 00 FF FF 03 00 0C 00 10 00 01 04 00 00 00 00 00 A8 01 00");
  EXPECT_NE(to_hex(answer(request)), "");
  use("L");
  EXPECT_EQ(to_hex(answer(request)), "");
  use("L", Protocol::mc_4e);
  EXPECT_NE(to_hex(answer(request)), "");
}

TEST_F(McPlc, TooGreatALengthWaitsAndAnImpossibleOneEndsTheConnection) {
  auto request = request_3e("01 04 00 00 00 00 00 A8 01 00");
  request[7] = 0x0E;
  const auto next = request_3e("01 04 00 00 00 00 00 A8 01 00");
  const auto station = make_mc_ethernet(protocol_, settings_);
  const auto framer = station->make_framer();
  EXPECT_EQ(to_hex(replies_of(*station, *framer, *plc_, request)), "");
  EXPECT_NE(to_hex(replies_of(*station, *framer, *plc_, next)), "")
      << "C061, of the two bytes more";
  EXPECT_EQ(to_hex(replies_of(*station, *framer, *plc_, next)), "") << "out of step";
}

TEST_F(McPlc, KindsCommandsAndLogTellWhatWasAsked) {
  const auto station = make_mc_ethernet(protocol_, settings_);
  const auto told = [&](std::string_view message) {
    const Frame frame{request_3e(message), true, {}};
    const auto ruling = station->execute(frame, *plc_);
    std::string text = request_kind_name(station->kind(frame)) + " " + station->command(frame) +
                       " " + ruling.device + " " + std::to_string(ruling.count);
    for (const auto value : ruling.values) text += " " + std::to_string(value);
    return text;
  };
  EXPECT_EQ(told("01 04 00 00 64 00 00 90 02 00"), "read 0401/0000 M100 32");
  EXPECT_EQ(told("01 14 00 00 64 00 00 A8 02 00 01 00 02 00"), "write 1401/0000 D100 2 1 2");
  EXPECT_EQ(told("01 14 01 00 64 00 00 90 01 00 10"), "force_on 1401/0001 M100 1 1");
  EXPECT_EQ(told("02 14 01 00 01 64 00 00 90 00"), "force_off 1402/0001 M100 1 0");
  EXPECT_EQ(told("02 14 00 00 00 01 64 00 00 A8 78 56 34 12"), "write 1402/0000 D100 2 22136 4660");
  EXPECT_EQ(told("01 10 00 00 01 00 00 00"), "control 1001/0000  0");
  EXPECT_EQ(told("01 01 00 00"), "other 0101/0000  0");
}

TEST_F(McPlc, FlawsChangeOneThingEach) {
  const auto spoiled = [this](Flaw flaw, std::string_view frame) {
    auto reply = hex(frame);
    make_mc_ethernet(protocol_, settings_)->spoil(reply, flaw);
    return to_hex(reply);
  };
  constexpr std::string_view k3E = "D0 00 00 FF FF 03 00 04 00 00 00 34 12";
  constexpr std::string_view k4E = "D4 00 34 12 00 00 00 FF FF 03 00 04 00 00 00 34 12";
  EXPECT_EQ(spoiled(Flaw::sender, k3E), "D0 00 00 00 FF 03 00 04 00 00 00 34 12");
  EXPECT_EQ(spoiled(Flaw::length, k3E), "D0 00 00 FF FF 03 00 FF FF 00 00 34 12");
  EXPECT_EQ(spoiled(Flaw::length_short, k3E), "D0 00 00 FF FF 03 00 02 00 00 00 34 12");
  EXPECT_EQ(spoiled(Flaw::length_long, k3E), "D0 00 00 FF FF 03 00 06 00 00 00 34 12");
  EXPECT_EQ(spoiled(Flaw::longer, k3E), "D0 00 00 FF FF 03 00 06 00 00 00 34 12 34 12");
  EXPECT_EQ(spoiled(Flaw::shorter, k3E), "D0 00 00 FF FF 03 00 02 00 00 00");
  EXPECT_EQ(spoiled(Flaw::end_code, k3E), "D0 00 00 FF FF 03 00 04 00 59 C0 34 12");
  EXPECT_EQ(spoiled(Flaw::header, k3E), "D4 00 00 FF FF 03 00 04 00 00 00 34 12");
  EXPECT_EQ(spoiled(Flaw::transaction, k3E), k3E);
  EXPECT_EQ(spoiled(Flaw::transaction, k4E), "D4 00 33 12 00 00 00 FF FF 03 00 04 00 00 00 34 12");
  EXPECT_EQ(spoiled(Flaw::longer, k4E), "D4 00 34 12 00 00 00 FF FF 03 00 06 00 00 00 34 12 34 12");
  EXPECT_EQ(spoiled(Flaw::header, k4E), "D0 00 34 12 00 00 00 FF FF 03 00 04 00 00 00 34 12");
}

TEST_F(McPlc, RefusalCarriesAnyEndCode) {
  const auto station = make_mc_ethernet(protocol_, settings_);
  const Frame request{request_3e("01 04 00 00 00 00 00 A8 01 00"), true, {}};
  EXPECT_EQ(to_hex(station->refusal(request, 0xC056)),
            "D0 00 00 FF FF 03 00 0B 00 56 C0 00 FF FF 03 00 01 04 00 00");
}

TEST_F(McPlc, CounterPlantCountsInDAndTakesNoMemory) {
  auto plc = make_plc("FX5U", "counter");
  plc.advance(TimePoint{} + milliseconds(200));
  EXPECT_EQ(plc.memory().get({Kind::d, 7}), 17U);
}

TEST(McDamage, NoBytesBringItDown) {
  std::mt19937 random(1);
  constexpr std::array kFlaws = {Flaw::sum,     Flaw::sender,       Flaw::transaction, Flaw::length,
                                 Flaw::header,  Flaw::length_short, Flaw::length_long, Flaw::longer,
                                 Flaw::shorter, Flaw::end_code};
  for (const auto& [e, station, model] : mc_exchanges()) {
    if (e.reply.empty()) continue;
    auto plc = make_plc(model);
    for (int i = 0; i < 500; ++i) {
      replies_of(*station, plc, damaged(e.request, random));
      auto reply = e.reply;
      for (int flaws = 0; flaws < 6; ++flaws)
        station->spoil(reply, kFlaws[random() % kFlaws.size()]);
    }
  }
}

}  // namespace
}  // namespace fxsim
