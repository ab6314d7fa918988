// `fxagent schema` and fxagent.json(5): what editors and people read about the keys of a config
// file, made from the key table and the catalogue.
#pragma once

#include <string>

namespace fxagent {

/// Returns config/agent.schema.json: the JSON Schema (draft 7) of a config file, for editors. It
/// accepts every right config. Faults that span several places, such as a link that does not exist,
/// are found by `check` only.
std::string config_schema();

/// Returns the tables of docs/config/keys.md in their order, each with its head: one for each
/// section and, after that of devices, one for each group of protocols with the same keys.
std::string config_tables();

/// Returns the man page of the config file in roff: the keys of each section and each protocol.
std::string config_page(const std::string& version);

}  // namespace fxagent
