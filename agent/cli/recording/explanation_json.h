// The JSON of an explained frame, for `decode` and `replay`.
#pragma once

#include <nlohmann/json_fwd.hpp>

#include "protocol/codec.h"

namespace fxagent {

nlohmann::ordered_json explanation_json(const Explanation& frame);

}  // namespace fxagent
