// The documents of `fxagent describe`. Pure, any thread.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string_view>

#include "agent/config/model.h"

namespace fxagent::contract {

using Json = nlohmann::ordered_json;

/// --schema: returns docs/payloads.schema.json, the JSON Schema (draft 2020-12) of every payload of
/// any agent, which stands in the program. It accepts an object with topics as keys and payloads as
/// values; the topics have the placeholders of the contract. A payload may have more keys in later
/// versions; a command must not.
Json payload_page();
/// The same for the agent of this config, with its topics and tags.
Json payload_page(const Config& config);

/// Returns the schemas of any agent by name: "agent_state", "sample", "command_write" …
Json payload_schemas();
/// Returns the config's payload schemas by name: those of any agent, and of schema_name().
Json schemas_of(const Config& config);

/// --asyncapi: returns the AsyncAPI 3.0.0 document of this config's agent: its brokers without
/// secrets, a channel for each kind of payload, and what the agent sends and receives there.
/// `version` is that of the program.
Json asyncapi(const Config& config, std::string_view version);

/// --wot: returns a W3C Thing Description 1.1, one Thing with all devices of this config's agent.
/// It is one Thing because a consumer reads one Thing at a time, and because the agent is one
/// client of the broker. `version` is that of the program.
///
/// A tag is a property "press1.temp" and, if it is writable, an action of the same name; a "."
/// keeps the two names apart, because names may have "_" and "-". Everything else is named after
/// its topic: "health", "press1/state". Schemas are those of the messages, as the broker sends
/// them.
Json thing(const Config& config, std::string_view version);

}  // namespace fxagent::contract
