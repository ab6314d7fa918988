// Payloads of Sparkplug as their documents print them.
#pragma once

#include <sstream>
#include <string>

namespace fxagent::test {

/// Converts "02 30 03" to bytes.
inline std::string bytes(const std::string& hex) {
  std::istringstream words(hex);
  std::string out;
  for (unsigned value = 0; words >> std::hex >> value;) out += static_cast<char>(value);
  return out;
}

}  // namespace fxagent::test
