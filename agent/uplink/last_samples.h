// The last values of each group, for the status: its last whole sample, and each tag that a command
// has written since. Each as a row (store/sample_record): 10 to 25 bytes a tag, its name included.
// Uplink thread; what groups() gives may be read on any.
#pragma once

#include "agent/config/config.h"
#include "agent/config/config_difference.h"
#include "agent/messages.h"
#include "agent/status.h"

namespace fxagent {

class LastSamples final {
 public:
  /// `config` outlives it.
  explicit LastSamples(const Config& config) : config_(config) {}

  void add(const Telemetry& message);
  /// The config is that of the change from now on.
  void change(const ConfigChange& change);
  /// Empty until the first add().
  const LastValues& groups() const { return groups_; }

 private:
  const Config& config_;
  LastValues groups_;
};

}  // namespace fxagent
