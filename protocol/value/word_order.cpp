#include "protocol/value/word_order.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "protocol/value/pack.h"

namespace fxagent {
namespace {

bool is_plain(double number) {
  constexpr double kLeast = 1e-3;
  constexpr double kGreatest = 1e7;
  return number == 0 || (std::abs(number) >= kLeast && std::abs(number) <= kGreatest);
}

template <class Test>
auto has_number(Test test) {
  return [test](const Scalar& item) { return test(number_of(item).value_or(0)); };
}

}  // namespace

bool is_absurd(double number) {
  constexpr double kLeast = 1e-15;
  constexpr double kGreatest = 1e15;
  return number != 0 && !(std::abs(number) >= kLeast && std::abs(number) <= kGreatest);
}

ReadAs read_from(ByteView image, std::uint32_t first_bit) {
  return [image, first_bit](const Point& point) { return unpack(point, image, first_bit); };
}

std::optional<ByteOrder> likelier_order(const Point& point, std::span<const ByteOrder> orders,
                                        const ReadAs& read) {
  if (point.type != DataType::float32 && point.type != DataType::float64) return std::nullopt;
  Point raw = point;
  raw.scale = 1;
  raw.offset = 0;
  const auto own = read(raw);
  if (own && std::ranges::none_of(own->items, has_number(is_absurd))) return std::nullopt;
  for (const ByteOrder order : orders) {
    raw.order = order;
    const auto value = read(raw);
    if (order != point.order && value && std::ranges::all_of(value->items, has_number(is_plain)))
      return order;
  }
  return std::nullopt;
}

std::string word_order_hint(Point point, std::span<const ByteOrder> orders, const ReadAs& read) {
  constexpr std::size_t kShown = 3;
  const auto order = likelier_order(point, orders, read);
  if (!order) return {};
  point.order = *order;
  const auto value = read(point);
  if (!value) return {};
  std::string text = "in word order " + std::string(to_string(*order)) + " it is";
  for (std::size_t i = 0; i < std::min(kShown, value->items.size()); ++i)
    text += (i > 0 ? ", " : " ") + spelled(value->items[i]);
  if (value->items.size() > kShown) text += ", ...";
  return text + ": compare word_order with the device";
}

}  // namespace fxagent
