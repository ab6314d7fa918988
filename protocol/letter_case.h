// Upper and lower case of ASCII letters, independent of the locale.
#pragma once

#include <string>
#include <string_view>

namespace fxagent {

std::string upper(std::string_view text);
std::string lower(std::string_view text);
char lower(char letter);
bool equal_but_for_case(std::string_view a, std::string_view b);

}  // namespace fxagent
