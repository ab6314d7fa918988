#include "agent/uplink/commands/late_recovery.h"

#include <optional>
#include <utility>

#include "agent/commands/recovery.h"
#include "agent/store/samples/first_numbers.h"

namespace fxagent {

LateRecovery::LateRecovery(const Config& config, Commands& commands, GuardedStore* store,
                           UtcClock utc_ms, NumberAbove number_above)
    : config_(config),
      commands_(commands),
      store_(store),
      utc_ms_(std::move(utc_ms)),
      number_above_(std::move(number_above)) {}

void LateRecovery::join(const std::vector<std::string>& devices) {
  joined_.insert(joined_.end(), devices.begin(), devices.end());
}

void LateRecovery::take_found_late(SteadyTime now) {
  auto late = store_ == nullptr || changing_ ? std::nullopt : store_->take_found_late();
  if (!late) return;
  Recovered known = recover(config_, store_->journal(), std::move(late->ids),
                            std::move(late->unacknowledged), utc_ms_(), now);
  commands_.restore(std::move(known), now, utc_ms_());
  if (number_above_) number_above_(later_numbers(config_, late->numbers));
}

void LateRecovery::recover_joined(SteadyTime now) {
  if (joined_.empty() || store_ == nullptr || store_->hangs()) return;
  Recovered known = recover_of(joined_, config_, store_->journal(), utc_ms_(), now);
  if (store_->hangs()) return;  // the store was not read; try again
  joined_.clear();
  commands_.restore(std::move(known), now, utc_ms_());
}

}  // namespace fxagent
