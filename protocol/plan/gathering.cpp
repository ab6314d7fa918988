#include "protocol/plan/gathering.h"

#include <algorithm>
#include <optional>
#include <utility>

#include "protocol/value/span.h"

namespace fxagent {
namespace {

// The time of exact counting grows with this product. Larger plans are searched by prices.
constexpr std::size_t kMostCounted = 100'000;
// Number of price changes of a part tried to fill its frames better.
constexpr int kPriceSteps = 6;
// Later searches are skipped once this many reads have been weighed.
constexpr std::size_t kMostWeighed = 1'000'000;
// The search ends when less than 1/256 of the line time could be gained.
constexpr Cost kWorthwhile = 256;

/// Costs if the speed of the line is unknown: an exchange costs more than all characters together.
constexpr Cost kExchange = Cost{1} << 30;
constexpr Cost kAllCharacters = Cost{1} << 24;
LineCost with_chars(const LineCost& cost) {
  if (cost.per_char.count() > 0) return cost;
  return {std::chrono::nanoseconds(1), std::chrono::nanoseconds(kExchange)};
}

class GatherSearch final {
 public:
  GatherSearch(const Codec& codec, const LineCost& cost, const std::vector<Bucket>& buckets,
               const std::vector<GatherCommand>& commands, const Holes& holes)
      : codec_(codec),
        cost_(with_chars(cost)),
        speed_known_(cost.per_char.count() > 0),
        holes_(holes),
        suspects_(merged(holes.suspects)) {
    searches_.reserve(buckets.size());
    for (const Bucket& bucket : buckets) {
      searches_.emplace_back(codec_, cost_, bucket);
      pieces_ += bucket.pieces.size();
      for (const Extent& piece : bucket.pieces)
        reads_suspects_ = reads_suspects_ || is_suspect(span_in(bucket, piece));
    }
    for (const GatherCommand& command : commands) commands_.push_back(measured(command, buckets));
  }

  Gathering best() {
    look_for_best();
    best_.weighed = weighed() + looks_;
    return std::move(best_);
  }

 private:
  struct Command : GatherCommand {
    Cost around_parts = 0;  ///< cost of one of its frames without the parts
    Cost around_chars = 0;  ///< the characters' share of it
  };
  /// Result of a search.
  struct Found {
    Cost least = 0;  ///< lower bound for every plan at these prices
    std::size_t gathers = 0;
  };

  void look_for_best() {
    search({});
    if (!speed_known_ && least_ / kExchange <= 1) return;
    // All commands first: if they gain nothing, no subset does.
    for (std::uint32_t which = (1U << commands_.size()) - 1; which > 0; --which) {
      if (!best_.together.empty() && is_enough()) break;
      std::vector<const Command*> open;
      for (std::size_t i = 0; i < commands_.size(); ++i)
        if ((which >> i & 1) != 0) open.push_back(&commands_[i]);
      if (!search_with(open) && open.size() == commands_.size()) break;
    }
  }

  /// Measures what is around the parts with the shortest ones: a frame may have no room for two
  /// of another length. If no frame has room for two, all of a frame with one part counts.
  Command measured(const GatherCommand& command, const std::vector<Bucket>& buckets) const {
    LineLength one;
    std::uint32_t part_chars = 0;
    for (const Bucket& bucket : buckets)
      for (const ReadWay& way : bucket.ways) {
        if (way.gather != command.gather || part_chars != 0) continue;
        const std::uint32_t first = (way.first_bit + way.align_bits - 1) / way.align_bits;
        const Read part{{bucket.space, first * way.align_bits, way.unit_bits}, way.way, way.gather};
        one = codec_.line_length(Gather{{part}});
        const std::uint32_t two = codec_.line_length(Gather{{part, part}}).planned_chars();
        if (two != 0) part_chars = two - one.planned_chars();
      }
    const std::chrono::nanoseconds parts = cost_.per_char * part_chars;
    return {command, (cost_.of(one) - parts).count(),
            (cost_.per_char * one.planned_chars() - parts).count()};
  }

  std::size_t weighed() const {
    std::size_t reads = 0;
    for (const ReadSearch& bucket : searches_) reads += bucket.weighed();
    return reads;
  }
  /// True if the search has reached its limit and ends with the best plan so far.
  bool is_enough() const { return weighed() > kMostWeighed; }

  /// True if a plan that costs `least` or more could be much better than the best so far.
  bool may_gain(Cost least) const {
    if (least_ == kImpossible) return true;
    if (speed_known_) return least_ - least > least / kWorthwhile;
    return least_ / kExchange > (least + kExchange - kAllCharacters) / kExchange;
  }

