#include "protocol/plan/plan.h"

#include <algorithm>
#include <deque>
#include <map>
#include <optional>
#include <utility>

#include "protocol/plan/cheapest_reads.h"
#include "protocol/plan/gathering.h"
#include "protocol/value/pack.h"
#include "protocol/value/span.h"

namespace fxagent {
namespace {

/// Returns the reads that cover `span`: from the last read that contains its first bit to the read
/// that contains its last bit.
PointSource source_of(const std::vector<Read>& reads, const Span& span) {
  const auto after = std::ranges::upper_bound(reads, span.first_bit, {},
                                              [](const Read& read) { return read.span.first_bit; });
  auto first = static_cast<std::size_t>(after - reads.begin()) - 1;
  while (first > 0 && reads[first].span.end_bit() <= span.first_bit) --first;
  std::size_t last = first;
  while (last + 1 < reads.size() && reads[last].span.end_bit() < span.end_bit()) ++last;
  return {static_cast<std::uint32_t>(first), static_cast<std::uint32_t>(last - first + 1)};
}

/// Ways and commands of a device after its holes are applied.
class DeviceWays final {
 public:
  DeviceWays(const Codec& codec, std::uint32_t max_block_bytes, const Holes& holes)
      : addresses_(codec.addresses()), max_block_bytes_(max_block_bytes), holes_(holes) {
    for (GatherCommand command : addresses_.gathers()) {
      for (const Holes::GatherLimit& limit : holes.gather_limits)
        if (limit.gather == command.gather)
          command.max_parts = std::min(command.max_parts, limit.parts);
      if (command.max_parts > 0) commands_.push_back(command);
    }
  }

  /// Returns an empty list if the model has no such space.
  const std::vector<ReadWay>& all(std::uint16_t space) {
    const auto [known, fresh] = ways_.try_emplace(space);
    if (fresh) known->second = addresses_.read_ways(space);
    return known->second;
  }

  Bucket bucket(std::uint16_t space, std::uint8_t tier) {
    Bucket out;
    out.space = space;
    for (ReadWay way : all(space)) {
      const GatherCommand* command = command_of(way);
      if (way.tier != tier || (way.gather != 0 && command == nullptr)) continue;
      if (max_block_bytes_ != 0) way.max_bits = std::min(way.max_bits, max_block_bytes_ * 8);
      for (const Holes::Limit& limit : holes_.limits)
        if (limit.space == space) way.max_bits = std::min(way.max_bits, limit.bits);
      way.max_bits = std::max(way.max_bits / way.unit_bits * way.unit_bits, way.unit_bits);
      out.ways.push_back(way);
    }
    out.forbidden = Forbidden(holes_, space, addresses_.borders(space));
    return out;
  }

  /// Returns the commands that the ways of `buckets` use. Limits each frame to the bytes of one
  /// block.
  std::vector<GatherCommand> commands_for(const std::vector<Bucket>& buckets) const {
    std::vector<GatherCommand> out;
    for (GatherCommand command : commands_) {
      std::uint32_t largest = 0;
      for (const Bucket& bucket : buckets)
        for (const ReadWay& way : bucket.ways)
          if (way.gather == command.gather) largest = std::max(largest, way.max_bits);
      if (max_block_bytes_ != 0)
        command.max_bits = std::min(command.max_bits, std::max(max_block_bytes_ * 8, largest));
      // Drops a bit limit that no number of parts can reach.
      if (command.max_bits / command.max_parts >= largest) command.max_bits = kAnySize;
      if (largest > 0) out.push_back(command);
    }
    return out;
  }

 private:
  const GatherCommand* command_of(const ReadWay& way) const {
    const auto found = std::ranges::find(commands_, way.gather, &GatherCommand::gather);
    return found == commands_.end() ? nullptr : &*found;
  }

