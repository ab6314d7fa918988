// Checks that a value is of the kind that a point takes.
#pragma once

#include "protocol/value/point.h"
#include "protocol/value/value.h"

namespace fxagent {

/// Checks that `value` has the kind and the number of elements that the point takes. Does not check
/// its range. Error: bad_request states what the point takes.
Result<void> check_kind(const Point& point, const Value& value);

/// Returns the integer in a text if samples of the point may have one in that form, otherwise the
/// scalar itself.
Scalar without_quotes(const Point& point, const Scalar& scalar);

}  // namespace fxagent
