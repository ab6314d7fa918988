#include "tests/sim/mc.h"

#include <gtest/gtest.h>

#include "tests/sim/mc_transcripts.h"

namespace fxsim {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

McCode code_of(unsigned format) { return format == 5 ? McCode::binary : McCode::ascii; }

class McLine : public testing::Test {
 protected:
  void use(unsigned format, Protocol protocol = Protocol::mc_4c) {
    settings_ = {};
    settings_.format = format;
    protocol_ = protocol;
  }
  void SetUp() override { use(4); }

  std::string asked(std::string_view request, TimePoint when = TimePoint{}) {
    const auto station = make_mc_serial(protocol_, settings_);
    const auto code = code_of(settings_.format);
    const auto reply =
        replies_of(*station, *station->make_framer(), plc_, mc_bytes(request, code), when);
    return mc_text(reply, code);
  }

  McSettings settings_;
  Protocol protocol_ = Protocol::mc_4c;
  Plc plc_ = make_plc("FX5U");
};

TEST(McSerialFrames, NoiseAndHalfAFrameAheadChangeNothing) {
  for (auto& [e, station, model] : mc_exchanges()) {
    if (!is_mc_serial(station->protocol()) || e.reply.empty()) continue;
    SCOPED_TRACE(e.where());
    const auto request = e.request;
    for (const std::ptrdiff_t half : {1, 5, 9}) {
      e.request = {0x00, 0x7F, 0x55};
      e.request.insert(e.request.end(), request.begin(), request.begin() + half);
      e.request.insert(e.request.end(), request.begin(), request.end());
      expect_exchange(e, *station, make_plc(model));
    }
  }
}

TEST_F(McLine, AWrongSumIsRefusedAndTheOtherStationIsSilent) {
  EXPECT_EQ(asked("<F80000FF03FF000004010000M*000100000258rn"), ">F80000FF03FF000000000000|FCrn");
  EXPECT_EQ(asked("<F80000FF03FF000004010000M*000100000259rn"), "-F80000FF03FF00007F24rn");
  EXPECT_EQ(asked("<F80100FF03FF000004010000M*000100000259rn"), "");
  EXPECT_EQ(asked("<F80001FF03FF000004010000M*000100000259rn"), "-F80001FF03FF00007F21rn");
  EXPECT_EQ(asked("<F80000FF03FF000004010000M*000100000258rr"), "-F80000FF03FF00007F23rn");
}

TEST_F(McLine, WithoutSumCheckThereIsNoneInBothDirections) {
  settings_.sum_check = false;
  EXPECT_EQ(asked("<F80000FF03FF000004010000M*0001000002rn"), ">F80000FF03FF000000000000|rn");
  EXPECT_EQ(asked("<F80000FF03FF000004010000M*000100000258rn"), "-F80000FF03FF00007F22rn");
  use(1);
  settings_.sum_check = false;
  EXPECT_EQ(asked("<F80000FF03FF000004010000M*0001000002"), ">F80000FF03FF000000000000|");
  EXPECT_EQ(asked("<F80000FF03FF000014010001M*000100000211"), "+F80000FF03FF0000");
  use(3);
  settings_.sum_check = false;
  EXPECT_EQ(asked(">F80000FF03FF000004010000M*0001000002|"), ">F80000FF03FF0000QACK00030000|");
  use(5);
  settings_.sum_check = false;
  EXPECT_EQ(asked("10 02 12 00 F8 00 00 FF FF 03 00 00 01 04 00 00 64 00 00 90 02 00 10 03"),
            "10 02 10 10 00 F8 00 00 FF FF 03 00 00 FF FF 00 00 03 00 00 00 10 03");
}

TEST_F(McLine, RefusalsHaveTheirFormats) {
  use(2);
  EXPECT_EQ(asked("<7AF80000FF03FF000004010000M*0001000002D1"), "-7AF80000FF03FF00007F24");
  use(3);
  EXPECT_EQ(asked(">F80000FF03FF000004010000M*0001000002|5C"), ">F80000FF03FF0000QNAK7F24|");
  use(5);
  EXPECT_EQ(asked("10 02 12 00 F8 00 00 FF FF 03 00 00 01 04 00 00 64 00 00 90 02 00 10 03 30 37"),
            "10 02 0C 00 F8 00 00 FF FF 03 00 00 FF FF 24 7F 10 03 41 36");
  EXPECT_EQ(asked("10 02 13 00 F8 00 00 FF FF 03 00 00 01 04 00 00 64 00 00 90 02 00 10 03 30 37"),
            "10 02 0C 00 F8 00 00 FF FF 03 00 00 FF FF 22 7F 10 03 41 34");
}

TEST_F(McLine, Format1EndsWhereItsCommandSays) {
  use(1, Protocol::mc_3c);
  settings_.sum_check = false;
  preset(plc_, "D0=1 2");
  EXPECT_EQ(asked("<F90000FF0004030000"
                  "0100"
                  "D*000000"),
            ">F90000FF000001|");
  EXPECT_EQ(asked("<F90000FF0014060000"
                  "0100"
                  "D*0000000002AAAABBBB"),
            "+F90000FF00");
  EXPECT_EQ(differences(plc_, "D0=AAAA BBBB"), "");
  EXPECT_EQ(asked("<F90000FF0014020001"
                  "01"
                  "M*00000001"),
            "+F90000FF00");
  EXPECT_EQ(asked("<F90000FF0010010000"
                  "0001"
                  "00"
                  "00"),
            "+F90000FF00");
  EXPECT_EQ(asked("<F90000FF0006190000"
                  "0003"
                  "ABC"),
            ">F90000FF000003ABC|");
  EXPECT_EQ(asked("<F90000FF0008010000"), "-F90000FF007E40");
}

TEST_F(McLine, HalfAFrameIsForgotten) {
  use(1, Protocol::mc_3c);
  settings_.sum_check = false;
  const auto station = make_mc_serial(protocol_, settings_);
  const auto framer = station->make_framer();
  const auto half = mc_bytes("<F90000FF0004010000", McCode::ascii);
  const auto rest = mc_bytes("D*0000000001", McCode::ascii);
  EXPECT_EQ(replies_of(*station, *framer, plc_, half, TimePoint{}).size(), 0U);
  EXPECT_NE(replies_of(*station, *framer, plc_, rest, TimePoint{} + milliseconds(500)).size(), 0U);
  EXPECT_EQ(replies_of(*station, *framer, plc_, half, TimePoint{} + seconds(2)).size(), 0U);
  EXPECT_EQ(replies_of(*station, *framer, plc_, rest, TimePoint{} + seconds(5)).size(), 0U);
}

TEST_F(McLine, EndCodesAreThoseOfASerialPort) {
  settings_.sum_check = false;
  const auto code = [this](const std::string& message) {
    return asked("<F80000FF03FF0000" + message + "rn").substr(17, 4);
  };
  EXPECT_EQ(code("04010000D*0080000001"), "7E4F");
  EXPECT_EQ(code("04010000Q*0000000001"), "7E43");
  EXPECT_EQ(code("04010000D*00000003C1"), "7E42");
  EXPECT_EQ(code("0403000000C1" +
                 [] {
                   std::string devices;
                   for (int i = 0; i < 193; ++i) devices += "D*000000";
                   return devices;
                 }()),
            "7E41");
  EXPECT_EQ(code("04010000D*0000000G01"), "7F20");
  settings_.cpu.write_in_run = false;
  EXPECT_EQ(code("14010000D*00000000011234"), "7167");
}

TEST_F(McLine, FlawsKeepTheSumRight) {
  const auto spoiled = [this](Flaw flaw, std::string_view frame) {
    const auto code = code_of(settings_.format);
    auto reply = mc_bytes(frame, code);
    make_mc_serial(protocol_, settings_)->spoil(reply, flaw);
    return mc_text(reply, code);
  };
  constexpr std::string_view kData = ">F80000FF03FF000012340002|08rn";
  EXPECT_EQ(spoiled(Flaw::sum, kData), ">F80000FF03FF000012340002|00rn");
  EXPECT_EQ(spoiled(Flaw::sender, kData), ">F80100FF03FF000012340002|09rn");
  EXPECT_EQ(spoiled(Flaw::longer, kData), ">F80000FF03FF0000123400021234|D2rn");
  EXPECT_EQ(spoiled(Flaw::shorter, kData), ">F80000FF03FF00001234|46rn");
  EXPECT_EQ(spoiled(Flaw::header, kData), ">F90000FF03FF000012340002|09rn");
  EXPECT_EQ(spoiled(Flaw::sender, "+F80000FF03FF0000rn"), "+F80100FF03FF0000rn");
  use(5);
  constexpr std::string_view kDone = "10 02 0C 00 F8 00 00 FF FF 03 00 00 FF FF 00 00 10 03 30 33";
  EXPECT_EQ(spoiled(Flaw::length_long, kDone),
            "10 02 0E 00 F8 00 00 FF FF 03 00 00 FF FF 00 00 10 03 30 35");
  EXPECT_EQ(spoiled(Flaw::end_code, kDone),
            "10 02 0C 00 F8 00 00 FF FF 03 00 00 FF FF 40 7E 10 03 43 31");
}

}  // namespace
}  // namespace fxsim
