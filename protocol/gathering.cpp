#include "protocol/gathering.h"

#include <algorithm>
#include <optional>
#include <utility>

namespace fxagent {
namespace {

// Exact counting of parts takes time in proportion to this; more is searched by prices.
constexpr std::size_t kMostCounted = 100'000;
// How often the price of a part is changed to make it fill its frames better.
constexpr int kPriceSteps = 8;

/// Cheaper in exchanges before cheaper in characters, where the time says nothing about these.
LineCost with_chars(const LineCost& cost) {
  if (cost.per_char.count() > 0) return cost;
  return {std::chrono::nanoseconds(1), std::chrono::nanoseconds(1 << 30)};
}

class GatherSearch final {
 public:
  GatherSearch(const Codec& codec, const LineCost& cost, const std::vector<Bucket>& buckets,
               const std::vector<GatherCommand>& commands, const Holes& holes)
      : codec_(codec),
        cost_(with_chars(cost)),
        speed_known_(cost.per_char.count() > 0),
        commands_(commands),
        holes_(holes) {
    searches_.reserve(buckets.size());
    for (const Bucket& bucket : buckets) {
      searches_.emplace_back(codec_, cost_, bucket);
      pieces_ += bucket.pieces.size();
    }
  }

  Gathering best() {
    const auto alone = search({});
    const bool one_exchange = alone && alone->exchanges <= 1;
    if (one_exchange && !speed_known_) return std::move(best_);
    for (std::uint32_t which = 1; which < 1U << commands_.size(); ++which) {
      std::vector<const GatherCommand*> open;
      for (std::size_t i = 0; i < commands_.size(); ++i)
        if ((which >> i & 1) != 0) open.push_back(&commands_[i]);
      search_with(open);
    }
    return std::move(best_);
  }

 private:
  /// What a search came to.
  struct Found {
    std::size_t exchanges = 0;
    std::size_t gathers = 0;
    Cost around_parts = 0;  ///< what a Gather takes beside its parts, where there is one
  };

  void search_with(const std::vector<const GatherCommand*>& open) {
    const auto priced = [&](double by_parts, double by_bits, Cost around) {
      Terms terms;
      for (const GatherCommand* command : open) {
        if (terms.parts.size() <= command->gather) terms.parts.resize(command->gather + 1U);
        const auto share = [&](double part, std::uint32_t most) {
          return static_cast<Cost>(part * static_cast<double>(around) / most);
        };
        terms.parts[command->gather] = {true, share(by_parts, command->max_parts),
                                        share(by_bits, command->max_bits)};
      }
      return terms;
    };
    const auto free = search(priced(0, 0, 0));
    // In one frame of each command: nothing is better. Else what a frame takes beside its parts is
    // shared by what fills it.
    if (!free || free->gathers <= open.size()) return;
    const Cost around = free->around_parts;
    search(priced(0.5, 0.5, around));
    search(priced(0, 1, around));
    const auto fair = search(priced(1, 0, around));
    if (open.size() > 1 || !fair) return;
    if (pieces_ * pieces_ * free->gathers * open.front()->max_parts <= kMostCounted)
      count(*open.front(), free->gathers - 1);
    else if (fair->gathers > 1)
      fill(fair->gathers - 1, [&](double parts) { return priced(parts, 0, around); });
  }

  /// Looks for the price of a part that leaves just `gathers` of them.
  template <typename Priced>
  void fill(std::size_t gathers, const Priced& priced) {
    double low = 1;
    double high = 2;
    for (int i = 0; i < kPriceSteps; ++i, high *= 2) {
      const auto found = search(priced(high));
      if (!found) return;
      if (found->gathers <= gathers) break;
      low = high;
    }
    for (int i = 0; i < kPriceSteps; ++i) {
      const double middle = (low + high) / 2;
      const auto found = search(priced(middle));
      if (!found) return;
      (found->gathers <= gathers ? high : low) = middle;
    }
  }

  /// The best with 1, 2 … `most` frames of the command, by counting their parts.
  void count(const GatherCommand& command, std::size_t most) {
    Terms terms;
    terms.parts.resize(command.gather + 1U);
    terms.parts[command.gather].open = true;
    terms.counted = command.gather;
    std::vector<Cost> costs(most * command.max_parts + 1, kImpossible);
    costs[0] = 0;
    for (ReadSearch& bucket : searches_) costs = bucket.run(terms, costs);
    for (std::size_t frames = 1; frames <= most; ++frames) {
      const auto end = costs.begin() + static_cast<std::ptrdiff_t>(frames * command.max_parts + 1);
      const auto cheapest = std::min_element(costs.begin(), end);
      if (*cheapest != kImpossible) consider(static_cast<std::uint32_t>(cheapest - costs.begin()));
    }
  }

