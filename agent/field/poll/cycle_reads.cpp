#include "agent/field/poll/cycle_reads.h"

#include <algorithm>
#include <set>
#include <span>
#include <utility>

namespace fxagent {
namespace {

/// Copies into `image` (at `place`) the bits of `part` (at `written`) that overlap it.
void patch(Bytes& image, const Span& place, const Span& written, const Bytes& part) {
  const std::uint32_t first = std::max(place.first_bit, written.first_bit);
  const std::uint32_t bits = std::min(place.end_bit(), written.end_bit()) - first;
  insert_bits(image, first - place.first_bit, extract_bits(part, first - written.first_bit, bits),
              bits);
}

}  // namespace

void CycleReads::begin() {
  images_.assign(plan_.reads.size(), {});
  failures_.assign(plan_.reads.size(), std::nullopt);
  ages_.assign(plan_.reads.size(), Age::current);
}

void CycleReads::take(ReadIndices reads, Exchange& exchange) {
  if (exchange.is_data()) plan_.share_out(reads, std::move(exchange.reply.image), images_);
  for (const std::uint32_t read : reads) {
    const bool again = ages_[read] == Age::outdated;
    if (!exchange.is_data() && !again)  // else data that no command has touched stay good
      failures_[read] = bad_reason(exchange);
    if (again) ages_[read] = exchange.is_data() ? Age::read_again : Age::lost;
  }
}

void CycleReads::give_up(BadReason why) {
  for (std::size_t i = 0; i < failures_.size(); ++i)
    if (images_[i].empty() && !failures_[i]) failures_[i] = why;
}

void CycleReads::discard_images() { images_.assign(images_.size(), {}); }

std::vector<std::uint32_t> CycleReads::points_of(ReadIndices reads) const {
  std::set<std::uint32_t> points;
  for (const std::uint32_t read : reads)
    points.insert(plan_.reads[read].points.begin(), plan_.reads[read].points.end());
  return {points.begin(), points.end()};
}

bool CycleReads::has_images(ReadIndices reads) const {
  return std::ranges::none_of(reads, [&](std::uint32_t read) { return images_[read].empty(); });
}

void CycleReads::read_halves(ReadIndices reads) {
  for (const std::uint32_t read : reads) failures_[read].reset();
  const std::size_t half = (reads.size() + 1) / 2;
  for (const ReadIndices part : {reads.first(half), reads.subspan(half)})
    plan_.exchanges.emplace_back(part.begin(), part.end());
}

void CycleReads::read_instead(const std::vector<std::uint32_t>& points, Plan part) {
  const auto offset = static_cast<std::uint32_t>(plan_.reads.size());
  for (std::vector<std::uint32_t>& reads : part.exchanges) {
    for (std::uint32_t& read : reads) read += offset;
    plan_.exchanges.push_back(std::move(reads));
  }
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

void CycleReads::add_read(PlannedRead read) {
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

void CycleReads::overwritten(const Span& span, const Bytes* image) {
  for (std::uint32_t read = 0; read < plan_.reads.size(); ++read) {
    const Span& place = plan_.reads[read].read.span;
    if (images_[read].empty() || !overlap(place, span)) continue;
    if (image != nullptr)
      patch(images_[read], place, span, *image);
    else
      ages_[read] =
          ages_[read] == Age::current || ages_[read] == Age::outdated ? Age::outdated : Age::lost;
  }
}

std::optional<std::uint32_t> CycleReads::outdated() const {
  const auto found = std::find(ages_.begin(), ages_.end(), Age::outdated);
  if (found == ages_.end()) return std::nullopt;
  return static_cast<std::uint32_t>(found - ages_.begin());
}

bool CycleReads::is_current(std::size_t index) const {
  const PointSource& source = plan_.sources[index];
  return std::ranges::none_of(std::span(ages_).subspan(source.first_read, source.count),
                              [](Age age) { return age == Age::outdated || age == Age::lost; });
}

std::optional<BadReason> CycleReads::failure_of(std::size_t index) const {
  const PointSource& source = plan_.sources[index];
  if (source.count == 0) {
    const bool by_device = std::binary_search(plan_.refused.begin(), plan_.refused.end(), index);
    return by_device ? BadReason::nak : BadReason::unsupported;
  }
  for (std::uint32_t read = source.first_read; read < source.first_read + source.count; ++read)
    if (failures_[read]) return failures_[read];
  return std::nullopt;
}

Result<Value> CycleReads::value_of(std::size_t index, const Point& point) const {
  return fxagent::value_of(plan_, images_, point, index);
}

}  // namespace fxagent
