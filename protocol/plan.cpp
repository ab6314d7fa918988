#include "protocol/plan.h"

#include <algorithm>
#include <limits>
#include <map>
#include <numeric>
#include <optional>
#include <utility>

namespace fxagent {
namespace {

std::uint32_t round_up(std::uint32_t value, std::uint32_t step) {
  return (value + step - 1) / step * step;
}

/// What one read would have to bring, and what it would be: [first, end) in bits of the space.
struct Extent {
  std::uint32_t first = 0;
  std::uint32_t end = 0;
};

/// The borders and holes of one space, as bits of it.
struct Forbidden {
  std::vector<std::uint32_t> cuts;
  std::vector<Extent> missing;

  bool holds(const Extent& read) const {
    return std::any_of(cuts.begin(), cuts.end(),
                       [&](std::uint32_t at) { return read.first < at && at < read.end; }) ||
           std::any_of(missing.begin(), missing.end(), [&](const Extent& hole) {
             return read.first <= hole.first && hole.end <= read.end;
           });
  }
};

Forbidden forbidden_in(const Holes& holes, std::uint16_t space) {
  Forbidden out;
  for (const Holes::Cut& cut : holes.cuts)
    if (cut.space == space) out.cuts.push_back(cut.at);
  for (const Span& span : holes.missing)
    if (span.space == space) out.missing.push_back({span.first_bit, span.end_bit()});
  return out;
}

/// The shortest read by `way` that covers `wanted`; nullopt where the way does not reach it or may
/// not carry so much.
std::optional<Extent> fit(const ReadWay& way, const Extent& wanted) {
  if (wanted.first < way.first_bit || wanted.end > way.end_bit) return std::nullopt;
  std::uint32_t first = wanted.first - wanted.first % way.align_bits;
  if (first < way.first_bit) return std::nullopt;
  std::uint32_t bits = round_up(wanted.end - first, way.unit_bits);
  // A unit that would stick out behind the last device is filled from before the first one instead.
  while (bits > way.end_bit - first) {
    const std::uint32_t back = round_up(bits - (way.end_bit - first), way.align_bits);
    if (back > first - way.first_bit) return std::nullopt;
    first -= back;
    bits = round_up(wanted.end - first, way.unit_bits);
  }
  if (bits > way.max_bits) return std::nullopt;
  return Extent{first, first + bits};
}

bool reaches(const ReadWay& way, const Span& span) {
  ReadWay unlimited = way;
  unlimited.max_bits = std::numeric_limits<std::uint32_t>::max();
  return fit(unlimited, {span.first_bit, span.end_bit()}).has_value();
}

bool one_read_holds(const std::vector<ReadWay>& ways, const Forbidden& forbidden,
                    const Extent& wanted) {
  return std::any_of(ways.begin(), ways.end(), [&](const ReadWay& way) {
    const auto read = fit(way, wanted);
    return read && !forbidden.holds(*read);
  });
}

/// Everything that is read from one space by ways of one tier. Points are merged inside it only.
struct Bucket {
  std::vector<ReadWay> ways;
  Forbidden forbidden;
  std::vector<std::uint32_t> points;  // indices in the caller's list
  std::vector<Span> spans;            // theirs, in the same order
  std::vector<Extent> pieces;         // what must lie whole in one read
};

/// The point's pieces: itself where one read can hold it, else its elements, else its units. Empty
/// where some of it cannot be read at all.
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

/// Sorts the pieces, widens them to what every way reads anyway, and drops those that lie inside
/// another: afterwards both their starts and their ends rise.
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

/// The price of reads by one way, by their length.
class Price final {
 public:
  Price(const Codec& codec, const LineCost& cost, const ReadWay& way, std::uint16_t space)
      : codec_(codec),
        cost_(cost),
        way_(way),
        space_(space),
        known_(way.max_bits / way.unit_bits + 1) {}

  std::int64_t of(const Extent& extent) {
    const std::uint32_t bits = extent.end - extent.first;
    std::optional<std::int64_t>& price = known_[bits / way_.unit_bits];
    if (!price)
      price = cost_.of(codec_.line_length(Read{{space_, extent.first, bits}, way_.way})).count();
    return *price;
  }

