// `fxagent decode`: a frame explained field by field.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "protocol/codec.h"

namespace fxagent {

struct DecodeQuestion {
  std::string protocol;
  std::vector<std::string> hex;  ///< in any spelling that from_hex() reads
  std::string model;             ///< empty: the protocol's widest
  std::optional<Direction> direction;
  bool as_json = false;
};

/// Prints the explanation on stdout. Exit status: 0 a good frame, 1 a bad one, 2 a wrong question.
int run_decode(const DecodeQuestion& question);

}  // namespace fxagent
