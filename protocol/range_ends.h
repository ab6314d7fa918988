// Ranges as users write them: M100-M199, M100..M199, M100-199.
#pragma once

#include <string>

#include "protocol/value/point.h"

namespace fxagent {

/// Returns the last end in full: "M199" for "M100-199", with the letters of the first end. Returns
/// the first end if there is no other.
std::string last_end(const RangeEnds& ends);

}  // namespace fxagent
