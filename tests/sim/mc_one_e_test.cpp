#include "tests/sim/mc.h"

#include <gtest/gtest.h>

#include "tests/sim/mc_transcripts.h"

namespace fxsim {
namespace {

class McOneEPlc : public testing::Test {
 protected:
  std::string asked(std::string_view request) {
    return to_hex(replies_of(*make_mc_one_e(settings_), plc_, hex(request)));
  }
  std::string asked_in_ascii(std::string_view request) {
    settings_.code = McCode::ascii;
    const auto reply =
        replies_of(*make_mc_one_e(settings_), plc_, mc_bytes(request, McCode::ascii));
    return std::string(as_text(reply));
  }

  McSettings settings_;
  Plc plc_ = make_plc();
};

TEST_F(McOneEPlc, LimitsAreThoseOfFx3) {
  EXPECT_EQ(asked("01 FF 0A 00 00 00 00 00 20 44 40 00").size(), 3U * (2 + 128) - 1);
  EXPECT_EQ(asked("01 FF 0A 00 00 00 00 00 20 44 41 00"), "81 57");
  EXPECT_EQ(asked("01 FF 0A 00 00 00 00 00 20 4D 20 00").size(), 3U * (2 + 64) - 1);
  EXPECT_EQ(asked("01 FF 0A 00 00 00 00 00 20 4D 21 00"), "81 57");
  EXPECT_EQ(asked("00 FF 0A 00 00 00 00 00 20 4D 00 00").size(), 3U * (2 + 128) - 1);
  EXPECT_EQ(asked("02 FF 0A 00 00 00 00 00 20 4D A0 00" + zeros(80)), "82 00");
  EXPECT_EQ(asked("02 FF 0A 00 00 00 00 00 20 4D A1 00" + zeros(81)), "82 57");
  EXPECT_EQ(asked("03 FF 0A 00 00 00 00 00 20 4D 0A 00" + zeros(20)), "83 00");
  EXPECT_EQ(asked("03 FF 0A 00 00 00 00 00 20 4D 0B 00" + zeros(22)), "83 57");
}

TEST_F(McOneEPlc, LongCountersAreTwoWordsLowFirst) {
  preset(plc_, "CN200=BC614E");
  EXPECT_EQ(asked("01 FF 0A 00 C8 00 00 00 4E 43 02 00"), "81 00 4E 61 BC 00");
  EXPECT_EQ(asked_in_ascii("01FF000A434E000000C80200"), "8100614E00BC");
  settings_.code = McCode::binary;
  EXPECT_EQ(asked("01 FF 0A 00 C8 00 00 00 4E 43 01 00"), "81 57");
  EXPECT_EQ(asked("01 FF 0A 00 C7 00 00 00 4E 43 02 00"), "81 57");  // CN199 and CN200
  EXPECT_EQ(asked("03 FF 0A 00 C9 00 00 00 4E 43 02 00 78 56 34 12"), "83 00");
  EXPECT_EQ(differences(plc_, "CN201=12345678"), "");
  EXPECT_EQ(asked("05 FF 0A 00 01 00 C8 00 00 00 4E 43 01 00"), "85 56");
}

TEST_F(McOneEPlc, SpecialDevicesGoByTheirNumbers) {
  EXPECT_EQ(asked("00 FF 0A 00 40 1F 00 00 20 4D 02 00"), "80 00 10");     // M8000 and M8001
  EXPECT_EQ(asked("01 FF 0A 00 41 1F 00 00 20 44 01 00"), "81 00 A8 5E");  // D8001
}

TEST_F(McOneEPlc, RefusalsHaveTheirCodes) {
  EXPECT_EQ(asked("06 FF 0A 00"), "86 50");
  EXPECT_EQ(asked("01 FF 0A 00 00 00 00 00 20 51 01 00"), "81 56");
  EXPECT_EQ(asked("01 FF 0A 00 08 00 00 00 20 4D 01 00"), "81 58");  // not a multiple of 16
  EXPECT_EQ(asked("00 FF 0A 00 00 00 00 00 20 44 01 00"), "80 58");  // bit access to D
  EXPECT_EQ(asked_in_ascii("01FF000A4420000000G00100"), "8154");
  settings_.code = McCode::binary;
  settings_.cpu.holes = {{Kind::d, {5, 5}}};
  EXPECT_EQ(asked("01 FF 0A 00 04 00 00 00 20 44 01 00"), "81 00 00 00");
  EXPECT_EQ(asked("01 FF 0A 00 04 00 00 00 20 44 02 00"), "81 57");
  settings_.cpu.write_in_run = false;
  EXPECT_EQ(asked("03 FF 0A 00 00 00 00 00 20 44 01 00 01 00"), "83 55");
}

TEST_F(McOneEPlc, RandomBitsModelAndLoopback) {
  EXPECT_EQ(asked("04 FF 0A 00 02 00 64 00 00 00 20 4D 01 0F 00 00 00 20 59 01"), "84 00");
  EXPECT_EQ(differences(plc_, "M100=1; Y17=1"), "");
  EXPECT_EQ(asked("16 FF 0A 00 03 41 42 43"), "96 00 03 41 42 43");
  plc_ = make_plc("FX3G");
  EXPECT_EQ(asked("15 FF 0A 00"), "95 00 F4 00");
}

TEST_F(McOneEPlc, OddPointsAreFilledUpInAsciiToo) {
  preset(plc_, "M10=1 0 1");
  EXPECT_EQ(asked_in_ascii("00FF000A4D200000000A0300"), "80001010");
}

TEST_F(McOneEPlc, RunFollowsTheSwitch) {
  EXPECT_EQ(asked("14 FF 0A 00"), "94 00");
  EXPECT_FALSE(plc_.running());
  EXPECT_EQ(asked("13 FF 0A 00"), "93 00");
  EXPECT_TRUE(plc_.running());
  plc_.set_run_switch(false);
  EXPECT_EQ(asked("13 FF 0A 00"), "93 00");
  EXPECT_FALSE(plc_.running());
}

TEST_F(McOneEPlc, OtherFramesAndTheOtherCodeAreMetWithSilence) {
  EXPECT_EQ(asked("50 00 00 FF FF 03 00 0C 00 10 00 01 04 00 00 64 00 00 A8 01 00"), "");
  const auto ascii = mc_bytes("01FF000A4420000000640100", McCode::ascii);
  EXPECT_EQ(to_hex(replies_of(*make_mc_one_e(settings_), plc_, ascii)), "");
  EXPECT_EQ(asked_in_ascii("\x01\xFF"), "");
}

TEST_F(McOneEPlc, AnotherPcNumberCanBeMetWithSilence) {
  settings_.refuses_foreign = false;
  EXPECT_EQ(asked("01 01 0A 00 00 00 00 00 20 44 01 00"), "");
}

TEST_F(McOneEPlc, KindsAndCommands) {
  const auto station = make_mc_one_e(settings_);
  const auto told = [&](std::string_view request) {
    const Frame frame{hex(request), true, {}};
    return request_kind_name(station->kind(frame)) + " " + station->command(frame);
  };
  EXPECT_EQ(told("01 FF 0A 00 00 00 00 00 20 44 01 00"), "read 01");
  EXPECT_EQ(told("02 FF 0A 00 00 00 00 00 20 4D 01 00 10"), "force_on 02");
  EXPECT_EQ(told("04 FF 0A 00 01 00 64 00 00 00 20 4D 00"), "force_off 04");
  EXPECT_EQ(told("13 FF 0A 00"), "control 13");
  EXPECT_EQ(told("15 FF 0A 00"), "other 15");
}

TEST_F(McOneEPlc, RefusalsAndFlawsOnDemand) {
  const auto station = make_mc_one_e(settings_);
  const Frame request{hex("01 FF 0A 00 00 00 00 00 20 44 01 00"), true, {}};
  EXPECT_EQ(to_hex(station->refusal(request, 0x56)), "81 56");
  EXPECT_EQ(to_hex(station->refusal(request, 0x5B)), "81 5B 10 00");
  EXPECT_EQ(to_hex(station->refusal(request, 0x5B12)), "81 5B 12 00");
  const auto spoiled = [&](Flaw flaw) {
    auto reply = hex("81 00 34 12");
    station->spoil(reply, flaw);
    return to_hex(reply);
  };
  EXPECT_EQ(spoiled(Flaw::longer), "81 00 34 12 34 12");
  EXPECT_EQ(spoiled(Flaw::shorter), "81 00");
  EXPECT_EQ(spoiled(Flaw::end_code), "81 50 34 12");
  EXPECT_EQ(spoiled(Flaw::header), "80 00 34 12");
}

}  // namespace
}  // namespace fxsim
