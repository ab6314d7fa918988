// Reads the transcripts in tests/frames: one block of lines per exchange, separated by blank lines.
// The tests of the product's codecs and those of the simulator both use them, so this file includes
// code of neither.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace fxagent::test {

/// One exchange of a transcript; a missing field is empty.
struct Exchange {
  int line = 0;  ///< in the file, for failure texts
  std::string source;
  std::string model;
  std::string command_set;
  std::string operation;
  std::string device;
  std::uint32_t bytes = 0;
  std::vector<std::uint8_t> request;
  std::vector<std::uint8_t> reply;
  std::vector<std::uint8_t> image;
  /// The line that begins with "@": how the simulator takes part, see tests/sim/transcripts.h.
  std::string simulated;

  std::string where() const { return "line " + std::to_string(line) + ", " + source; }
};

/// Returns all exchanges of tests/frames/`name`. A malformed file fails the running test.
std::vector<Exchange> read_frames(const std::string& name);

/// Converts "02 30 03" to bytes. A typing error fails the running test.
std::vector<std::uint8_t> hex(std::string_view text);

}  // namespace fxagent::test
