// `fxagent describe --schema`: the JSON Schema (draft 2020-12) of every payload. Pure, any thread.
#pragma once

#include <nlohmann/json_fwd.hpp>

#include "agent/config/model.h"

namespace fxagent::contract {

using Json = nlohmann::ordered_json;

/// Returns docs/payloads.schema.json, for any agent. It accepts an object with topics as keys and
/// payloads as values; the topics have the placeholders of the contract.
Json payload_page();
/// The same for the agent of this config, with its topics and tags.
Json payload_page(const Config& config);

/// Returns the schemas of the config's payloads by name: those of any agent, and those of
/// schema_name().
Json schemas_of(const Config& config);

}  // namespace fxagent::contract
