// With which sequence number the samples of each device go on. Uplink thread, or before it starts.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "agent/config/config.h"
#include "agent/store/guarded_store.h"
#include "agent/store/store.h"

namespace fxagent {

/// By index in Config::devices: the number before the first sample. `store` null: numbers begin at
/// the clock, above every number of an earlier boot unless that was set back. Once, at the start.
std::vector<std::uint64_t> first_numbers(const Config& config, Store* store, std::int64_t utc_ms);
/// The same of a file that opened later: only where its numbers are above this run's, else 0.
std::vector<std::uint64_t> later_numbers(const Config& config,
                                         const std::map<std::string, std::uint64_t>& found);

/// The same for devices that begin later in the run, by their names. The field knows better if the
/// device was there before.
std::vector<std::uint64_t> numbers_to_join(const std::vector<std::string>& devices,
                                           GuardedStore* store, std::int64_t utc_ms);

}  // namespace fxagent
