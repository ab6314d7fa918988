// Explains a value of the wrong kind to its sender. Forms and flows often turn numbers into text.
#pragma once

#include <string>

#include "protocol/value/point.h"

namespace fxagent {

/// Returns the end of a sentence that names what `type` takes: `: send the number 50, not the text
/// "50"`. Quotes a text only if it is short and printable. Empty if there is nothing to add.
std::string instead_of(const Scalar& scalar, DataType type);

}  // namespace fxagent