  /// Adds to each part its share of the cost around the parts of a frame: by the number of parts
  /// that a frame holds, by their bits, or by a mix of both.
  static PartPrices priced(const std::vector<const Command*>& open, double by_parts,
                           double by_bits) {
    PartPrices prices;
    for (const Command* command : open) {
      if (prices.size() <= command->gather) prices.resize(command->gather + 1U);
      const auto around = static_cast<double>(command->around_parts);
      const bool any_size = command->max_bits == kAnySize;
      const double each = (any_size ? by_parts + by_bits : by_parts) * around / command->max_parts;
      const double each_bit = (any_size ? 0 : by_bits) * around / command->max_bits;
      prices[command->gather] = {true, static_cast<Cost>(each) - command->around_chars,
                                 static_cast<Cost>(each_bit)};
    }
    return prices;
  }

  /// Returns false if nothing can be gained by these commands or by fewer of them.
  bool search_with(const std::vector<const Command*>& open) {
    const auto free = search(priced(open, 0, 0));
    if (!free || free->gathers == 0) return false;
    Cost least_frame = kImpossible;
    for (const Command* command : open) least_frame = std::min(least_frame, command->around_parts);
    if (!may_gain(free->least + least_frame)) return false;
    // One frame of each command cannot be improved. Otherwise the cost around the parts is shared
    // by whatever fills the frame, so the price is a lower bound of what the frames cost.
    if (free->gathers <= open.size()) return true;
    const auto fair = search(priced(open, 1, 0));
    if (!fair || !may_gain(fair->least)) return true;
    for (const double by_parts : {0.5, 0.0}) {
      if (is_enough()) return true;
      const auto found = search(priced(open, by_parts, 1 - by_parts));
      if (found && !may_gain(found->least)) return true;
    }
    if (open.size() > 1 || is_enough()) return true;
    if (pieces_ * pieces_ * free->gathers * open.front()->max_parts <= kMostCounted)
      count(*open.front(), free->gathers - 1);
    else if (fair->gathers > 0)
      fill(open, fair->gathers);
    return true;
  }

  /// Searches for the price of a part, as a multiple of its share, that leaves exactly `gathers`
  /// frames, and for the one that leaves one frame fewer.
  void fill(const std::vector<const Command*>& open, std::size_t gathers) {
    narrow(open, gathers, 0, 1);
    double high = 2;
    for (int i = 0; i < kPriceSteps && !is_enough(); ++i, high *= 2)
      if (const auto found = search(priced(open, high, 0)); !found || found->gathers < gathers)
        break;
    if (gathers > 1) narrow(open, gathers - 1, high / 2, high);
  }
  /// The price `low` leaves more than `gathers` frames; `high` does not.
  void narrow(const std::vector<const Command*>& open, std::size_t gathers, double low,
              double high) {
    for (int i = 0; i < kPriceSteps && !is_enough(); ++i) {
      const double middle = (low + high) / 2;
      const auto found = search(priced(open, middle, 0));
      if (!found) return;
      (found->gathers <= gathers ? high : low) = middle;
    }
  }

  /// Finds the best plan with 1, 2 … `most` frames of the command, by counting their parts.
  void count(const Command& command, std::size_t most) {
    PartPrices prices(command.gather + 1U);
    prices[command.gather] = {.open = true, .each = -command.around_chars, .counted = true};
    std::vector<Cost> costs(most * command.max_parts + 1, kImpossible);
    costs[0] = 0;
    for (ReadSearch& bucket : searches_) costs = bucket.run(prices, costs);
    for (std::size_t frames = 1; frames <= most; ++frames) {
      const auto end = costs.begin() + static_cast<std::ptrdiff_t>(frames * command.max_parts + 1);
      const auto cheapest = std::min_element(costs.begin(), end);
      if (*cheapest != kImpossible) consider(static_cast<std::uint32_t>(cheapest - costs.begin()));
    }
  }

  /// Returns nullopt if no plan at these prices reads everything.
  std::optional<Found> search(const PartPrices& prices) {
    Found found;
    for (ReadSearch& bucket : searches_) {
      const Cost cost = bucket.run(prices).front();
      if (cost == kImpossible) return std::nullopt;
      found.least += cost;
    }
    found.gathers = consider(0);
    return found;
  }

