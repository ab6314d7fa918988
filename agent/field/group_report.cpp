#include "agent/field/group_report.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace fxagent {
namespace {

bool is_silence(BadReason reason) {
  return reason == BadReason::timeout || reason == BadReason::link_down;
}

std::optional<double> number(const Scalar& scalar) {
  if (const auto* integer = std::get_if<std::int64_t>(&scalar))
    return static_cast<double>(*integer);
  if (const auto* real = std::get_if<double>(&scalar)) return *real;
  return std::nullopt;
}

/// What binary fractions can lose in a difference: 0.3 - 0.2 is a little less than 0.1.
double rounding(double x, double y) {
  return 4 * std::numeric_limits<double>::epsilon() * std::max(std::abs(x), std::abs(y));
}

/// Whether two values of one tag are at least `deadband` apart, in any element.
bool apart(const Value& a, const Value& b, std::optional<double> deadband) {
  if (!deadband || a.items.size() != b.items.size()) return a != b;
  for (std::size_t i = 0; i < a.items.size(); ++i) {
    const auto x = number(a.items[i]);
    const auto y = number(b.items[i]);
    if (!x || !y) {
      if (a.items[i] != b.items[i]) return true;
    } else if (*x != *y && std::abs(*x - *y) + rounding(*x, *y) >= *deadband) {
      return true;
    }
  }
  return false;
}

}  // namespace

GroupReport::GroupReport(const DeviceConfig& device, std::uint32_t group)
    : device_(device), group_(device.groups[group]) {
  for (std::uint32_t i = 0; i < device.tags.size(); ++i)
    if (device.tags[i].group == group) tags_.push_back(i);
  states_.resize(tags_.size());
}

bool GroupReport::differs(const TagConfig& tag, const State& state) const {
  if (!state.was_sent) return true;
  if (state.bad || state.sent_bad) return state.bad != state.sent_bad;
  return group_.on_change && apart(state.value, state.sent, tag.deadband);
}

TagReading GroupReport::reading(std::uint32_t tag, const State& state) const {
  TagReading out;
  out.tag = tag;
  out.bad = state.bad;
  out.value = state.value;
  if (state.bad) {
    out.bad_since_ms = state.bad_since_ms;
    out.last_ms = state.value_ms;
  }
  return out;
}

std::optional<std::vector<TagReading>> GroupReport::cycle(std::vector<TagOutcome> outcomes,
                                                          std::int64_t ts_ms, SteadyTime now) {
  bool changed = false;
  bool all_silent = !tags_.empty();
  for (std::size_t i = 0; i < tags_.size(); ++i) {
    State& state = states_[i];
    if (auto* value = std::get_if<Value>(&outcomes[i])) {
      state.value = std::move(*value);
      state.value_ms = ts_ms;
      state.bad.reset();
      all_silent = false;
    } else {
      const BadReason why = std::get<BadReason>(outcomes[i]);
      if (!state.bad) state.bad_since_ms = ts_ms;
      state.bad = why;
      if (!is_silence(why)) all_silent = false;
    }
    changed = changed || differs(device_.tags[tags_[i]], state);
  }

  const bool long_silent = !last_sent_ || now - *last_sent_ >= group_.max_silent;
  const bool may_hold_back = group_.on_change || all_silent;
  if (may_hold_back && !changed && !long_silent) return std::nullopt;

  std::vector<TagReading> readings;
  readings.reserve(tags_.size());
  for (std::size_t i = 0; i < tags_.size(); ++i) {
    State& state = states_[i];
    readings.push_back(reading(tags_[i], state));
    if (!state.bad && group_.on_change) state.sent = state.value;
    state.sent_bad = state.bad;
    state.was_sent = true;
  }
  last_sent_ = now;
  return readings;
}

TagReading GroupReport::written(std::uint32_t tag, Value value, std::int64_t ts_ms) {
  const auto place = std::find(tags_.begin(), tags_.end(), tag);
  State& state = states_[static_cast<std::size_t>(place - tags_.begin())];
  state.value = std::move(value);
  state.value_ms = ts_ms;
  state.bad.reset();
  if (group_.on_change) state.sent = state.value;
  state.sent_bad.reset();
  return reading(tag, state);
}

std::optional<BadReason> GroupReport::first_bad() const {
  for (const State& state : states_)
    if (state.bad) return state.bad;
  return std::nullopt;
}

}  // namespace fxagent
