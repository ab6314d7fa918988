// Encodes the value of a point as an image, and decodes it.
#pragma once

#include <cstdint>
#include <string>

#include "protocol/value/point.h"
#include "protocol/value/value.h"

namespace fxagent {

/// Checks that `value` has the kind and the number of elements that the point takes. Does not check
/// its range. Error: bad_request states what the point takes.
Result<void> check_kind(const Point& point, const Value& value);

/// Kind of a failure of pack(): the value has the wrong kind or count, or it is out of range.
enum class PackFault : std::uint8_t { bad_value, out_of_range };
struct PackError {
  PackFault fault = PackFault::bad_value;
  std::string text;
};
/// Returns the raw image of span_of(point) that writes `value`: (value − offset) ÷ scale, rounded
/// to the nearest integer, ties away from zero. An integer type also takes an integer in a text if
/// its samples may have one: beyond ±2^53, and any integer for the 64-bit types.
tl::expected<Bytes, PackError> pack(const Point& point, const Value& value);

/// True if a write of the point covers bytes that do not belong to it. A string of odd length fills
/// only half of its last word; in an array, each element does.
bool has_padding(const Point& point);
/// Returns `image` of the point with those bytes copied from `other`, another image of the point.
Bytes with_padding_of(const Point& point, Bytes image, ByteView other);

/// Decodes the point's value from `image`, whose first bit is `image_first_bit` of the point's
/// space. Errors: unsupported (the point is not wholly inside the image), or bad_request with the
/// text for `bad_value` (NaN, infinite, a nibble that is not BCD). Never bad_frame.
Result<Value> unpack(const Point& point, ByteView image, std::uint32_t image_first_bit);

}  // namespace fxagent
