// Steps of Codec::encode() that several protocols share.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "protocol/codec.h"

namespace fxagent {

/// Returns the force as a write of its single bit, by the same way.
Write write_of(const Force& force);

/// Returns the one of `ways` that has this number and reaches `span`, whose device is `name`.
/// Errors: bad_request if it cannot read exactly this span; unsupported if there is none: "D0: 16
/// bits cannot be `how` on this model".
Result<ReadWay> way_for(const std::vector<ReadWay>& ways, std::uint8_t number, const Span& span,
                        const std::string& name, std::string_view how);

}  // namespace fxagent
