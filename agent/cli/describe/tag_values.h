// JSON Schemas of the values of a tag. Pure, any thread.
#pragma once

#include <cstdint>
#include <nlohmann/json_fwd.hpp>

#include "agent/config/model.h"

namespace fxagent::contract {

using Json = nlohmann::ordered_json;

enum class Use : std::uint8_t {
  sample,  ///< as the agent publishes it: the range of its type
  command  ///< as a command may have it: also within the tag's `min` and `max`
};
/// Returns the schema of the tag's values, with its labels, and with its description and unit as
/// `description`.
Json value_schema(const TagConfig& tag, Use use);

}  // namespace fxagent::contract
