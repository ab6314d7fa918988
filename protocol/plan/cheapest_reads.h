// Finds the reads of one space with the least line time. Used only by the planner (plan.h), which
// calls for each space:
//
//   pieces_of(bucket, point, span)        for each point: the runs of bits that no read may tear
//   reduce(bucket)                        once all pieces are in the bucket
//   ReadSearch search(codec, cost, bucket)
//   search.run()                          the least cost
//   search.reads()                        the reads that have it
//
// If reads may be parts of Gathers, the planner runs each search several times, with other prices
// of a part (gathering.h).
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <limits>
#include <optional>
#include <vector>

#include "protocol/plan/plan.h"
#include "protocol/read_way.h"

namespace fxagent {

/// Reads of one space that no plan may contain: those the device refuses, and those that cross a
/// border of the space. A lookup takes logarithmic time.
class Forbidden final {
 public:
  Forbidden() = default;
  /// Collects the `holes` that lie in `space`, and the space's `borders` (AddressSpace::borders()).
  Forbidden(const Holes& holes, std::uint16_t space,
            const std::vector<std::uint32_t>& borders = {});

  /// True if `way` must not make this read. A read that contains a forbidden one is forbidden.
  bool forbids(const ReadWay& way, const Extent& read) const;

 private:
  std::vector<std::uint32_t> cuts_;  ///< ascending
  std::vector<Extent> missing_;      ///< none contains another: starts and ends both ascend
  std::vector<Extent> apart_;        ///< ascending; no two touch
};

/// A space, or of one with several tiers the part of one tier, and what is wanted from it. No read
/// serves two buckets.
struct Bucket {
  std::uint16_t space = 0;
  std::vector<ReadWay> ways;
  Forbidden forbidden;
  std::vector<std::uint32_t> points;  // indices in the caller's list
  std::vector<Span> spans;            // their spans, in the same order
  std::vector<Extent> pieces;         // each must lie whole in one read
};

/// Returns the pieces of a point: the whole point if one read can hold it, otherwise its elements,
/// otherwise its units. Empty if some of it cannot be read at all.
std::vector<Extent> pieces_of(const Bucket& bucket, const Point& point, const Span& span);
/// Sorts the pieces, widens them to what every way reads anyway, and drops those inside another.
/// Afterwards both their starts and their ends ascend.
void reduce(Bucket& bucket);

/// In nanoseconds. kImpossible: no set of reads covers everything.
using Cost = std::int64_t;
inline constexpr Cost kImpossible = std::numeric_limits<Cost>::max();

/// Price of a read as a part of a Gather by one command. It comes on top of the line time of its
/// characters in a Gather that holds only this part, so it may be negative.
struct PartPrice {
  bool open = false;  ///< false: no read becomes a part by this command
  Cost each = 0;
  Cost each_bit = 0;
  bool counted = false;  ///< see ReadSearch::run(); true for at most one command
};
/// Prices by GatherCommand::gather. A command beyond the end is not open.
using PartPrices = std::vector<PartPrice>;

/// Searches one bucket.
class ReadSearch final {
 public:
  /// All arguments must outlive the search.
  ReadSearch(const Codec& codec, const LineCost& cost, const Bucket& bucket);

  /// Returns the least cost at these prices, as a list of one. Without prices every read is an
  /// exchange of its own.
  ///
  /// If a command is counted, costs depend on the number of its parts in all buckets together:
  /// entry n of a list is the least cost with n parts. `before` has the costs of the buckets that
  /// were searched before, and the result includes this bucket.
  std::vector<Cost> run(const PartPrices& prices = {}, const std::vector<Cost>& before = {0});
  /// Returns the reads of the last run() in the order of their first bits. If it counted parts: the
  /// reads with `counted` parts in this bucket and those before it. Call only if their cost is
  /// finite.
  std::vector<Read> reads(std::uint32_t counted = 0) const;

  /// Returns the number of reads weighed by all runs together: a measure of processor time.
  std::size_t weighed() const { return weighed_; }

 private:
  struct Choice {
    Cost cost = kImpossible;  // cost of all reads up to this piece
    std::uint32_t first = 0;  // first piece of the last read
    std::uint8_t way = 0;     // index in Bucket::ways
    Extent extent;
  };
  /// A piece that a read may begin with.
  struct Start {
    std::size_t piece = 0;
    /// Cost of all reads before it, less the price in a read of all bits before it.
    Cost worth = 0;
  };
  /// Candidate starts for one way. They are used if a read by the way costs the same amount more
  /// for each further period, whatever its length. The ranking of two starts then does not depend
  /// on the end of the read: each next piece adds one start and may discard earlier ones for good.
  struct Starts {
    /// In bits; 0: no short period exists, or it is not worth the effort.
    std::uint32_t period = 0;
    Cost each = 0;  ///< cost of one more period
    /// By the offset of the first bit in the period. In each queue worth and piece both ascend.
    std::vector<std::deque<Start>> queues;
  };

  std::size_t pieces() const { return bucket_.pieces.size(); }
  Starts starts_by(std::size_t way);
  /// Returns the cost of a read: sent alone, of the whole exchange; as a part, of the characters of
  /// a Gather that holds only this part.
  Cost price_of(std::size_t way, const Extent& extent);
  /// Tries reads by `way` that end with piece `last`.
  void try_way(std::size_t way, const PartPrice& part, std::size_t last);
  void try_best_starts(std::size_t way, const PartPrice& part, std::size_t last);
  void try_all_starts(std::size_t way, const PartPrice& part, std::size_t last);
  /// Returns nullopt if there is no such read.
  std::optional<Extent> read_of(std::size_t way, std::size_t first, std::size_t last);
  void take(std::size_t way, const PartPrice& part, std::size_t first, std::size_t last,
            const Extent& extent);
  Read read_by(std::uint8_t way, const Extent& extent) const;

  const Codec& codec_;
  const LineCost& cost_;
  const Bucket& bucket_;
  std::vector<std::vector<Cost>> prices_;  ///< by way and length; kImpossible: not known yet
  std::vector<std::vector<std::size_t>> partners_;  ///< by way and piece: the first in one read
  std::vector<Starts> starts_;                      ///< by way
  std::size_t counts_ = 1;                          ///< columns of best_
  std::size_t weighed_ = 0;
  std::vector<Choice> best_;  ///< by pieces done and parts counted
};

}  // namespace fxagent
