// The MC protocol, PLC side: its frames on Ethernet (SLMP) and on a serial line.
// Sources: MELSEC Communication Protocol Reference Manual SH-080008, of serial frames its 4.2; FX5
// User's Manual (SLMP); of 1E, FX3U-ENET-ADP User's Manual JY997D45801 and FX3U-ENET User's Manual
// JY997D18101.
#pragma once

#include "tests/sim/mc_cpu.h"

namespace fxsim {

/// The station a request is addressed to; by default the one the wire leads to.
struct McRoute {
  unsigned network = 0;
  unsigned pc = 0xFF;
  unsigned module_io = 0x3FF;
  unsigned module_station = 0;

  bool operator==(const McRoute&) const = default;
};

/// Settings of 1E, 3E, 4E, 3C and 4C. Each protocol reads the ones it has.
struct McSettings {
  McCode code = McCode::binary;
  Family family = Family::iq_f;
  McRoute route{};
  bool refuses_foreign = true;        // false: does not answer routes to other stations
  std::vector<McRoute> neighbours{};  // routes that other stations of the line answer
  unsigned station = 0;               // this and the following: 3C and 4C only
  unsigned format = 4;
  bool sum_check = true;
  McCpuSettings cpu{};
};

/// 1E: an FX3 behind its ENET module, binary or ASCII code. Commands 00 to 05 and 13 to 16. The
/// code of a refusal is the end code; 5B is sent with abnormal code 10. A code above FF contains
/// both.
std::unique_ptr<Personality> make_mc_one_e(McSettings settings);
/// `protocol` is mc_3e or mc_4e, binary or ASCII code. Both answer both frames, with one exception:
/// a Q or L with mc_3e, which models its own Ethernet port, does not answer 4E.
std::unique_ptr<Personality> make_mc_ethernet(Protocol protocol, McSettings settings);
/// `protocol` is mc_3c or mc_4c: 3C and 4C in formats 1 to 4, where both answer both frames, and 4C
/// in format 5.
std::unique_ptr<Personality> make_mc_serial(Protocol protocol, McSettings settings);

/// "0401/0000".
std::string mc_command_name(const McRequest& request);
/// Converts an outcome to a Ruling without a reply.
Ruling mc_ruling(const McOutcome& outcome, const McRequest& request);

}  // namespace fxsim
