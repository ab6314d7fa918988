// `fxagent describe --wot`: the agent as a W3C Thing Description 1.1. Pure, any thread.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string_view>

#include "agent/config/model.h"

namespace fxagent::contract {

/// Returns one Thing with all devices of this config's agent. It is one Thing because a consumer
/// reads one Thing at a time, and because the agent is one client of the broker. `version` is that
/// of the program.
///
/// A tag is a property "press1.temp" and, if it is writable, an action of the same name; a "."
/// keeps the two names apart, because names may have "_" and "-". Everything else is named after
/// its topic: "health", "press1/state". Schemas are those of the messages, as the broker sends
/// them.
nlohmann::ordered_json thing(const Config& config, std::string_view version);

}  // namespace fxagent::contract
