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
};

/// The exchanges with the least line time. Exact where one frame of each command has room for what
/// is best sent by it, or where one command's `max_parts` alone divides few pieces; where more
/// frames are needed the surplus is at most what one frame of each command has around its parts.
/// `commands`: those that may be used, each named by some way of `buckets`. What no command of them
/// and no other way reads is not in `buckets`. Without a speed of the line the fewest exchanges
/// count, then the fewest characters.
Gathering cheapest_exchanges(const Codec& codec, const LineCost& cost,
                             const std::vector<Bucket>& buckets,
                             const std::vector<GatherCommand>& commands, const Holes& holes);

}  // namespace fxagent
