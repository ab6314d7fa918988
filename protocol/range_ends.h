// Ranges as people write them: M100-M199, M100..M199, M100-199.
#pragma once

#include <string>

#include "protocol/point.h"

namespace fxagent {

/// The last end, written in full: "M199" of "M100-199", which takes the letters of the first one.
/// The first one where there is no other.
std::string last_end(const RangeEnds& ends);

}  // namespace fxagent
