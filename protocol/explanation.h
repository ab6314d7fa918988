// What a frame says, in one line: for `fxagent decode` and for the trace of a line.
#pragma once

#include <string>

#include "protocol/codec.h"

namespace fxagent {

/// "read D123 × 2", "data 1234 ABCD", "nak 06, device number out of range"; of a frame that is not
/// good what is known of it, a colon and why. Of many values the first 16.
std::string summary(const Explanation& frame);

}  // namespace fxagent
