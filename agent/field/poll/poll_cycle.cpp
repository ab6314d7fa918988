#include "agent/field/poll/poll_cycle.h"

#include <algorithm>
#include <chrono>
#include <span>
#include <utility>

#include "protocol/value/value.h"
#include "protocol/value/word_order.h"

namespace fxagent {
namespace {

// A tag whose bytes alternate between a value and none is reported again only after this long.
constexpr std::chrono::minutes kValueAgain{1};

/// Copies into `image` (at `place`) the bits of `part` (at `written`) that overlap it.
void patch(Bytes& image, const Span& place, const Span& written, const Bytes& part) {
  const std::uint32_t first = std::max(place.first_bit, written.first_bit);
  const std::uint32_t bits = std::min(place.end_bit(), written.end_bit()) - first;
  insert_bits(image, first - place.first_bit, extract_bits(part, first - written.first_bit, bits),
              bits);
}

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
  plan_ = std::move(plan);
  begin(findings);
}

void PollCycle::begin(std::uint64_t findings) {
  findings_ = findings;
  images_.assign(plan_.reads.size(), {});
  failures_.assign(plan_.reads.size(), std::nullopt);
  ages_.assign(plan_.reads.size(), Age::current);
  newer_.clear();
  first_reply_.reset();
  last_reply_ms_ = 0;
  replies_ = 0;
  repeats_ = 0;
}

bool PollCycle::may_repeat() {
  if (repeats_ >= device_.retries) return false;
  ++repeats_;
  return true;
}

void PollCycle::take(const ReadIndices& reads, Exchange exchange) {
  repeats_ = 0;
  take_images(reads, exchange);
  if (exchange.has_answer()) {
    if (!first_reply_) first_reply_ = exchange.ended;
    last_reply_ = exchange.ended;
    last_reply_ms_ = exchange.ended_ms;
    ++replies_;
  }
  for (std::size_t i = 0; i < reads.size(); ++i) forget_older(reads[i]);
}

std::vector<std::uint32_t> PollCycle::points_of(const ReadIndices& reads) const {
  std::vector<std::uint32_t> points;
  for (std::size_t i = 0; i < reads.size(); ++i) {
    const auto& brought = plan_.reads[reads[i]].points;
    points.insert(points.end(), brought.begin(), brought.end());
  }
  std::sort(points.begin(), points.end());
  points.erase(std::unique(points.begin(), points.end()), points.end());
  return points;
}

bool PollCycle::has_images(const ReadIndices& reads) const {
  for (std::size_t i = 0; i < reads.size(); ++i)
    if (images_[reads[i]].empty()) return false;
  return true;
}

void PollCycle::read_halves(const ReadIndices& reads) {
  std::vector<std::uint32_t> left;
  std::vector<std::uint32_t> right;
  for (std::size_t i = 0; i < reads.size(); ++i) {
    failures_[reads[i]].reset();
    (i < (reads.size() + 1) / 2 ? left : right).push_back(reads[i]);
  }
  plan_.exchanges.push_back({std::move(left)});
  plan_.exchanges.push_back({std::move(right)});
}

void PollCycle::read_instead(const std::vector<std::uint32_t>& points, Plan part) {
  const auto offset = static_cast<std::uint32_t>(plan_.reads.size());
  const auto add_exchange = [&](const ReadIndices& reads, std::uint32_t first) {
    PlannedExchange& added = plan_.exchanges.emplace_back();
    for (std::size_t i = 0; i < reads.size(); ++i) added.reads.push_back(first + reads[i]);
  };
  if (!part.exchanges.empty() && plan_.exchanges.empty())
    for (std::uint32_t read = 0; read < offset; ++read) add_exchange(ReadIndices(read), 0);
  if (!part.exchanges.empty() || !plan_.exchanges.empty())
    for (std::uint32_t e = 0; e < part.exchange_count(); ++e)
      add_exchange(part.reads_in(e), offset);
  for (PlannedRead& read : part.reads) {
    for (std::uint32_t& point : read.points) point = points[point];
    add_read(std::move(read));
  }
  for (std::size_t i = 0; i < points.size(); ++i) {
    PointSource& source = plan_.sources[points[i]];
    source = part.sources[i];
    source.first_read += offset;
  }
  for (const std::uint32_t refused : part.refused) plan_.refused.push_back(points[refused]);
  std::sort(plan_.refused.begin(), plan_.refused.end());
}

void PollCycle::add_read(PlannedRead read) {
  std::size_t known = 0;
  while (known < plan_.reads.size() &&
         (images_[known].empty() || plan_.reads[known].read.span != read.read.span))
    ++known;
  const bool is_known = known < plan_.reads.size();
  Bytes image = is_known ? images_[known] : Bytes{};
  const Age age = is_known ? ages_[known] : Age::current;
  plan_.reads.push_back(std::move(read));
  images_.push_back(std::move(image));
  failures_.push_back(std::nullopt);
  ages_.push_back(age);
}

/// A read contains what a command wrote before it; what a command writes after it is newer. An
/// array cut into several reads keeps the whole value written in between.
void PollCycle::forget_older(std::uint32_t read) {
  for (const std::uint32_t point : plan_.reads[read].points) {
    const auto newer = newer_.find(tags()[point]);
    if (newer == newer_.end()) continue;
    const bool is_value = std::holds_alternative<Value>(newer->second);
    const PointSource& source = plan_.sources[point];
    if (is_value ? source.first_read == read : is_current(source)) newer_.erase(newer);
  }
}

void PollCycle::take_images(const ReadIndices& reads, Exchange& exchange) {
  if (exchange.is_data()) plan_.share_out(reads, std::move(exchange.reply.image), images_);
  for (std::size_t i = 0; i < reads.size(); ++i) {
    const std::uint32_t read = reads[i];
    const bool again = ages_[read] == Age::outdated;
    if (!exchange.is_data() && !again)  // else data that no command has touched stay good
      failures_[read] = bad_reason(exchange);
    if (again) ages_[read] = exchange.is_data() ? Age::read_again : Age::lost;
  }
}

bool PollCycle::is_current(const PointSource& source) const {
  return std::ranges::none_of(std::span(ages_).subspan(source.first_read, source.count),
                              [](Age age) { return age == Age::outdated || age == Age::lost; });
}

void PollCycle::overwritten(const Span& span, const Bytes* image, BadReason why) {
  for (std::uint32_t read = 0; read < plan_.reads.size(); ++read) {
    const Span& place = plan_.reads[read].read.span;
    if (images_[read].empty() || !overlap(place, span)) continue;
    if (image != nullptr)
      patch(images_[read], place, span, *image);
    else
      ages_[read] =
          ages_[read] == Age::current || ages_[read] == Age::outdated ? Age::outdated : Age::lost;
  }
  for (std::size_t i = 0; i < tags().size(); ++i) {
    const std::uint32_t tag = tags()[i];
    const auto place = span_of(device_.tags[tag].point);
    if (!place || !overlap(*place, span)) continue;
    report_.overwritten(tag);
    newer_.erase(tag);
    if (!is_current(plan_.sources[i])) newer_.emplace(tag, why);
  }
}

std::optional<std::uint32_t> PollCycle::outdated() const {
  const auto found = std::find(ages_.begin(), ages_.end(), Age::outdated);
  if (found == ages_.end()) return std::nullopt;
  return static_cast<std::uint32_t>(found - ages_.begin());
}

void PollCycle::give_up(BadReason why) {
  for (std::size_t i = 0; i < failures_.size(); ++i)
    if (images_[i].empty() && !failures_[i]) failures_[i] = why;
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

/// Returns why this cycle has nothing for the point.
std::optional<BadReason> PollCycle::failure_of(const PointSource& source, std::size_t index) const {
  if (source.count == 0) {
    const bool by_device = std::binary_search(plan_.refused.begin(), plan_.refused.end(), index);
    return by_device ? BadReason::nak : BadReason::unsupported;
  }
  for (std::uint32_t read = source.first_read; read < source.first_read + source.count; ++read)
    if (failures_[read]) return failures_[read];
  return std::nullopt;
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
  reading.bad = failure_of(plan_.sources[index], index);
  if (!reading.bad && doubtful) reading.bad = BadReason::bad_frame;
  if (reading.bad) return reading;
  auto value = value_of(plan_, images_, device_.tags[reading.tag].point, index);
  if (value)
    reading.value = std::move(*value);
  else
    reading.bad = BadReason::bad_value;
  return reading;
}

void PollCycle::note_no_value(std::size_t index, SteadyTime now) {
  const std::uint32_t tag = tags()[index];
  const auto [last, fresh] = no_value_at_.try_emplace(tag, now);
  const auto since = now - std::exchange(last->second, now);
  if (!fresh && since < kValueAgain) return;
  const auto value = value_of(plan_, images_, device_.tags[tag].point, index);
  if (!value) no_values_.push_back({tag, value.error().text, order_hint_of(index)});
}

void PollCycle::note_order(std::size_t index, const Value& value) {
  const std::uint32_t tag = tags()[index];
  const DataType type = device_.tags[tag].point.type;
  if (type != DataType::float32 && type != DataType::float64) return;
  const auto is_odd = [](const Scalar& item) { return is_absurd(number_of(item).value_or(0)); };
  const auto odd = std::ranges::find_if(value.items, is_odd);
  if (odd == value.items.end() || odd_orders_.contains(tag)) return;
  std::string hint = order_hint_of(index);
  if (hint.empty()) return;
  odd_orders_.insert(tag);
  no_values_.push_back({tag, "reads " + spelled(*odd), std::move(hint)});
}

std::string PollCycle::order_hint_of(std::size_t index) const {
  if (failure_of(plan_.sources[index], index)) return {};
  const auto read = [&](const Point& point) { return value_of(plan_, images_, point, index); };
  Point point = device_.tags[tags()[index]].point;
  const auto order = likelier_order(point, read);
  if (!order) return {};
  point.order = *order;
  const auto value = read(point);
  return value ? order_hint(*order, *value) : std::string();
}

std::optional<Telemetry> PollCycle::finish(bool doubted, std::uint64_t findings,
                                           std::int64_t now_ms, SteadyTime now, SteadyTime next) {
  const bool doubtful = doubted || findings != findings_;
  std::vector<TagReading> fresh;
  fresh.reserve(tags().size());
  for (std::size_t i = 0; i < tags().size(); ++i) {
    fresh.push_back(reading_of(i, doubtful));
    if (fresh.back().bad == BadReason::bad_value)
      note_no_value(i, now);
    else if (!fresh.back().bad)
      note_order(i, fresh.back().value);
  }
  newer_.clear();
  images_.assign(images_.size(), {});  // report nothing twice

  Telemetry message;
  message.group = group_;
  message.ts_ms = replies_ > 0 ? last_reply_ms_ : now_ms;
  if (replies_ > 1)
    message.span_ms =
        std::chrono::duration<double, std::milli>(last_reply_ - *first_reply_).count();
  auto readings = report_.cycle(std::move(fresh), message.ts_ms, now, next);
  if (!readings) return std::nullopt;
  message.readings = std::move(*readings);
  return message;
}

}  // namespace fxagent
