#pragma once

#include "tests/sim/model.h"
#include "tests/sim/plant.h"
#include "tests/sim/plc.h"

namespace fxsim {

/// Returns a PLC of a model that exists, at the time 0, with a plant of that name.
inline Plc make_plc(std::string_view model = "FX3U", std::string_view plant = "none") {
  const auto* found = find_model(model);
  return {found != nullptr ? *found : *find_mc_model(model), make_plant(plant), TimePoint{}};
}

/// Returns the bytes of well-formed hexadecimal text.
inline Bytes hex(std::string_view text) { return from_hex(text).value(); }

}  // namespace fxsim
