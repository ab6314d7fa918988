// Where the samples of one session are.
#pragma once

#include "agent/handover/status.h"
#include "agent/store/guarded_store.h"
#include "agent/uplink/samples/dropped_samples.h"
#include "agent/uplink/samples/history_delivery.h"
#include "agent/uplink/samples/sample_delivery.h"
#include "agent/uplink/samples/sample_spool.h"

namespace fxagent {

/// Counts the samples by location; `collected` and `suppressed` are left to the caller. `store` is
/// null if there is no store. Uplink thread.
SampleCounts sample_places(const SampleDelivery& samples, const HistoryDelivery& history,
                           const SampleSpool& spool, const DroppedSamples& dropped,
                           const GuardedStore* store);

}  // namespace fxagent
