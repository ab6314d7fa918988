// Decides which reads of a plan are sent alone and which are combined in one frame (Gather), and
// distributes the latter over frames. Used only by the planner (plan.h).
#pragma once

#include <cstdint>
#include <vector>

#include "protocol/plan/cheapest_reads.h"

namespace fxagent {

/// GatherCommand::max_bits of a command without such a limit.
inline constexpr std::uint32_t kAnySize = GatherCommand{}.max_bits;

/// All reads of a plan, with the combined ones.
struct Gathering {
  std::vector<std::vector<Read>> reads;  ///< by bucket, in the order of their first bits
  /// Each entry holds the parts of one Gather: ascending indices among all reads. A read that is in
  /// none of them is sent alone.
  std::vector<std::vector<std::uint32_t>> together;
  std::size_t weighed = 0;  ///< Plan::weighed
};

/// Returns the exchanges with the least line time. Exact in two cases: one frame of each command
/// has room for everything that is best sent by it; or there is one command, only its `max_parts`
/// limits its frames, and there are few pieces. Otherwise the result
/// exceeds the optimum by at most the cost around the parts of one frame of each command. The
/// search ends once no more than 0.4 % could be gained.
///
/// `commands` are the commands that may be used; some way of `buckets` names each. If the speed of
/// the line is unknown, the search minimises the number of exchanges, then the characters.
Gathering cheapest_exchanges(const Codec& codec, const LineCost& cost,
                             const std::vector<Bucket>& buckets,
                             const std::vector<GatherCommand>& commands, const Holes& holes);

}  // namespace fxagent
