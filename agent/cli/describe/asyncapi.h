// `fxagent describe --asyncapi`: the agent as an AsyncAPI 3.0.0 document. Pure, any thread.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string_view>

#include "agent/config/model.h"

namespace fxagent::contract {

/// Returns the document of this config's agent: its brokers without secrets, a channel for each
/// kind of payload, and what the agent sends and receives there. `version` is that of the program.
nlohmann::ordered_json asyncapi(const Config& config, std::string_view version);

}  // namespace fxagent::contract
