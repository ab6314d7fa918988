// Names of PLC models as users write them, and the protocols that support these models.
#pragma once

#include <string>
#include <string_view>

#include "protocol/catalog.h"

namespace fxagent {

/// True if the protocol supports `model`, spelled as in the catalogue.
bool knows_model(const ProtocolInfo& protocol, std::string_view model);

/// Returns the model of the catalogue that a name means, ignoring case: FX3U for "fx3u-32MT", Q for
/// "Q03UDE". Empty if the name matches none.
std::string_view model_meant(std::string_view said);

/// Returns the error text for a model that `own` does not support; it names the protocols that do.
std::string model_is_not_reached(const ProtocolInfo& own, std::string_view model);

}  // namespace fxagent
