// Parts of the JSON Schemas of `fxagent describe`. They use only what draft 7 and draft 2020-12
// have in common, except that references go to "#/$defs/". Pure, any thread.
#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <string>

#include "agent/config/model.h"
#include "agent/handover/command_message.h"

namespace fxagent::contract {

using Json = nlohmann::ordered_json;

Json reference(const std::string& name);
/// Accepts what exactly one of the schemas accepts.
Json one_of(Json::array_t schemas);
Json constant(Json value);
/// Accepts nothing.
Json never();
/// "command_write" …
std::string command_schema_name(Op op);
/// Adds a key that `object` does not have. Json's own way searches all keys first, which takes
/// minutes for a plant with 10,000 devices.
void append(Json& object, std::string key, Json value);

inline constexpr Op kOps[]{Op::write, Op::force_on, Op::force_off, Op::read, Op::run, Op::stop};

// ---- values of a tag

enum class Use : std::uint8_t {
  sample,  ///< as the agent publishes it: the range of its type
  command  ///< as a command may have it: also within the tag's `min` and `max`
};
/// Returns the schema of the tag's values, with labels; description and unit are `description`.
Json value_schema(const TagConfig& tag, Use use);

}  // namespace fxagent::contract
