// Reads that a device refuses although its documents allow them. Each refusal of a device teaches
// the agent some (agent/field/poll/hole_map.h), and make_plan() avoids them. Plain data.
#pragma once

#include <cstdint>
#include <vector>

#include "protocol/value/span.h"

namespace fxagent {

struct Holes {
  // ---- for every read, alone or in a Gather

  /// No read may contain bits of `space` on both sides of `at`.
  struct Cut {
    std::uint16_t space = 0;
    std::uint32_t at = 0;
    friend bool operator==(const Cut&, const Cut&) = default;
  };
  /// No read of `space` may be longer than `bits`.
  struct Limit {
    std::uint16_t space = 0;
    std::uint32_t bits = 0;
    friend bool operator==(const Limit&, const Limit&) = default;
  };
  std::vector<Cut> cuts;
  std::vector<Limit> limits;
  std::vector<Span> missing;  ///< no read may contain the whole of one of these

  // ---- for Gathers, which a device refuses as a whole because of one part, or of their number

  /// No Gather by this command may have more parts than `parts`. 0: the device lacks the command.
  struct GatherLimit {
    std::uint8_t gather = 0;
    std::uint32_t parts = 0;
    friend bool operator==(const GatherLimit&, const GatherLimit&) = default;
  };
  std::vector<GatherLimit> gather_limits;
  std::vector<Span> never_gathered;  ///< no Gather may touch one of these
  /// Spans of refused Gathers, until it is known which part was the cause. A Gather that touches a
  /// suspect consists only of suspects, at most `most_suspects`: the others must not fail with it.
  std::vector<Span> suspects;
  std::uint32_t most_suspects = 1;
  /// Largest number of parts of any other Gather, in a plan that reads a suspect. Other plans have
  /// no such limit: the suspects may belong to a group that is read once an hour.
  std::uint32_t most_others = 0xFFFFFFFF;
};

}  // namespace fxagent
