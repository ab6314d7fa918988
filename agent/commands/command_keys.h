// Which keys a command may have, by its `op`. Pure, any thread.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <string_view>

#include "agent/commands/faults.h"
#include "agent/messages.h"

namespace fxagent {

/// Text of a sender as a detail repeats it: its beginning, in quotes.
std::string in_quotes(std::string_view foreign);

/// A bad_json for each key of `command`, a JSON object, that does not go with `op`, with the target
/// or with `targets`. Without an op only for those that go with none. Null is as good as absent,
/// but for `expect` and `value`: one that got lost on its way (NaN becomes null) must not make a
/// command without a condition of one that had it.
void check_keys(const nlohmann::json& command, std::optional<Op> op, Faults& faults);

}  // namespace fxagent
