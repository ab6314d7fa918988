// Summarises a frame in one line, for `fxagent decode` and the line trace.
#pragma once

#include <string>

#include "protocol/codec.h"

namespace fxagent {

/// Returns for example "read D123 × 2", "data 1234 ABCD" or "nak 06, device number out of range".
/// For a bad frame: the parts that are known, a colon and the reason. Lists at most 16 values.
std::string summary(const Explanation& frame);

}  // namespace fxagent
