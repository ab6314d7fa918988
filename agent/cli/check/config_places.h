// Places in a config file of findings that are made after reading it.
#pragma once

#include <memory>
#include <string>
#include <string_view>

#include "agent/config/json/tree.h"

namespace fxagent {

class ConfigPlaces {
 public:
  /// `text` is that of the config. It must outlive the object.
  explicit ConfigPlaces(std::string_view text);

  /// Returns the line of the value at a JSON pointer, or of the nearest section around it if the
  /// value is absent. Returns 0 if the text is no config.
  int line(std::string_view pointer) const;

  /// Returns the pointer of a device, such as "/devices/3"; "/devices" if its entry makes several
  /// devices.
  std::string device(std::string_view name) const;

 private:
  std::unique_ptr<const ConfigTree> tree_;  ///< nullptr: the text is not JSON
};

}  // namespace fxagent
