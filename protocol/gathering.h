// Which reads of a plan go by themselves, which go together by one frame (Gather), and how they are
// shared out among such frames. The planner's own (plan.h).
#pragma once

#include <cstdint>
#include <vector>

#include "protocol/cheapest_reads.h"

namespace fxagent {

/// All reads of a plan, and those that go together.
struct Gathering {
  std::vector<std::vector<Read>> reads;  ///< by bucket, in the order of their first bits
  /// Each the parts of one Gather, by their number among all reads, rising. Reads that are in none
  /// of them go by themselves.
  std::vector<std::vector<std::uint32_t>> together;
  std::size_t weighed = 0;  ///< Plan::weighed
};

/// The exchanges with the least line time. Exact where one frame of each command has room for what
/// is best sent by it; where one command's `max_parts` alone divides few pieces; and elsewhere to
/// what a frame of each command has around its parts. Nobody looks on where less than 0.4 % could
/// be gained. `commands`: those that may be used, each named by some way of `buckets`. Without a
/// speed of the line the fewest exchanges count, then the fewest characters.
Gathering cheapest_exchanges(const Codec& codec, const LineCost& cost,
                             const std::vector<Bucket>& buckets,
                             const std::vector<GatherCommand>& commands, const Holes& holes);

}  // namespace fxagent
