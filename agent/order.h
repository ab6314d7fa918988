// A command that comes from the page instead of MQTT.
#pragma once

#include <functional>
#include <string>

namespace fxagent {

struct Order {
  std::string device;   ///< its name
  std::string payload;  ///< as on a command topic
  std::string sender;   ///< "page:anna", for the audit
  /// Gets the result as JSON, once. Any thread; must not block.
  std::function<void(const std::string& result)> tell;
};

}  // namespace fxagent