  /// Builds the plan of the last run with `counted` parts and keeps it if it is the best so far.
  /// Returns its number of Gathers.
  std::size_t consider(std::uint32_t counted) {
    Gathering found;
    found.reads.resize(searches_.size());
    for (std::size_t i = searches_.size(); i-- > 0;) {
      found.reads[i] = searches_[i].reads(counted);
      if (counted > 0)
        counted -= static_cast<std::uint32_t>(std::ranges::count_if(
            found.reads[i], [](const Read& read) { return read.gather != 0; }));
    }
    std::vector<Read> all;
    for (const auto& of_bucket : found.reads)
      all.insert(all.end(), of_bucket.begin(), of_bucket.end());
    Cost total = 0;
    for (const Read& read : all)
      if (read.gather == 0) total += cost_.of(codec_.line_length(read)).count();
    for (const Command& command : commands_) share_out(command, all, found.together);
    for (const auto& parts : found.together) {
      Gather gather;
      for (const std::uint32_t part : parts) gather.parts.push_back(all[part]);
      total += cost_.of(codec_.line_length(gather)).count();
    }
    const std::size_t gathers = found.together.size();
    if (total < least_) {
      least_ = total;
      best_ = std::move(found);
    }
    return gathers;
  }

  static Span span_in(const Bucket& bucket, const Extent& piece) {
    return {bucket.space, piece.first, piece.end - piece.first};
  }

  bool is_suspect(const Span& span) const {
    const auto after = std::partition_point(suspects_.begin(), suspects_.end(), [&](const Span& s) {
      return s.space != span.space ? s.space < span.space : s.end_bit() <= span.first_bit;
    });
    return after != suspects_.end() && overlap(*after, span);
  }

  /// Puts the parts of the command into a nearly minimal number of frames: the largest first, each
  /// into the first frame with room. Suspects are kept apart from the others.
  void share_out(const GatherCommand& command, const std::vector<Read>& all,
                 std::vector<std::vector<std::uint32_t>>& together) {
    std::vector<std::uint32_t> good;
    std::vector<std::uint32_t> suspects;
    for (std::uint32_t i = 0; i < all.size(); ++i)
      if (all[i].gather == command.gather) (is_suspect(all[i].span) ? suspects : good).push_back(i);
    const auto at_most = [&](std::uint32_t parts) {
      GatherCommand fewer = command;
      fewer.max_parts = std::min(command.max_parts, std::max(parts, 1U));
      return fewer;
    };
    pack(reads_suspects_ ? at_most(holes_.most_others) : command, all, std::move(good), together);
    pack(at_most(holes_.most_suspects), all, std::move(suspects), together);
  }

  void pack(const GatherCommand& command, const std::vector<Read>& all,
            std::vector<std::uint32_t> parts, std::vector<std::vector<std::uint32_t>>& together) {
    const std::size_t before = together.size();
    std::vector<std::uint32_t> bits_of;
    std::stable_sort(parts.begin(), parts.end(), [&](std::uint32_t a, std::uint32_t b) {
      return all[a].span.bits > all[b].span.bits;
    });
    const auto is_full = [&](std::size_t i) {
      return together[before + i].size() >= command.max_parts;
    };
    std::size_t first = 0;  // frames before it have no room at all
    std::size_t into = 0;   // frames before it have no room for a part of this size
    std::uint32_t bits = 0;
    for (const std::uint32_t part : parts) {
      while (first < bits_of.size() && is_full(first)) ++first;
      if (all[part].span.bits != bits) into = first;
      bits = all[part].span.bits;
      const std::uint32_t room = command.max_bits - std::min(bits, command.max_bits);
      while (into < bits_of.size() && (is_full(into) || bits_of[into] > room)) ++into, ++looks_;
      if (into == bits_of.size()) {
        together.emplace_back();
        bits_of.push_back(0);
      }
      together[before + into].push_back(part);
      bits_of[into] += bits;
    }
    for (std::size_t i = before; i < together.size(); ++i)
      std::sort(together[i].begin(), together[i].end());
  }

  const Codec& codec_;
  const LineCost cost_;
  const bool speed_known_;
  const Holes& holes_;
  const std::vector<Span> suspects_;  ///< by space and place
  bool reads_suspects_ = false;
  std::vector<Command> commands_;
  std::vector<ReadSearch> searches_;
  std::size_t pieces_ = 0;
  Gathering best_;
  Cost least_ = kImpossible;
  std::size_t looks_ = 0;  ///< frames checked for room
};

}  // namespace

Gathering cheapest_exchanges(const Codec& codec, const LineCost& cost,
                             const std::vector<Bucket>& buckets,
                             const std::vector<GatherCommand>& commands, const Holes& holes) {
  return GatherSearch(codec, cost, buckets, commands, holes).best();
}

}  // namespace fxagent
