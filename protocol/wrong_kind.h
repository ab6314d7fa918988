// What to tell a sender whose value is of the wrong kind: forms and flows make text of numbers.
#pragma once

#include <string>

#include "protocol/point.h"

namespace fxagent {

/// The end of a sentence that says what `type` takes: `: send the number 50, not the text "50"`.
/// Quotes a text only where it is short and printable. Empty where there is nothing to add.
std::string instead_of(const Scalar& scalar, DataType type);

}  // namespace fxagent
