// Sequence numbers with which the samples of each device continue. Uplink thread, or before it
// starts.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "agent/config/model.h"
#include "agent/store/store.h"

namespace fxagent {

/// Returns the number before the first sample, by index in Config::devices. If `store` is null,
/// numbers start at the clock, above every number of an earlier boot unless it was set back. Call
/// once, at the start.
std::vector<std::uint64_t> first_numbers(const Config& config, Store* store, std::int64_t utc_ms);
/// Same for a file that opened later. `found` has the numbers above this run's; 0 for other
/// devices.
std::vector<std::uint64_t> later_numbers(const Config& config,
                                         const std::map<std::string, std::uint64_t>& found);

}  // namespace fxagent
