// What the store says at the start: the numbers and the ids that the field goes on with, and the
// results that nobody has been told of yet.
#pragma once

#include <cstdint>
#include <vector>

#include "agent/config.h"
#include "agent/messages.h"
#include "agent/uplink/store.h"

namespace fxagent {

struct Recall {
  Recollection field;
  /// To be published: results that the broker had not acknowledged, and the outcome, written into
  /// the journal here, of each order that the end of the agent left without one, but for those in
  /// field.left_behind.
  std::vector<CommandResult> untold;
};

/// Before the field and the uplink are started. `store` null: numbers begin at the clock, above
/// every number of an earlier boot unless that was set back, and no id is known.
Recall recall(const Config& config, Store* store, std::int64_t utc_ms, SteadyTime now);
/// The same for a file that opened later: numbers only where they are above this run's, else 0.
Recall recall(const Config& config, Store& store, Store::FoundLate found, std::int64_t utc_ms,
              SteadyTime now);

}  // namespace fxagent
