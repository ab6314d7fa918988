// Detects from the bytes of a float that its word order is probably wrong.
#pragma once

#include <functional>
#include <optional>

#include "protocol/value/point.h"
#include "protocol/value/value.h"

namespace fxagent {

/// True if `number` is not 0 and lies outside 1e-15 to 1e15, as every denormal does. Hardly any
/// machine measures such values, but a wrong word order produces them from plain numbers.
bool is_absurd(double number);

/// Returns the order in which a float is plain (0, or 0.001 to 10,000,000) while its own order
/// makes it absurd, NaN or infinite. Tries ABCD, CDAB, BADC, DCBA; for an array returns the first
/// order in which every element is plain. nullopt if the value is not absurd, no other order helps,
/// or the point is not a float. `read` unpacks the same bytes as another point.
std::optional<ByteOrder> likelier_order(const Point& point,
                                        const std::function<Result<Value>(const Point&)>& read);
/// The same for an image that covers the point and begins at `image_first_bit` of its space.
std::optional<ByteOrder> likelier_order(const Point& point, ByteView image,
                                        std::uint32_t image_first_bit);

/// Returns "in word order CDAB it is 230.5: compare word_order with the device".
std::string order_hint(ByteOrder order, const Value& value);

}  // namespace fxagent
