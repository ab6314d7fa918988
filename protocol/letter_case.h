// Converts ASCII letters to upper or lower case, independent of the locale.
#pragma once

#include <string>
#include <string_view>

namespace fxagent {

std::string upper(std::string_view text);
std::string lower(std::string_view text);

}  // namespace fxagent
