#include "agent/field/poll/no_values.h"

#include <algorithm>
#include <chrono>

#include "protocol/value/pack.h"
#include "protocol/value/word_order.h"

namespace fxagent {
namespace {

// A tag whose bytes alternate between a value and none is reported again only after this long.
constexpr std::chrono::minutes kValueAgain{1};

/// Returns the hint at a likelier word order; empty if there is none.
std::string hint_of(Point point, const NoValues::Read& read) {
  const auto order = likelier_order(point, read);
  if (!order) return {};
  point.order = *order;
  const auto value = read(point);
  return value ? order_hint(*order, *value) : std::string();
}

}  // namespace

void NoValues::note_none(std::uint32_t tag, const Point& point, const Read& read, SteadyTime now) {
  const auto [last, fresh] = none_at_.try_emplace(tag, now);
  const auto since = now - std::exchange(last->second, now);
  if (!fresh && since < kValueAgain) return;
  const auto value = read(point);
  if (!value) found_.push_back({tag, value.error().text, hint_of(point, read)});
}

void NoValues::note_value(std::uint32_t tag, const Point& point, const Value& value,
                          const Read& read) {
  const auto is_odd = [](const Scalar& item) { return is_absurd(number_of(item).value_or(0)); };
  const auto odd = std::ranges::find_if(value.items, is_odd);
  if (odd == value.items.end() || odd_orders_.contains(tag)) return;
  std::string hint = hint_of(point, read);
  if (hint.empty()) return;
  odd_orders_.insert(tag);
  found_.push_back({tag, "reads " + spelled(*odd), std::move(hint)});
}

}  // namespace fxagent
