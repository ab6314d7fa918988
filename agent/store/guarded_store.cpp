#include "agent/store/guarded_store.h"

#include <utility>

namespace fxagent {

GuardedStore::GuardedStore(Store& store, std::function<void()> wake)
    : store_(store),
      samples_(store.samples(), store.numbers(), guard_),
      journal_(store.journal(), store.audit(), store.started(), guard_),
      guard_(
          store.path(),
          [this] {
            samples_.remember();
            seen_ = read_figures();
          },
          std::move(wake)) {}

GuardedStore::Figures GuardedStore::read_figures() const {
  const StoredSamples& samples = store_.samples();
  return {samples.rows(),     samples.recovered(),   store_.bytes(),
          store_.set_aside(), store_.audit().head(), samples.dropped_by()};
}

void GuardedStore::upkeep(SteadyTime now, std::int64_t utc_ms) {
  if (guard_.has_answered()) {
    // The outcome of the overdue work goes first, then the notes that have waited.
    guard_.resume(store_.state());
    journal_.take_up(samples_.take_up(utc_ms));
  }
  if (hangs() || !store_.note_time(now, utc_ms)) return;
  guard_.run([this, now, utc_ms] { store_.upkeep(now, utc_ms); });
}

std::optional<Store::FoundLate> GuardedStore::take_found_late() {
  return hangs() ? std::nullopt : store_.take_found_late();
}

void GuardedStore::close() {
  if (!hangs()) guard_.run([this] { store_.close(); });
}

}  // namespace fxagent
