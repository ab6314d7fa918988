// Reads the transcripts in tests/frames: one block of lines per exchange, separated by blank lines.
#pragma once

#include <string>
#include <vector>

#include "protocol/value/bytes.h"

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
  Bytes request;
  Bytes reply;
  Bytes image;
};

/// Returns all exchanges of tests/frames/`name`. A malformed file fails the running test.
std::vector<Exchange> read_frames(const std::string& name);

/// Converts "02 30 03" to bytes. A typing error fails the running test.
Bytes hex(std::string_view text);

}  // namespace fxagent::test
