#include "agent/field/poll/poll_cycle.h"

#include <algorithm>
#include <chrono>
#include <functional>
#include <utility>

#include "agent/config/keys.h"
#include "protocol/value/word_order.h"

namespace fxagent {
namespace {

// A tag whose bytes alternate between a value and none is reported again only after this long.
constexpr std::chrono::minutes kValueAgain{1};

bool is_float(DataType type) { return type == DataType::float32 || type == DataType::float64; }
bool is_odd(const Scalar& item) { return is_absurd(number_of(item).value_or(0)); }

}  // namespace

PollCycle::PollCycle(const DeviceConfig& device, std::uint32_t group)
    : device_(device), group_(group), report_(device, group) {}

std::vector<Point> PollCycle::points() const {
  std::vector<Point> points;
  points.reserve(tags().size());
  for (const std::uint32_t tag : tags()) points.push_back(device_.tags[tag].point);
  return points;
}

void PollCycle::use(Plan plan, std::uint64_t findings) {
  reads_.use(std::move(plan));
  begin(findings);
}

void PollCycle::compare(const Codec& codec, const Codec* of_plc) {
  renamed_.clear();
  if (of_plc == nullptr) return;
  for (const std::uint32_t tag : tags()) {
    const auto span = span_of(device_.tags[tag].point);
    if (span && names_of(codec.addresses(), *span) != names_of(of_plc->addresses(), *span))
      renamed_.insert(tag);
  }
}

void PollCycle::begin(std::uint64_t findings) {
  findings_ = findings;
  reads_.begin();
  newer_.clear();
  replies_ = 0;
  repeats_ = 0;
}

bool PollCycle::may_repeat() {
  if (repeats_ >= device_.retries) return false;
  ++repeats_;
  return true;
}

void PollCycle::take(ReadIndices reads, Exchange exchange) {
  repeats_ = 0;
  reads_.take(reads, exchange);
  if (exchange.has_answer()) {
    if (replies_++ == 0) first_reply_ = exchange.ended;
    last_reply_ = exchange.ended;
    last_reply_ms_ = exchange.ended_ms;
  }
  for (const std::uint32_t read : reads) forget_older(read);
}

/// A read contains what a command wrote before it; what a command writes after it is newer. An
/// array cut into several reads keeps the whole value written in between.
void PollCycle::forget_older(std::uint32_t read) {
  const Plan& plan = reads_.plan();
  for (const std::uint32_t point : plan.reads[read].points) {
    const auto newer = newer_.find(tags()[point]);
    if (newer == newer_.end()) continue;
    const bool is_value = std::holds_alternative<Value>(newer->second);
    const bool read_is_newer =
        is_value ? plan.sources[point].first_read == read : reads_.is_current(point);
    if (read_is_newer) newer_.erase(newer);
  }
}

void PollCycle::overwritten(const Span& span, const Bytes* image, BadReason why) {
  reads_.overwritten(span, image);
  for (std::size_t i = 0; i < tags().size(); ++i) {
    const std::uint32_t tag = tags()[i];
    const auto place = span_of(device_.tags[tag].point);
    if (!place || !overlap(*place, span)) continue;
    report_.overwritten(tag);
    newer_.erase(tag);
    if (!reads_.is_current(i)) newer_.emplace(tag, why);
  }
}

Telemetry PollCycle::written(std::uint32_t tag, Value value, std::int64_t now_ms) {
  Telemetry message;
  message.group = group_;
  message.ts_ms = now_ms;
  message.partial = true;
  newer_[tag] = value;
  message.readings.push_back(report_.written(tag, std::move(value), now_ms));
  return message;
}

TagReading PollCycle::reading_of(std::size_t index, bool doubtful) const {
  TagReading reading;
  reading.tag = tags()[index];
  if (const auto newer = newer_.find(reading.tag); newer != newer_.end()) {
    if (const auto* value = std::get_if<Value>(&newer->second))
      reading.value = *value;
    else
      reading.bad = std::get<BadReason>(newer->second);
    return reading;
  }
  reading.bad = reads_.failure_of(index);
  if (!reading.bad && doubtful) reading.bad = BadReason::bad_frame;
  if (!reading.bad && renamed_.contains(reading.tag)) reading.bad = BadReason::unsupported;
  if (reading.bad) return reading;
  auto value = reads_.value_of(index, device_.tags[reading.tag].point);
  if (value)
    reading.value = std::move(*value);
  else
    reading.bad = BadReason::bad_value;
  return reading;
}

void PollCycle::check_value(std::size_t index, const TagReading& reading, SteadyTime now) {
  const Point& point = device_.tags[reading.tag].point;
  const auto read = [&](const Point& other) { return reads_.value_of(index, other); };
  const auto hint_of = [&] { return word_order_hint(point, word_orders(*device_.protocol), read); };
  if (reading.bad == BadReason::bad_value) {
    const auto [last, fresh] = none_at_.try_emplace(reading.tag, now);
    const auto since = now - std::exchange(last->second, now);
    if (!fresh && since < kValueAgain) return;
    if (const auto value = read(point); !value)
      no_values_.push_back({reading.tag, value.error().text, hint_of()});
  } else if (!reading.bad && is_float(point.type) && !reads_.failure_of(index)) {
    const auto odd = std::ranges::find_if(reading.value.items, is_odd);
    if (odd == reading.value.items.end() || odd_orders_.contains(reading.tag)) return;
    std::string hint = hint_of();
    if (hint.empty()) return;
    odd_orders_.insert(reading.tag);
    no_values_.push_back({reading.tag, "reads " + spelled(*odd), std::move(hint)});
  }
}

std::optional<Telemetry> PollCycle::finish(bool doubted, std::uint64_t findings,
                                           std::int64_t now_ms, SteadyTime now, SteadyTime next) {
  const bool doubtful = doubted || findings != findings_;
  std::vector<TagReading> fresh;
  fresh.reserve(tags().size());
  for (std::size_t i = 0; i < tags().size(); ++i) {
    fresh.push_back(reading_of(i, doubtful));
    check_value(i, fresh.back(), now);
  }
  newer_.clear();
  reads_.discard_images();  // report nothing twice

  Telemetry message;
  message.group = group_;
  message.ts_ms = replies_ > 0 ? last_reply_ms_ : now_ms;
  if (replies_ > 1)
    message.span_ms = std::chrono::duration<double, std::milli>(last_reply_ - first_reply_).count();
  auto readings = report_.cycle(std::move(fresh), message.ts_ms, now, next);
  if (!readings) return std::nullopt;
  message.readings = std::move(*readings);
  return message;
}

}  // namespace fxagent
