// Reads the transcripts in tests/frames: one block of lines for each exchange, a blank line
// between.
#pragma once

#include <string>
#include <vector>

#include "protocol/bytes.h"

namespace fxagent::test {

/// One exchange as the transcript tells it; what a line does not give is empty.
struct Exchange {
  int line = 0;  ///< of the file, for failure texts
  std::string source;
  std::string model;
  std::string command_set;
  std::string operation;
  std::string device;
  std::uint32_t bytes = 0;
  Bytes request;
  Bytes reply;
  Bytes image;
};

/// All exchanges of tests/frames/`name`; a malformed file fails the running test.
std::vector<Exchange> read_frames(const std::string& name);

/// The bytes of "02 30 03"; a typing error in a test fails it.
Bytes hex(std::string_view text);

}  // namespace fxagent::test
