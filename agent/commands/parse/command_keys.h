// Checks the keys of a command against its `op`. Pure, any thread.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <string_view>

#include "agent/commands/parse/faults.h"
#include "agent/handover/command_message.h"

namespace fxagent {

/// Returns the first 64 bytes of a sender's text in quotes, for a detail.
std::string in_quotes(std::string_view foreign);

/// Adds bad_json for each key of `command`, a JSON object, that does not go with `op`, with the
/// target or with `targets`. Without an op, only for unknown keys and keys that no target may have.
/// Null counts as absent, except for `expect` and `value`: a lost condition (NaN becomes null) must
/// not become an unconditional write.
void check_keys(const nlohmann::json& command, std::optional<Op> op, Faults& faults);

}  // namespace fxagent
