// A number with its noun.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

namespace fxagent {

/// Returns "1 tag", "0 tags", "2 tags".
inline std::string counted(std::uint64_t number, std::string_view noun) {
  return std::to_string(number) + " " + std::string(noun) + (number == 1 ? "" : "s");
}

}  // namespace fxagent
