// Names of PLCs as people write them, and the protocols that know them.
#pragma once

#include <string>
#include <string_view>

#include "protocol/catalog.h"

namespace fxagent {

/// Whether `model`, as the catalogue spells it, is one of the protocol's.
bool knows_model(const ProtocolInfo& protocol, std::string_view model);

/// The model of the catalogue that a name means in any case, FX3U of "fx3u-32MT" and Q of "Q03UDE";
/// empty: none that can be told.
std::string_view model_meant(std::string_view said);

/// The error text where `own` does not know a model of the catalogue: which protocols do.
std::string model_is_not_reached(const ProtocolInfo& own, std::string_view model);

}  // namespace fxagent
