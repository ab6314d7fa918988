#include "agent/uplink/samples/sample_places.h"

namespace fxagent {

SampleCounts sample_places(const SampleDelivery& samples, const HistoryDelivery& history,
                           const SampleSpool& spool, const DroppedSamples& dropped,
                           const GuardedStore* store) {
  SampleCounts counts;
  const SampleDelivery::Counters out = samples.counters();
  counts.queued = out.queued + spool.gathered() + spool.at_disk();
  counts.in_flight = out.in_flight;
  counts.stored = spool.backlog().rows();
  if (store != nullptr) {
    const GuardedStore::Figures figures = store->figures();
    counts.stored += figures.rows;
    counts.recovered = figures.recovered;
  }
  counts.acknowledged = out.acknowledged + history.acknowledged();
  counts.dropped = dropped.total();
  counts.published = out.published + history.published();
  return counts;
}

}  // namespace fxagent
