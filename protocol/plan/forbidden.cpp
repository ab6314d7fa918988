#include "protocol/plan/forbidden.h"

#include <algorithm>

#include "protocol/value/span.h"

namespace fxagent {
namespace {

/// Removes the places that contain another. A read that must not contain the smaller place must not
/// contain the larger one either.
std::vector<Extent> smallest(std::vector<Extent> places) {
  std::sort(places.begin(), places.end(), [](const Extent& a, const Extent& b) {
    return a.first != b.first ? a.first > b.first : a.end < b.end;
  });
  std::vector<Extent> kept;
  for (const Extent& place : places)
    if (kept.empty() || place.end < kept.back().end) kept.push_back(place);
  std::reverse(kept.begin(), kept.end());
  return kept;
}

}  // namespace

Forbidden::Forbidden(const Holes& holes, std::uint16_t space,
                     const std::vector<std::uint32_t>& borders)
    : cuts_(borders) {
  for (const Holes::Cut& cut : holes.cuts)
    if (cut.space == space) cuts_.push_back(cut.at);
  std::sort(cuts_.begin(), cuts_.end());
  for (const Span& span : holes.missing)
    if (span.space == space) missing_.push_back({span.first_bit, span.end_bit()});
  missing_ = smallest(std::move(missing_));
  for (const Span& span : merged(holes.apart))
    if (span.space == space) apart_.push_back({span.first_bit, span.end_bit()});
}

bool Forbidden::forbids(const ReadWay& way, const Extent& read) const {
  if (holds(read)) return true;
  if (way.gather == 0) return false;
  const auto place = std::ranges::upper_bound(apart_, read.first, {}, &Extent::end);
  return place != apart_.end() && place->first < read.end;
}

bool Forbidden::holds(const Extent& read) const {
  const auto cut = std::upper_bound(cuts_.begin(), cuts_.end(), read.first);
  if (cut != cuts_.end() && *cut < read.end) return true;
  const auto hole = std::ranges::lower_bound(missing_, read.first, {}, &Extent::first);
  return hole != missing_.end() && hole->end <= read.end;
}

}  // namespace fxagent
