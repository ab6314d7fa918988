#include "protocol/value/padding.h"

namespace fxagent {

bool has_padding(const Point& point) {
  return point.type == DataType::string && point.length % 2 != 0;
}

Bytes with_padding_of(const Point& point, Bytes image, ByteView other) {
  if (!has_padding(point)) return image;
  const std::size_t bytes = point.length + std::size_t{1};
  // The last character is the low byte of its word, or with `abcd` the high one.
  const std::size_t at = point.order == ByteOrder::abcd ? bytes - 2 : bytes - 1;
  for (std::size_t i = at; i < image.size() && i < other.size(); i += bytes) image[i] = other[i];
  return image;
}

}  // namespace fxagent
