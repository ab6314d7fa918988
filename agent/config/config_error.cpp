#include "agent/config/config_error.h"

namespace fxagent {

std::string to_string(const ConfigError& error, std::string_view file) {
  std::string text(file);
  if (error.line > 0) text += ":" + std::to_string(error.line);
  text += ": ";
  if (!error.pointer.empty()) text += error.pointer + ": ";
  return text + error.text;
}

}  // namespace fxagent
