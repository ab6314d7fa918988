#include "agent/field/bus/bus_doubt.h"

#include <algorithm>

namespace fxagent {

void BusDoubt::found_foreign(SteadyTime now) {
  ++findings_;
  was_out_of_step(now);
  if (!is_doubted()) {
    const bool relapse = doubts_ > 0 && now - ended_ < kRelapse;
    wanted_ = relapse ? std::min(wanted_ * 2, kMostExchanges) : kCleanExchanges;
    ++doubts_;
  }
  exchanges_to_go_ = wanted_;
}

void BusDoubt::exchange_was_clean(SteadyTime now) {
  if (!is_doubted()) return;
  --exchanges_to_go_;
  if (!is_doubted()) ended_ = now;
}

void BusDoubt::exchange_was_unclear() {
  if (is_doubted()) exchanges_to_go_ = wanted_;
}

}  // namespace fxagent
