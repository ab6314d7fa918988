// The bytes of a string's image that hold none of its characters. Pure.
#pragma once

#include "protocol/point.h"

namespace fxagent {

/// Whether a write of the point covers bytes that are not its own: a string of odd length fills its
/// last word by half, in an array each element does.
bool has_padding(const Point& point);
/// `image` of the point with those bytes as `other`, another image of it, has them.
Bytes with_padding_of(const Point& point, Bytes image, ByteView other);

}  // namespace fxagent
