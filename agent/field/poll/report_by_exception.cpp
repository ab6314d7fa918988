#include "agent/field/poll/report_by_exception.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "protocol/value/value.h"

namespace fxagent {
namespace {

// A cycle may be late by 1/10 of its interval.
constexpr int kLateShare = 10;

bool is_silence(BadReason reason) {
  return reason == BadReason::timeout || reason == BadReason::link_down;
}

/// Returns the rounding error of a difference of binary fractions: 0.3 - 0.2 is a little less than
/// 0.1.
double rounding(double x, double y) {
  return 4 * std::numeric_limits<double>::epsilon() * std::max(std::abs(x), std::abs(y));
}

/// True if two values of one tag differ by at least `deadband` in any element.
bool apart(const Value& a, const Value& b, std::optional<double> deadband) {
  if (!deadband || a.items.size() != b.items.size()) return a != b;
  for (std::size_t i = 0; i < a.items.size(); ++i) {
    if (a.items[i] == b.items[i]) continue;
    const auto x = number_of(a.items[i]);
    const auto y = number_of(b.items[i]);
    if (!x || !y || std::abs(*x - *y) + rounding(*x, *y) >= *deadband) return true;
  }
  return false;
}

}  // namespace

ReportByException::Kept::Kept(const Value& value) {
  const Scalar* one = value.is_array || value.items.size() != 1 ? nullptr : &value.items.front();
  if (const auto* flag = std::get_if<bool>(one))
    kept_ = *flag;
  else if (const auto* integer = std::get_if<std::int64_t>(one))
    kept_ = *integer;
  else if (const auto* real = std::get_if<double>(one))
    kept_ = *real;
  else
    kept_ = std::make_unique<const Value>(value);
}

Value ReportByException::Kept::value() const {
  if (const auto* flag = std::get_if<bool>(&kept_)) return Value(*flag);
  if (const auto* integer = std::get_if<std::int64_t>(&kept_)) return Value(*integer);
  if (const auto* real = std::get_if<double>(&kept_)) return Value(*real);
  if (const auto* whole = std::get_if<std::unique_ptr<const Value>>(&kept_)) return **whole;
  return {};
}

ReportByException::ReportByException(const DeviceConfig& device, std::uint32_t group)
    : device_(device), group_(device.groups[group]) {
  for (std::uint32_t i = 0; i < device.tags.size(); ++i)
    if (device.tags[i].group == group) tags_.push_back(i);
  tags_.shrink_to_fit();
  states_.resize(tags_.size());
  if (group_.on_change) sent_.resize(tags_.size());
}

void ReportByException::adjust(const GroupConfig& group) {
  if (!group.on_change) {
    sent_.clear();
  } else if (!group_.on_change) {
    sent_.resize(tags_.size());
    for (State& state : states_) state.was_sent = false;
  }
  group_ = group;
}

/// `fresh`: the value of this cycle, if the tag is good.
bool ReportByException::differs(std::size_t index, const Value& fresh) const {
  const State& state = states_[index];
  if (!state.was_sent) return true;
  if (state.bad || state.sent_bad) return state.bad != state.sent_bad;
  return group_.on_change &&
         apart(fresh, sent_[index].value(), device_.tags[tags_[index]].units->limits.deadband);
}

void ReportByException::add_last_good(TagReading& bad, std::size_t index) const {
  bad.value = states_[index].value.value();
  bad.bad_since_ms = bad_since_ms_[index];
  bad.last_ms = states_[index].value_ms;
}

std::optional<std::vector<TagReading>> ReportByException::cycle(std::vector<TagReading> readings,
                                                                std::int64_t ts_ms, SteadyTime now,
                                                                SteadyTime next) {
  bool changed = false;
  bool any_bad = false;
  bool all_silent = !tags_.empty();
  for (std::size_t i = 0; i < tags_.size(); ++i) {
    State& state = states_[i];
    const TagReading& fresh = readings[i];
    if (!fresh.bad) {
      state.value = Kept(fresh.value);
      state.value_ms = ts_ms;
    } else if (!state.bad) {
      bad_since_ms_.resize(tags_.size());
      bad_since_ms_[i] = ts_ms;
    }
    state.bad = fresh.bad;
    any_bad = any_bad || fresh.bad.has_value();
    all_silent = all_silent && fresh.bad && is_silence(*fresh.bad);
    changed = changed || differs(i, fresh.value);
  }
  if (!any_bad) bad_since_ms_ = {};

  const bool long_silent = is_long_silent(now, all_silent ? now : next);
  const bool may_hold_back = group_.on_change || all_silent;
  if (may_hold_back && !changed && !long_silent) return std::nullopt;

  for (std::size_t i = 0; i < tags_.size(); ++i) {
    State& state = states_[i];
    if (state.bad)
      add_last_good(readings[i], i);
    else if (group_.on_change)
      sent_[i] = Kept(readings[i].value);
    state.sent_bad = state.bad;
    state.was_sent = true;
  }
  last_sent_ = now;
  return readings;
}

std::size_t ReportByException::index_of(std::uint32_t tag) const {
  return static_cast<std::size_t>(std::find(tags_.begin(), tags_.end(), tag) - tags_.begin());
}

bool ReportByException::is_long_silent(SteadyTime now, SteadyTime next) const {
  if (!last_sent_ || now - *last_sent_ >= group_.max_silent) return true;
  // The next cycle may be a little late.
  const SteadyTime by = next > now ? next + (next - now) / kLateShare : now;
  return by - *last_sent_ >= group_.max_silent;
}

void ReportByException::overwritten(std::uint32_t tag) {
  State& state = states_[index_of(tag)];
  state.value = {};
  state.value_ms = 0;
}

TagReading ReportByException::written(std::uint32_t tag, Value value, std::int64_t ts_ms) {
  const std::size_t index = index_of(tag);
  State& state = states_[index];
  state.value = Kept(value);
  state.value_ms = ts_ms;
  state.bad.reset();
  if (group_.on_change) sent_[index] = Kept(value);
  state.sent_bad.reset();
  TagReading reading;
  reading.tag = tag;
  reading.value = std::move(value);
  return reading;
}

std::optional<ReportByException::BadTag> ReportByException::first_bad() const {
  for (std::size_t i = 0; i < states_.size(); ++i)
    if (states_[i].bad) return BadTag{tags_[i], *states_[i].bad};
  return std::nullopt;
}

}  // namespace fxagent
