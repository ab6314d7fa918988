#include "protocol/plan/cheapest_reads.h"

#include <algorithm>
#include <numeric>
#include <utility>

#include "protocol/value/span.h"

namespace fxagent {
namespace {

// Pricing one read length costs about as much as weighing this many reads.
constexpr std::size_t kReadsWorthALength = 4;
// In units. Eight coils make one byte.
constexpr std::uint32_t kLongestPeriod = 16;

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

bool one_read_holds(const std::vector<ReadWay>& ways, const Forbidden& forbidden,
                    const Extent& wanted) {
  return std::ranges::any_of(ways, [&](const ReadWay& way) {
    const auto read = fit(way, wanted);
    return read && !forbidden.forbids(way, *read);
  });
}

/// Returns, for each piece, the first piece that a read ending with it may begin with: the read is
/// not longer than the way allows, and no gap in it is longer than the way's gap.
std::vector<std::size_t> first_partners(const std::vector<Extent>& pieces, const ReadWay& way) {
  std::vector<std::size_t> first(pieces.size(), 0);
  for (std::size_t i = 1; i < pieces.size(); ++i) {
    const std::uint32_t end = pieces[i - 1].end;
    const bool apart = pieces[i].first > end && pieces[i].first - end > way.max_gap_bits;
    first[i] = apart ? i : first[i - 1];
    while (first[i] < i && pieces[i].end - pieces[first[i]].first > way.max_bits) ++first[i];
  }
  return first;
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
  for (const Span& span : merged(holes.never_gathered))
    if (span.space == space) apart_.push_back({span.first_bit, span.end_bit()});
}

bool Forbidden::forbids(const ReadWay& way, const Extent& read) const {
  const auto cut = std::upper_bound(cuts_.begin(), cuts_.end(), read.first);
  if (cut != cuts_.end() && *cut < read.end) return true;
  const auto hole = std::ranges::lower_bound(missing_, read.first, {}, &Extent::first);
  if (hole != missing_.end() && hole->end <= read.end) return true;
  if (way.gather == 0) return false;
  const auto place = std::ranges::upper_bound(apart_, read.first, {}, &Extent::end);
  return place != apart_.end() && place->first < read.end;
}

std::vector<Extent> pieces_of(const Bucket& bucket, const Point& point, const Span& span) {
  const auto held = [&](const Extent& piece) {
    return one_read_holds(bucket.ways, bucket.forbidden, piece);
  };
  const Extent whole{span.first_bit, span.end_bit()};
  if (held(whole)) return {whole};
  const std::uint32_t element = span.bits / point.count;
  for (const std::uint32_t step : {element, bucket.ways.front().unit_bits}) {
    std::vector<Extent> pieces;
    for (std::uint32_t at = whole.first; at < whole.end; at += step)
      pieces.push_back({at, std::min(at + step, whole.end)});
    if (std::all_of(pieces.begin(), pieces.end(), held)) return pieces;
  }
  return {};
}

void reduce(Bucket& bucket) {
  std::uint32_t grain = 0;
  for (const ReadWay& way : bucket.ways)
    grain = std::gcd(grain, std::gcd(way.align_bits, way.unit_bits));
  for (Extent& piece : bucket.pieces) {
    piece.first -= piece.first % grain;
    piece.end = round_up(piece.end, grain);
  }
  std::sort(bucket.pieces.begin(), bucket.pieces.end(), [](const Extent& a, const Extent& b) {
    return a.first != b.first ? a.first < b.first : a.end > b.end;
  });
  std::vector<Extent> kept;
  for (const Extent& piece : bucket.pieces)
    if (kept.empty() || piece.end > kept.back().end) kept.push_back(piece);
  bucket.pieces = std::move(kept);
}

// The search by dynamic programming: the least cost of the first n pieces, for each n.
//
// Only runs of pieces that are consecutive in start order need to be tried. Proof: take any set of
// reads and drop those inside another, so that starts and ends both ascend. Assign each piece to
// the last read that begins at or before it. That read ends no earlier than the read that covered
// the piece before, so it covers the piece too. Each read is thus assigned a run of consecutive
// pieces.

ReadSearch::ReadSearch(const Codec& codec, const LineCost& cost, const Bucket& bucket)
    : codec_(codec), cost_(cost), bucket_(bucket) {
  prices_.resize(bucket.ways.size());
  for (const ReadWay& way : bucket.ways) partners_.push_back(first_partners(bucket.pieces, way));
  for (std::size_t w = 0; w < bucket.ways.size(); ++w) starts_.push_back(starts_by(w));
}

ReadSearch::Starts ReadSearch::starts_by(std::size_t way) {
  const ReadWay& by = bucket_.ways[way];
  const std::uint32_t first =
      round_up(std::max(bucket_.pieces.front().first / by.align_bits * by.align_bits, by.first_bit),
               by.align_bits);
  if (first >= by.end_bit || first >= bucket_.pieces.back().end) return {};
  const std::uint32_t longest =
      std::min({by.max_bits, (by.end_bit - first) / by.unit_bits * by.unit_bits,
                round_up(bucket_.pieces.back().end - first, by.unit_bits)});
  std::size_t reads = 0;
  for (std::size_t last = 0; last < pieces(); ++last) reads += last + 1 - partners_[way][last];
  if (reads < kReadsWorthALength * (longest / by.unit_bits)) return {};
  const auto price = [&](std::uint32_t bits) { return price_of(way, {first, first + bits}); };
  for (std::uint32_t period = by.unit_bits; period <= kLongestPeriod * by.unit_bits; period *= 2) {
    Starts starts;
    starts.period = period;
    if (by.unit_bits + period <= longest)
      starts.each = price(by.unit_bits + period) - price(by.unit_bits);
    bool is_steady = true;
    for (std::uint32_t bits = by.unit_bits; is_steady && bits + period <= longest;
         bits += by.unit_bits)
      is_steady = price(bits + period) - price(bits) == starts.each;
    if (!is_steady) continue;
    starts.queues.resize(period / std::gcd(by.align_bits, period));
    return starts;
  }
  return {};
}

Read ReadSearch::read_by(std::uint8_t way, const Extent& extent) const {
  const ReadWay& by = bucket_.ways[way];
  return {{bucket_.space, extent.first, extent.end - extent.first}, by.way, by.gather};
}

Cost ReadSearch::price_of(std::size_t way, const Extent& extent) {
  const ReadWay& by = bucket_.ways[way];
  std::vector<Cost>& known = prices_[way];
  if (known.empty()) known.assign(by.max_bits / by.unit_bits + 1, kImpossible);
  Cost& price = known[(extent.end - extent.first) / by.unit_bits];
  if (price != kImpossible) return price;
  const Read read = read_by(static_cast<std::uint8_t>(way), extent);
  if (by.gather == 0) return price = cost_.of(codec_.line_length(read)).count();
  const std::uint32_t chars = codec_.line_length(Gather{{read}}).planned_chars();
  return price = (cost_.per_char * chars).count();
}

std::optional<Extent> ReadSearch::read_of(std::size_t way, std::size_t first, std::size_t last) {
  ++weighed_;
  const ReadWay& by = bucket_.ways[way];
  return fit(by, {bucket_.pieces[first].first, bucket_.pieces[last].end});
}

void ReadSearch::take(std::size_t way, const PartPrice& part, std::size_t first, std::size_t last,
                      const Extent& extent) {
  const std::size_t step = part.counted ? 1 : 0;
  const Cost own = price_of(way, extent) + part.each +
                   part.each_bit * static_cast<Cost>(extent.end - extent.first);
  for (std::size_t n = step; n < counts_; ++n) {
    const Cost before = best_[first * counts_ + n - step].cost;
    if (before == kImpossible) continue;
    const Cost total = before + own;
    Choice& choice = best_[(last + 1) * counts_ + n];
    // Among equal costs, prefer fewer reads.
    if (total < choice.cost || (total == choice.cost && first < choice.first))
      choice = {total, static_cast<std::uint32_t>(first), static_cast<std::uint8_t>(way), extent};
  }
}

void ReadSearch::try_way(std::size_t way, const PartPrice& part, std::size_t last) {
  const ReadWay& by = bucket_.ways[way];
  // Near the last device a read may begin before its first piece (fit()).
  const bool may_stick_out = bucket_.pieces[last].end > by.end_bit - (by.unit_bits - 1);
  if (starts_[way].period == 0 || counts_ > 1 || may_stick_out)
    try_all_starts(way, part, last);
  else
    try_best_starts(way, part, last);
}

void ReadSearch::try_all_starts(std::size_t way, const PartPrice& part, std::size_t last) {
  // Go back from the last piece until a read cannot hold them all. A read that begins earlier
  // cannot either.
  for (std::size_t first = last + 1; first-- > partners_[way][last];) {
    const auto extent = read_of(way, first, last);
    if (!extent) break;
    if (!bucket_.forbidden.forbids(bucket_.ways[way], *extent))
      take(way, part, first, last, *extent);
  }
}

void ReadSearch::try_best_starts(std::size_t way, const PartPrice& part, std::size_t last) {
  const ReadWay& by = bucket_.ways[way];
  Starts& starts = starts_[way];
  if (best_[last].cost != kImpossible) {
    const std::uint32_t first = bucket_.pieces[last].first / by.align_bits * by.align_bits;
    const Cost period = starts.each + part.each_bit * static_cast<Cost>(starts.period);
    const Start start{last, best_[last].cost - period * static_cast<Cost>(first / starts.period)};
    auto& queue = starts.queues[first % starts.period * starts.queues.size() / starts.period];
    // An earlier start in the same queue reads more bits by the same distance, whatever the end,
    // and reaches its length limit first. A worse one can never win again.
    while (!queue.empty() && queue.back().worth > start.worth) queue.pop_back();
    queue.push_back(start);
  }
  for (auto& queue : starts.queues)
    // If the longer of two reads is impossible now, it is impossible to any later end too.
    for (; !queue.empty(); queue.pop_front()) {
      const std::size_t first = queue.front().piece;
      if (first < partners_[way][last]) continue;
      const auto extent = read_of(way, first, last);
      if (!extent || bucket_.forbidden.forbids(by, *extent)) continue;
      take(way, part, first, last, *extent);
      break;
    }
}

std::vector<Cost> ReadSearch::run(const PartPrices& prices, const std::vector<Cost>& before) {
  counts_ = before.size();
  best_.assign((pieces() + 1) * counts_, {});
  for (std::size_t n = 0; n < counts_; ++n) best_[n].cost = before[n];
  for (Starts& starts : starts_)
    for (auto& queue : starts.queues) queue.clear();
  for (std::size_t last = 0; last < pieces(); ++last)
    for (std::size_t w = 0; w < bucket_.ways.size(); ++w) {
      const std::uint8_t gather = bucket_.ways[w].gather;
      PartPrice part;
      if (gather != 0 && gather < prices.size()) part = prices[gather];
      if (gather == 0 || part.open) try_way(w, part, last);
    }
  std::vector<Cost> after(counts_);
  for (std::size_t n = 0; n < counts_; ++n) after[n] = best_[pieces() * counts_ + n].cost;
  return after;
}

std::vector<Read> ReadSearch::reads(std::uint32_t counted) const {
  // Follows the choices backwards.
  std::vector<Read> reads;
  for (std::size_t end = pieces(); end > 0;) {
    const Choice& choice = best_[end * counts_ + counted];
    reads.push_back(read_by(choice.way, choice.extent));
    if (counts_ > 1 && reads.back().gather != 0) --counted;
    end = choice.first;
  }
  std::ranges::sort(reads, {}, [](const Read& read) { return read.span.first_bit; });
  return reads;
}

}  // namespace fxagent