  /// nullopt: not everything can be read like this.
  std::optional<Found> search(const Terms& terms) {
    for (ReadSearch& bucket : searches_)
      if (bucket.run(terms, {0}).front() == kImpossible) return std::nullopt;
    return consider(0);
  }

  /// Weighs what the last run of the searches came to, with so many parts counted.
  Found consider(std::uint32_t counted) {
    Gathering found;
    found.reads.resize(searches_.size());
    for (std::size_t i = searches_.size(); i-- > 0;) found.reads[i] = searches_[i].reads(counted);
    std::vector<Read> all;
    for (const auto& of_bucket : found.reads)
      all.insert(all.end(), of_bucket.begin(), of_bucket.end());
    Found about;
    Cost total = 0;
    for (const Read& read : all) {
      if (read.gather != 0) continue;
      total += cost_.of(codec_.line_length(read)).count();
      ++about.exchanges;
    }
    for (const GatherCommand& command : commands_) share_out(command, all, found.together);
    for (const auto& parts : found.together) {
      Gather gather;
      for (const std::uint32_t part : parts) gather.parts.push_back(all[part]);
      total += cost_.of(codec_.line_length(gather)).count();
    }
    about.gathers = found.together.size();
    about.exchanges += about.gathers;
    if (about.gathers > 0) about.around_parts = around(all[found.together.front().front()]);
    if (total < least_) {
      least_ = total;
      best_ = std::move(found);
    }
    return about;
  }

  Cost around(const Read& part) const {
    const LineLength one = codec_.line_length(Gather{{part}});
    const LineLength two = codec_.line_length(Gather{{part, part}});
    return (cost_.of(one) - cost_.per_char * (chars_of(two) - chars_of(one))).count();
  }

  bool is_suspect(const Read& read) const {
    return std::any_of(holes_.suspects.begin(), holes_.suspects.end(),
                       [&](const Span& span) { return overlap(span, read.span); });
  }

  /// Puts the command's parts into as few frames as it takes, or nearly: the largest first, each
  /// into the first frame with room. Suspects go with each other.
  void share_out(const GatherCommand& command, const std::vector<Read>& all,
                 std::vector<std::vector<std::uint32_t>>& together) const {
    std::vector<std::uint32_t> good;
    std::vector<std::uint32_t> suspects;
    for (std::uint32_t i = 0; i < all.size(); ++i)
      if (all[i].gather == command.gather) (is_suspect(all[i]) ? suspects : good).push_back(i);
    GatherCommand fewer = command;
    fewer.max_parts = std::min(command.max_parts, std::max(holes_.most_suspects, 1U));
    pack(command, all, std::move(good), together);
    pack(fewer, all, std::move(suspects), together);
  }

  static void pack(const GatherCommand& command, const std::vector<Read>& all,
                   std::vector<std::uint32_t> parts,
                   std::vector<std::vector<std::uint32_t>>& together) {
    const std::size_t before = together.size();
    std::vector<std::uint32_t> bits_of;
    std::stable_sort(parts.begin(), parts.end(), [&](std::uint32_t a, std::uint32_t b) {
      return all[a].span.bits > all[b].span.bits;
    });
    std::size_t first = 0;  // those before it have no room for anything
    for (const std::uint32_t part : parts) {
      const std::uint32_t bits = all[part].span.bits;
      const auto has_room = [&](std::size_t i) {
        return together[before + i].size() < command.max_parts &&
               bits_of[i] <= command.max_bits - std::min(bits, command.max_bits);
      };
      while (first < bits_of.size() && together[before + first].size() >= command.max_parts)
        ++first;
      std::size_t into = first;
      while (into < bits_of.size() && !has_room(into)) ++into;
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
  const std::vector<GatherCommand>& commands_;
  const Holes& holes_;
  std::vector<ReadSearch> searches_;
  std::size_t pieces_ = 0;
  Gathering best_;
  Cost least_ = kImpossible;
};

}  // namespace

Gathering cheapest_exchanges(const Codec& codec, const LineCost& cost,
                             const std::vector<Bucket>& buckets,
                             const std::vector<GatherCommand>& commands, const Holes& holes) {
  return GatherSearch(codec, cost, buckets, commands, holes).best();
}

}  // namespace fxagent
