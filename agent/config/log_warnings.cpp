#include "agent/config/log_warnings.h"

#include <utility>

#include "agent/config/machine.h"
#include "agent/log/log.h"

namespace fxagent {

void log_warnings(Config& config) {
  for (const std::string& warning : std::exchange(config.warnings, {}))
    log::warn("config", {{"note", warning}});
  for (const ConfigError& secret : exposed_secrets(config))
    log::warn("config", {{"note", secret.pointer + ": " + secret.text}});
}

}  // namespace fxagent
