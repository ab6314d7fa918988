// The reads with the least line time for what must be read, one space at a time, by dynamic
// programming. The planner's own (plan.h): spaces and points in, reads out.
#pragma once

#include <cstdint>
#include <deque>
#include <limits>
#include <optional>
#include <vector>

#include "protocol/forbidden.h"
#include "protocol/plan.h"

namespace fxagent {

/// The shortest read by `way` that covers `wanted`; nullopt where the way does not reach it or may
/// not carry so much.
std::optional<Extent> fit(const ReadWay& way, const Extent& wanted);
/// Whether reads by `way`, of whatever length, cover `span`.
bool reaches(const ReadWay& way, const Span& span);

/// Everything that is read from one space by ways of one tier. Points are merged inside it only.
struct Bucket {
  std::uint16_t space = 0;
  std::vector<ReadWay> ways;
  Forbidden forbidden;
  std::vector<std::uint32_t> points;  // indices in the caller's list
  std::vector<Span> spans;            // theirs, in the same order
  std::vector<Extent> pieces;         // what must lie whole in one read
};

/// The point's pieces: itself where one read can hold it, else its elements, else its units. Empty
/// where some of it cannot be read at all.
std::vector<Extent> pieces_of(const Bucket& bucket, const Point& point, const Span& span);
/// Sorts the pieces, widens them to what every way reads anyway, and drops those that lie inside
/// another: afterwards both their starts and their ends rise.
void reduce(Bucket& bucket);

/// Nanoseconds; kImpossible: no reads bring it all.
using Cost = std::int64_t;
inline constexpr Cost kImpossible = std::numeric_limits<Cost>::max();

/// What the search takes a part of a Gather to cost beside its own characters.
struct PartPrice {
  bool open = false;  ///< else no part goes by this command
  Cost each = 0;
  Cost each_bit = 0;
};
/// Which reads the search may choose.
struct Terms {
  std::vector<PartPrice> parts;  ///< by GatherCommand::gather; what is not in it is not open
  std::uint8_t counted = 0;      ///< the command whose parts are counted; 0: none are
};

/// The search in one bucket, for one set of terms after the other.
///
/// Only runs of neighbours in start order need to be tried. Take any set of reads, without those
/// inside another, so that starts and ends both rise, and give each piece to the last read that
/// begins at or before it: that read ends no earlier than the one which brought the piece, so it
/// covers it too; and what a read is given this way is a run.
class ReadSearch final {
 public:
  /// All arguments outlive it.
  ReadSearch(const Codec& codec, const LineCost& cost, const Bucket& bucket);

  /// `before`: the least cost of what other buckets need, by the number of parts counted in them;
  /// just {0} where nothing is counted. Returns the same with this bucket's reads.
  std::vector<Cost> run(const Terms& terms, const std::vector<Cost>& before);
  /// The reads of the last run() with `counted` parts up to here, in the order of their first bits;
  /// `counted` becomes that of the buckets before. Only where run() said that it is possible.
  std::vector<Read> reads(std::uint32_t& counted) const;

  /// Reads that all runs together have weighed: what they took of the processor.
  std::size_t weighed() const { return weighed_; }
  std::size_t pieces() const { return bucket_.pieces.size(); }

 private:
  struct Choice {
    Cost cost = kImpossible;  // of all reads up to this piece
    std::uint32_t first = 0;  // the piece that the last read begins with
    std::uint8_t way = 0;     // index in Bucket::ways
    Extent extent;
  };
  /// A piece that a read may begin with.
  struct Start {
    std::size_t piece = 0;
    Cost worth = 0;  ///< cost up to it, less what the bits before it would cost in a read
  };
  /// Where so many bits more cost a read by some way the same, however long it is, the worth of a
  /// start has nothing to do with where the read ends: each next piece is a start more, and some
  /// before it are of no use any longer.
  struct Starts {
    std::uint32_t period = 0;  ///< in bits; 0: there is none that is short, or it is not worth it
    Cost each = 0;             ///< what a period more costs
    /// By the first bit's place in the period: worth rises, and so do the pieces.
    std::vector<std::deque<Start>> queues;
  };

  Starts starts_by(std::size_t way);
  Cost price_of(std::size_t way, const Extent& extent);
  /// Tries reads by the way that bring the pieces up to `last`.
  void try_way(std::size_t way, const PartPrice& part, bool counts, std::size_t last);
  void try_best_starts(std::size_t way, const PartPrice& part, std::size_t last);
  void try_all_starts(std::size_t way, const PartPrice& part, bool counts, std::size_t last);
  /// nullopt: no such read.
  std::optional<Extent> read_of(std::size_t way, std::size_t first, std::size_t last);
  void take(std::size_t way, const PartPrice& part, bool counts, std::size_t first,
            std::size_t last, const Extent& extent);
  Read read_by(std::uint8_t way, const Extent& extent) const;

  const Codec& codec_;
  const LineCost& cost_;
  const Bucket& bucket_;
  std::vector<std::vector<Cost>> prices_;  ///< by way and length; kImpossible: not known yet
  std::vector<std::uint32_t> around_;      ///< by way: characters around parts; 0: not known yet
  std::vector<std::vector<std::size_t>> partners_;  ///< by way and piece: the first in one read
  std::vector<Starts> starts_;                      ///< by way
  std::size_t counts_ = 1;                          ///< columns of best_
  std::size_t weighed_ = 0;
  std::vector<Choice> best_;  ///< by pieces done and parts counted
};

}  // namespace fxagent
