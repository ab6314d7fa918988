// A simulated PLC for unit tests.
#pragma once

#include <cassert>
#include <string_view>

#include "tests/sim/model.h"
#include "tests/sim/plant.h"
#include "tests/sim/plc.h"

namespace fxsim {

/// Returns a PLC at time 0. `model` must be one of the simulator, and `plant` the name of a plant
/// (make_plant()).
inline Plc make_plc(std::string_view model = "FX3U", std::string_view plant = "none") {
  const auto* found = find_model(model);
  if (found == nullptr) found = find_mc_model(model);
  assert(found != nullptr);
  return {*found, make_plant(plant), TimePoint{}};
}

/// Returns the bytes of well-formed hexadecimal text.
inline Bytes hex(std::string_view text) { return from_hex(text).value(); }

}  // namespace fxsim
