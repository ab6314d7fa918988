#include "agent/cli/exit_status.h"

#include <iostream>
#include <sstream>

namespace fxagent {

int refused(std::string_view prefix, const std::string& why, int status) {
  const std::string before = prefix.empty() ? "" : std::string(prefix) + ": ";
  std::istringstream lines(why);
  for (std::string line; std::getline(lines, line);) std::cerr << before << line << '\n';
  return status;
}

}  // namespace fxagent
