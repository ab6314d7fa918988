// JSON for people to read.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>

namespace fxagent {

/// Returns the text of `value` with a newline at its end. An object or array that fits into 120
/// characters is on one line.
std::string json_page(const nlohmann::ordered_json& value);

}  // namespace fxagent
