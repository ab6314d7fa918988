// Detects from the bytes of a float that its word order is probably wrong.
#pragma once

#include <array>
#include <functional>
#include <optional>
#include <span>
#include <string>

#include "protocol/value/point.h"
#include "protocol/value/value.h"

namespace fxagent {

/// True if `number` is not 0 and its magnitude lies outside 1e-15 to 1e15, as that of every
/// denormal does. Hardly any machine measures such values, but a wrong word order produces them
/// from plain numbers.
bool is_absurd(double number);

/// Every order. A device without the option `byte_order` has only the first two.
inline constexpr std::array kByteOrders{ByteOrder::abcd, ByteOrder::cdab, ByteOrder::badc,
                                        ByteOrder::dcba};

/// Unpacks the bytes of a point as another point.
using ReadAs = std::function<Result<Value>(const Point&)>;
/// Reads from an image that begins at `first_bit` of its space and must outlive the result.
ReadAs read_from(ByteView image, std::uint32_t first_bit);

/// Returns the first of `orders` in which a float is plain (0, or 0.001 to 10,000,000; of an array
/// every element) while its own order makes it absurd, NaN or infinite. nullopt if the value is not
/// absurd, no other order helps, or the point is not a float.
std::optional<ByteOrder> likelier_order(const Point& point, std::span<const ByteOrder> orders,
                                        const ReadAs& read);
/// Returns "in word order CDAB it is 230.5: compare word_order with the device"; empty if no order
/// is likelier.
std::string word_order_hint(Point point, std::span<const ByteOrder> orders, const ReadAs& read);

}  // namespace fxagent