 private:
  const Codec& codec_;
  const LineCost& cost_;
  const ReadWay& way_;
  std::uint16_t space_;
  std::vector<std::optional<std::int64_t>> known_;
};

/// For each piece the first one that a read may begin with if it is to bring both: nobody asks for
/// more than the way's gap in between.
std::vector<std::size_t> first_partners(const std::vector<Extent>& pieces, std::uint32_t max_gap) {
  std::vector<std::size_t> first(pieces.size(), 0);
  for (std::size_t i = 1; i < pieces.size(); ++i) {
    const std::uint32_t end = pieces[i - 1].end;
    const bool apart = pieces[i].first > end && pieces[i].first - end > max_gap;
    first[i] = apart ? i : first[i - 1];
  }
  return first;
}

struct Choice {
  std::int64_t cost = std::numeric_limits<std::int64_t>::max();  // of all reads up to this piece
  std::size_t first = 0;  // the piece that the last read begins with
  std::uint8_t way = 0;   // index in Bucket::ways
  Extent extent;
};

/// The cheapest reads for the bucket's pieces.
///
/// Only runs of neighbours in start order need to be tried. Take any set of reads, without those
/// inside another, so that starts and ends both rise, and give each piece to the last read that
/// begins at or before it: that read ends no earlier than the one which brought the piece, so it
/// covers it too; and what a read is given this way is a run.
std::vector<Read> cheapest_reads(const Codec& codec, const LineCost& cost, std::uint16_t space,
                                 const Bucket& bucket) {
  const auto& pieces = bucket.pieces;
  std::vector<Choice> best(pieces.size() + 1);
  best[0].cost = 0;
  std::vector<Price> prices;
  std::vector<std::vector<std::size_t>> partners;
  for (const ReadWay& way : bucket.ways) {
    prices.emplace_back(codec, cost, way, space);
    partners.push_back(first_partners(pieces, way.max_gap_bits));
  }
  for (std::size_t last = 0; last < pieces.size(); ++last) {
    Choice& choice = best[last + 1];
    for (std::size_t w = 0; w < bucket.ways.size(); ++w) {
      // Back from the last piece until a read cannot hold them all; then none that begins earlier
      // can.
      for (std::size_t first = last + 1; first-- > partners[w][last];) {
        const auto extent = fit(bucket.ways[w], {pieces[first].first, pieces[last].end});
        if (!extent) break;
        if (bucket.forbidden.holds(*extent)) continue;
        if (best[first].cost == std::numeric_limits<std::int64_t>::max()) continue;
        const std::int64_t total = best[first].cost + prices[w].of(*extent);
        // Of equals the one with fewer reads.
        if (total < choice.cost || (total == choice.cost && first < choice.first))
          choice = {total, first, static_cast<std::uint8_t>(w), *extent};
      }
    }
  }
  std::vector<Read> reads;
  for (std::size_t end = pieces.size(); end > 0; end = best[end].first) {
    const Choice& choice = best[end];
    reads.push_back({{space, choice.extent.first, choice.extent.end - choice.extent.first},
                     bucket.ways[choice.way].way});
  }
  std::sort(reads.begin(), reads.end(),
            [](const Read& a, const Read& b) { return a.span.first_bit < b.span.first_bit; });
  return reads;
}

/// The reads that bring `span`: the last one that holds its first bit, and on until its last bit.
PointSource source_of(const std::vector<Read>& reads, const Span& span) {
  const auto after = std::upper_bound(
      reads.begin(), reads.end(), span.first_bit,
      [](std::uint32_t bit, const Read& read) { return bit < read.span.first_bit; });
  auto first = static_cast<std::size_t>(after - reads.begin()) - 1;
  while (first > 0 && reads[first].span.end_bit() <= span.first_bit) --first;
  std::size_t last = first;
  while (last + 1 < reads.size() && reads[last].span.end_bit() < span.end_bit()) ++last;
  return {static_cast<std::uint32_t>(first), static_cast<std::uint32_t>(last - first + 1)};
}

/// Sorts the points into buckets; those that no way reaches go to the plan's list.
std::map<std::pair<std::uint16_t, std::uint8_t>, Bucket> buckets_of(const Codec& codec,
                                                                    std::span<const Point> points,
                                                                    std::uint32_t max_block_bytes,
                                                                    const Holes& holes,
                                                                    Plan& plan) {
  std::map<std::uint16_t, std::vector<ReadWay>> ways_of;
  std::map<std::pair<std::uint16_t, std::uint8_t>, Bucket> buckets;
  for (std::uint32_t index = 0; index < points.size(); ++index) {
    const auto span = span_of(points[index]);
    const ReadWay* taken = nullptr;
    if (span) {
      const auto [known, fresh] = ways_of.try_emplace(span->space);
      if (fresh) known->second = codec.addresses().read_ways(span->space);
      for (const ReadWay& way : known->second)
        if (reaches(way, *span) && (taken == nullptr || way.tier < taken->tier)) taken = &way;
    }
    if (taken == nullptr) {
      plan.unreachable.push_back(index);
      continue;
    }
    Bucket& bucket = buckets[{span->space, taken->tier}];
    if (bucket.ways.empty()) {
      for (ReadWay way : ways_of[span->space]) {
        if (way.tier != taken->tier) continue;
        if (max_block_bytes != 0) way.max_bits = std::min(way.max_bits, max_block_bytes * 8);
        for (const Holes::Limit& limit : holes.limits)
          if (limit.space == span->space) way.max_bits = std::min(way.max_bits, limit.bits);
        way.max_bits = std::max(way.max_bits / way.unit_bits * way.unit_bits, way.unit_bits);
        bucket.ways.push_back(way);
      }
      bucket.forbidden = forbidden_in(holes, span->space);
      for (const std::uint32_t at : codec.addresses().borders(span->space))
        bucket.forbidden.cuts.push_back(at);
    }
    const auto pieces = pieces_of(bucket, points[index], *span);
    if (pieces.empty()) {
      plan.refused.push_back(index);
      continue;
    }
    bucket.points.push_back(index);
    bucket.spans.push_back(*span);
    bucket.pieces.insert(bucket.pieces.end(), pieces.begin(), pieces.end());
  }
  return buckets;
}

}  // namespace

std::chrono::nanoseconds exchange_time(const Codec& codec, const Request& request,
                                       const LineTiming& timing) {
  const auto one = [&](const Request& asked) {
    const LineLength length = codec.line_length(asked);
    return timing.char_time * (length.request_chars + length.reply_chars + length.closing_chars) +
           timing.turnaround + std::max(timing.gap, codec.quiet_before(timing.char_time)) +
           codec.pause_after(asked);
  };
  const auto enquiry = codec.resync();
  return enquiry && timing.enquires_always ? one(*enquiry) + one(request) : one(request);
}

bool Holes::forbid(const Span& span) const {
  return forbidden_in(*this, span.space).holds({span.first_bit, span.end_bit()});
}

Plan make_plan(const Codec& codec, std::span<const Point> points, const LineCost& cost,
               std::uint32_t max_block_bytes, const Holes& holes) {
  Plan plan;
  plan.sources.resize(points.size());
  auto buckets = buckets_of(codec, points, max_block_bytes, holes, plan);
  for (auto& [key, bucket] : buckets) {
    reduce(bucket);
    const auto reads = cheapest_reads(codec, cost, key.first, bucket);
    const auto offset = static_cast<std::uint32_t>(plan.reads.size());
    for (const Read& read : reads) {
      plan.reads.push_back({read, {}});
      plan.line_time += cost.of(codec.line_length(read));
    }
    for (std::size_t i = 0; i < bucket.points.size(); ++i) {
      PointSource source = source_of(reads, bucket.spans[i]);
      source.first_read += offset;
      plan.sources[bucket.points[i]] = source;
      for (std::uint32_t r = 0; r < source.count; ++r)
        plan.reads[source.first_read + r].points.push_back(bucket.points[i]);
    }
  }
  return plan;
}

std::optional<Halves> halves_of(const Codec& codec, std::span<const Point> points,
                                const PlannedRead& planned) {
  const Span& span = planned.read.span;
  const Extent whole{span.first_bit, span.end_bit()};
  const auto ways = codec.addresses().read_ways(span.space);
  const auto way = std::find_if(ways.begin(), ways.end(), [&](const ReadWay& w) {
    return w.way == planned.read.way && w.first_bit <= whole.first && whole.end <= w.end_bit;
  });
  if (way == ways.end()) return std::nullopt;
  std::vector<Extent> elements;
  for (const std::uint32_t index : planned.points) {
    const auto place = span_of(points[index]);
    if (!place) continue;
    const std::uint32_t step = place->bits / points[index].count;
    for (std::uint32_t at = place->first_bit; at < place->end_bit(); at += step) {
      const Extent part{std::max(at, whole.first), std::min(at + step, whole.end)};
      if (part.first < part.end) elements.push_back(part);
    }
  }
  std::sort(elements.begin(), elements.end(),
            [](const Extent& a, const Extent& b) { return a.first < b.first; });
  std::optional<Halves> best;
  const std::uint32_t middle = whole.first + span.bits / 2;
  const auto distance = [&](std::uint32_t at) { return at < middle ? middle - at : at - middle; };
  std::uint32_t done = whole.first;  // where the elements before this one end
  for (const Extent& element : elements) {
    const std::uint32_t at = element.first - element.first % way->align_bits;
    const auto left = fit(*way, {whole.first, done});
    const bool apart = done > whole.first && done <= at && left && left->end <= at;
    if (apart && (!best || distance(at) < distance(best->right_first)))
      best = Halves{left->end, at};
    done = std::max(done, element.end);
  }
  return best;
}

Result<Bytes> image_of(const Plan& plan, std::span<const Bytes> images, const Point& point,
                       std::size_t index) {
  const PointSource source = index < plan.sources.size() ? plan.sources[index] : PointSource{};
  const auto wanted = span_of(point);
  if (!wanted || source.count == 0 || images.size() < source.first_read + source.count)
    return fail(ErrorCode::unsupported, point.address.text + " is not in the plan");
  const std::uint32_t base = plan.reads[source.first_read].read.span.first_bit;
  Bytes whole;
  for (std::uint32_t r = source.first_read; r < source.first_read + source.count; ++r) {
    const Span& span = plan.reads[r].read.span;
    if (images[r].size() * 8 < span.bits)
      return fail(ErrorCode::unsupported, point.address.text + " was read in part only");
    const std::uint32_t at = span.first_bit - base;
    whole.resize(std::max(whole.size(), (std::size_t{at} + span.bits + 7) / 8));
    insert_bits(whole, at, images[r], span.bits);
  }
  return extract_bits(whole, wanted->first_bit - base, wanted->bits);
}

Result<Value> value_of(const Plan& plan, std::span<const Bytes> images, const Point& point,
                       std::size_t index) {
  const PointSource source = index < plan.sources.size() ? plan.sources[index] : PointSource{};
  if (source.count == 1 && source.first_read < images.size())
    return unpack(point, images[source.first_read],
                  plan.reads[source.first_read].read.span.first_bit);
  const auto image = image_of(plan, images, point, index);
  if (!image) return tl::make_unexpected(image.error());
  return unpack(point, *image, span_of(point)->first_bit);
}

Result<std::vector<Request>> plan_write(const Codec& codec, const Point& point, ByteView image) {
  const auto span = span_of(point);
  if (!span) return tl::make_unexpected(span.error());
  if (!point.address.writable)
    return fail(ErrorCode::bad_request, point.address.text + " cannot be written");
  if (const auto allowed = codec.addresses().check_write(*span); !allowed)
    return tl::make_unexpected(allowed.error());
  if (image.size() != (span->bits + 7) / 8)
    return fail(ErrorCode::bad_request, point.address.text + " takes " +
                                            std::to_string((span->bits + 7) / 8) + " bytes, not " +
                                            std::to_string(image.size()));
  std::vector<Request> requests;
  if (span->bits == 1) {
    requests.emplace_back(Force{span->space, span->first_bit, (image[0] & 1) != 0});
    return requests;
  }
  std::uint32_t step = codec.addresses().max_write_bits(span->space);
  if (step == 0)
    return fail(ErrorCode::bad_request, point.address.text + " is not written by this protocol");
  // Elements stay whole where a frame can hold one and it is made of whole bytes.
  const std::uint32_t element = span->bits / point.count;
  if (element % 8 == 0 && element <= step) step -= step % element;
  const auto borders = codec.addresses().borders(span->space);
  std::uint32_t bits = 0;
  for (std::uint32_t done = 0; done < span->bits; done += bits) {
    const std::uint32_t first = span->first_bit + done;
    bits = std::min(step, span->bits - done);
    for (const std::uint32_t at : borders)
      if (first < at) bits = std::min(bits, at - first);
    requests.emplace_back(Write{{span->space, first, bits}, extract_bits(image, done, bits)});
  }
  return requests;
}

}  // namespace fxagent
