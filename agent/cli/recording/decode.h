// `fxagent decode`: explains a frame field by field.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "protocol/codec.h"

namespace fxagent {

struct DecodeQuestion {
  std::string protocol;
  std::vector<std::string> hex;  ///< in any spelling that from_hex() reads
  std::string model;             ///< empty: the protocol's widest model
  std::optional<Direction> direction;
  bool as_json = false;
};

/// Prints the explanation on stdout. Exit status: 0 valid frame, 1 invalid frame, 2 wrong argument.
int run_decode(const DecodeQuestion& question);

}  // namespace fxagent
