// Handles the bytes of a string's image that hold none of its characters. Pure.
#pragma once

#include "protocol/value/point.h"

namespace fxagent {

/// True if a write of the point covers bytes that do not belong to it. A string of odd length fills
/// only half of its last word; in an array, each element does.
bool has_padding(const Point& point);
/// Returns `image` of the point with those bytes copied from `other`, another image of the point.
Bytes with_padding_of(const Point& point, Bytes image, ByteView other);

}  // namespace fxagent
