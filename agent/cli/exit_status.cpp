#include "agent/cli/exit_status.h"

#include <iostream>
#include <sstream>

namespace fxagent {

int refused(std::string_view command, const std::string& why, int status) {
  const std::string prefix = command.empty() ? "" : std::string(command) + ": ";
  std::istringstream lines(why);
  for (std::string line; std::getline(lines, line);) std::cerr << prefix << line << '\n';
  return status;
}

}  // namespace fxagent