  const AddressSpace& addresses_;
  const std::uint32_t max_block_bytes_;
  const Holes& holes_;
  std::vector<GatherCommand> commands_;
  std::map<std::uint16_t, std::vector<ReadWay>> ways_;
};

/// Sorts the points into buckets. Points that no way reaches are added to plan.unreachable.
std::vector<Bucket> buckets_of(DeviceWays& device, std::span<const Point> points, Plan& plan) {
  std::map<std::pair<std::uint16_t, std::uint8_t>, Bucket> buckets;
  for (std::uint32_t index = 0; index < points.size(); ++index) {
    const auto span = span_of(points[index]);
    const ReadWay* taken = nullptr;
    if (span)
      for (const ReadWay& way : device.all(span->space))
        if (reaches(way, *span) && (taken == nullptr || way.tier < taken->tier)) taken = &way;
    if (taken == nullptr) {
      plan.unreachable.push_back(index);
      continue;
    }
    const auto [place, fresh] = buckets.try_emplace({span->space, taken->tier});
    Bucket& bucket = place->second;
    if (fresh) bucket = device.bucket(span->space, taken->tier);
    const auto pieces =
        bucket.ways.empty() ? std::vector<Extent>{} : pieces_of(bucket, points[index], *span);
    if (pieces.empty()) {
      plan.refused.push_back(index);
      continue;
    }
    bucket.points.push_back(index);
    bucket.spans.push_back(*span);
    bucket.pieces.insert(bucket.pieces.end(), pieces.begin(), pieces.end());
  }
  std::vector<Bucket> filled;
  for (auto& [key, bucket] : buckets) {
    if (bucket.pieces.empty()) continue;
    reduce(bucket);
    filled.push_back(std::move(bucket));
  }
  return filled;
}

/// Returns the best reads of each bucket, without combining any.
Gathering each_by_itself(const Codec& codec, const LineCost& cost,
                         const std::vector<Bucket>& buckets) {
  Gathering out;
  for (const Bucket& bucket : buckets) {
    ReadSearch search(codec, cost, bucket);
    search.run();
    out.reads.push_back(search.reads());
    out.weighed += search.weighed();
  }
  return out;
}

/// Adds the reads that are sent alone, and orders all by their first reads.
std::vector<std::vector<std::uint32_t>> in_order(std::uint32_t reads,
                                                 std::vector<std::vector<std::uint32_t>> together) {
  std::vector<bool> gathered(reads);
  for (const auto& parts : together)
    for (const std::uint32_t read : parts) gathered[read] = true;
  together.reserve(together.size() + static_cast<std::size_t>(std::ranges::count(gathered, false)));
  for (std::uint32_t read = 0; read < reads; ++read)
    if (!gathered[read]) together.push_back({read});
  std::ranges::sort(together, {}, [](const auto& parts) { return parts.front(); });
  return together;
}

std::size_t equal_neighbours(const std::vector<std::uint32_t>& lengths) {
  std::size_t count = 0;
  for (std::size_t i = 1; i < lengths.size(); ++i) count += lengths[i] == lengths[i - 1] ? 1U : 0U;
  return count;
}

/// Returns the indices of `lengths` in an order with the fewest equal neighbours. Otherwise it
/// keeps the given order as far as possible.
std::vector<std::uint32_t> alternating(const std::vector<std::uint32_t>& lengths) {
  std::map<std::uint32_t, std::deque<std::uint32_t>> left;  // by length
  for (std::uint32_t i = 0; i < lengths.size(); ++i) left[lengths[i]].push_back(i);
  std::vector<std::uint32_t> order;
  while (!left.empty()) {
    auto next = left.end();
    for (auto same = left.begin(); same != left.end(); ++same) {
      if (!order.empty() && same->first == lengths[order.back()]) continue;
      // More than half of the rest: these must begin, or some of them become neighbours.
      const bool must_begin = 2 * same->second.size() > lengths.size() - order.size();
      if (next == left.end() || must_begin || same->second.front() < next->second.front())
        next = same;
      if (must_begin) break;
    }
    if (next == left.end()) next = left.begin();
    order.push_back(next->second.front());
    next->second.pop_front();
    if (next->second.empty()) left.erase(next);
  }
  return order;
}

/// Reorders the exchanges so that neighbours have answers of different length, as far as possible.
/// If answers carry no numbers, a late one is then recognised by its length. The parts of a split
/// point stay close in time: a plan that has one keeps its order. `lengths` are those of the
/// answers.
void tell_neighbours_apart(Plan& plan, const std::vector<std::uint32_t>& lengths) {
  const bool has_split_point =
      std::ranges::any_of(plan.sources, [](const PointSource& source) { return source.count > 1; });
  const std::size_t equal = equal_neighbours(lengths);
  if (equal == 0 || has_split_point) return;
  std::vector<std::uint32_t> ordered;
  std::vector<std::vector<std::uint32_t>> exchanges;
  for (const std::uint32_t e : alternating(lengths)) {
    ordered.push_back(lengths[e]);
    exchanges.push_back(plan.exchanges[e]);
  }
  if (equal_neighbours(ordered) < equal) plan.exchanges = std::move(exchanges);
}

}  // namespace

Plan make_plan(const Codec& codec, std::span<const Point> points, const LineCost& cost,
               std::uint32_t max_block_bytes, const Holes& holes) {
  Plan plan;
  plan.sources.resize(points.size());
  DeviceWays device(codec, max_block_bytes, holes);
  const auto buckets = buckets_of(device, points, plan);
  const auto commands = device.commands_for(buckets);
  Gathering best = commands.empty() ? each_by_itself(codec, cost, buckets)
                                    : cheapest_exchanges(codec, cost, buckets, commands, holes);
  plan.weighed = best.weighed;
  for (std::size_t b = 0; b < buckets.size(); ++b) {
    const Bucket& bucket = buckets[b];
    const auto offset = static_cast<std::uint32_t>(plan.reads.size());
    for (const Read& read : best.reads[b]) plan.reads.push_back({read, {}});
    for (std::size_t i = 0; i < bucket.points.size(); ++i) {
      PointSource source = source_of(best.reads[b], bucket.spans[i]);
      source.first_read += offset;
      plan.sources[bucket.points[i]] = source;
      for (std::uint32_t r = 0; r < source.count; ++r)
        plan.reads[source.first_read + r].points.push_back(bucket.points[i]);
    }
  }
  for (PlannedRead& read : plan.reads) read.points.shrink_to_fit();
  plan.exchanges =
      in_order(static_cast<std::uint32_t>(plan.reads.size()), std::move(best.together));
  std::vector<std::uint32_t> lengths;
  for (const ReadIndices reads : plan.exchanges) {
    const LineLength length = codec.line_length(plan.request(reads));
    plan.line_time += cost.of(length);
    lengths.push_back(length.reply_chars);
  }
  if (codec.after_silence() != Recovery::none) tell_neighbours_apart(plan, lengths);
  return plan;
}

Request Plan::request(ReadIndices which) const {
  if (const Read& only = reads[which[0]].read; which.size() == 1 && only.gather == 0) return only;
  Gather gather;
  gather.parts.reserve(which.size());
  for (const std::uint32_t read : which) gather.parts.push_back(reads[read].read);
  return gather;
}

void Plan::share_out(ReadIndices which, Bytes image, std::span<Bytes> images) const {
  if (which.size() == 1) {
    images[which[0]] = std::move(image);
    return;
  }
  std::size_t at = 0;
  for (const std::uint32_t read : which) {
    const std::size_t bytes = (std::size_t{reads[read].read.span.bits} + 7) / 8;
    const std::size_t end = std::min(at + bytes, image.size());
    images[read].assign(image.begin() + static_cast<std::ptrdiff_t>(at),
                        image.begin() + static_cast<std::ptrdiff_t>(end));
    at = end;
  }
}

std::vector<Span> asked_in(const Plan& plan, ReadIndices which, std::span<const Point> points) {
  std::vector<Span> asked;
  for (const std::uint32_t read : which) {
    const PlannedRead& planned = plan.reads[read];
    for (const std::uint32_t index : planned.points) {
      const Span span = *span_of(points[index]);
      const std::uint32_t first = std::max(span.first_bit, planned.read.span.first_bit);
      const std::uint32_t end = std::min(span.end_bit(), planned.read.span.end_bit());
      if (first < end) asked.push_back({span.space, first, end - first});
    }
  }
  return merged(std::move(asked));
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
    const Span place = *span_of(points[index]);
    const std::uint32_t step = place.bits / points[index].count;
    for (std::uint32_t at = place.first_bit; at < place.end_bit(); at += step) {
      const Extent part{std::max(at, whole.first), std::min(at + step, whole.end)};
      if (part.first < part.end) elements.push_back(part);
    }
  }
  std::ranges::sort(elements, {}, &Extent::first);
  std::optional<Halves> best;
  const std::uint32_t middle = whole.first + span.bits / 2;
  const auto distance = [&](std::uint32_t at) { return at < middle ? middle - at : at - middle; };
  std::uint32_t done = whole.first;  // end of the elements before this one
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
      return fail(ErrorCode::unsupported, point.address.text + " was only partly read");
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
  if (!image) return fail(image);
  return unpack(point, *image, span_of(point)->first_bit);
}

Result<std::vector<Request>> plan_write(const Codec& codec, const Point& point, ByteView image) {
  const auto span = span_of(point);
  if (!span) return fail(span);
  if (!point.address.writable) return refuse(point.address.text + " cannot be written");
  if (const auto allowed = codec.addresses().check_write(*span); !allowed) return fail(allowed);
  if (image.size() != (span->bits + 7) / 8)
    return refuse(point.address.text + " takes " + std::to_string((span->bits + 7) / 8) +
                  " bytes, not " + std::to_string(image.size()));
  std::vector<Request> requests;
  if (span->bits == 1) {
    requests.emplace_back(Force{span->space, span->first_bit, (image[0] & 1) != 0});
    return requests;
  }
  std::uint32_t step = codec.addresses().max_write_bits(span->space);
  if (step == 0) return refuse(point.address.text + " cannot be written with this protocol");
  // Keep elements whole if a frame can hold one and an element consists of whole bytes.
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
