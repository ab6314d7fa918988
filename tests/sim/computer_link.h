// The Mitsubishi FX computer link ("dedicated protocol"), PLC side: BR WR BW WW BT WT RR RS PC TT
// GW, and QR QW QT on FX3.
// Source: Mitsubishi JY992D69901 rev. E, chapters 7, 8 and 12; FX3 ranges from the FX3U-ENET
// manual. The checks run in the order of 12.4.1: of several errors, the smallest code is sent.
// On-demand messages, which the PLC initiates, are not simulated.
#pragma once

#include "tests/sim/personality.h"

namespace fxsim {

struct ComputerLinkSettings {
  unsigned station = 0;  // D8121, 0 to 15
  unsigned format = 1;   // 1, or 4: CR LF after every message
  bool sum_check = true;
};

std::unique_ptr<Personality> make_computer_link(ComputerLinkSettings settings);

}  // namespace fxsim
