// Decodes the value of a point from an image.
#pragma once

#include <cstdint>

#include "protocol/value/point.h"
#include "protocol/value/value.h"

namespace fxagent {

/// Decodes the point's value from `image`, whose first bit is `image_first_bit` of the point's
/// space. Errors: unsupported (the point is not wholly inside the image), or bad_request with the
/// text for `bad_value` (NaN, infinite, a nibble that is not BCD). Never bad_frame.
Result<Value> unpack(const Point& point, ByteView image, std::uint32_t image_first_bit);

}  // namespace fxagent
