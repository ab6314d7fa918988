// Upper and lower case of names: ASCII letters, whatever the locale is.
#pragma once

#include <string>
#include <string_view>

namespace fxagent {

std::string upper(std::string_view text);
std::string lower(std::string_view text);

}  // namespace fxagent
