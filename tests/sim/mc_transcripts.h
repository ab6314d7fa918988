// The exchanges of tests/frames/mc_*.txt, each with a station that takes part in it, and the frames
// of the MC protocol as text: hexadecimal, or in ASCII code with marks (from_marks()).
#pragma once

#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "tests/sim/mc.h"
#include "tests/sim/sample_plc.h"
#include "tests/sim/transcripts.h"

namespace fxsim {

inline Bytes mc_bytes(std::string_view text, McCode code) {
  return code == McCode::binary ? hex(text) : from_marks(text);
}
inline std::string mc_text(ByteView bytes, McCode code) {
  return code == McCode::binary ? to_hex(bytes) : with_marks(bytes);
}

struct McExchange {
  test::Exchange exchange;
  std::unique_ptr<Personality> station;
  std::string model;
};

/// Returns the exchanges of all frames.
inline std::vector<McExchange> mc_exchanges() {
  std::vector<McExchange> exchanges;
  for (const auto protocol :
       {Protocol::mc_1e, Protocol::mc_3e, Protocol::mc_4e, Protocol::mc_3c, Protocol::mc_4c}) {
    std::string file(protocol_name(protocol));
    file[2] = '_';
    for (const auto& e : simulated(file + ".txt")) {
      // "binary.0.0.255" begins with the code, "5.0.0.255.1023.0" with format, station and route.
      const auto setting = split(e.command_set, '.');
      const auto at = [&setting](std::size_t part) {
        return static_cast<unsigned>(std::stoul(setting.at(part)));
      };
      McSettings settings;
      if (setting[0] == "ascii") settings.code = McCode::ascii;
      if (protocol == Protocol::mc_1e) {
        exchanges.push_back({e, make_mc_one_e(settings), "FX3U"});
        continue;
      }
      const auto model = part_in(e).models.front();
      settings.family = find_mc_model(model)->family;
      if (is_mc_serial(protocol)) {
        settings.format = at(0);
        settings.station = at(1);
        settings.route = {at(2), at(3), at(4), at(5)};
        exchanges.push_back({e, make_mc_serial(protocol, settings), model});
      } else {
        // The module of a Q answers more than its CPU's own port.
        const auto answering = settings.family == Family::q_l ? Protocol::mc_4e : protocol;
        exchanges.push_back({e, make_mc_ethernet(answering, settings), model});
      }
    }
  }
  return exchanges;
}

}  // namespace fxsim
