// Last values of each group, for the status: its last whole sample, and each tag that a command has
// written since. Each is a row (store/sample_record) of 10 to 25 bytes per tag, including its name.
// Uplink thread; the result of groups() may be read on any thread.
#pragma once

#include "agent/config/config_difference.h"
#include "agent/config/model.h"
#include "agent/handover/status.h"
#include "agent/handover/telemetry.h"

namespace fxagent {

class LastSamples final {
 public:
  /// `config` outlives the object.
  explicit LastSamples(const Config& config) : config_(config) {}

  void add(const Telemetry& message);
  /// Adapts to a config change, which `config` already contains.
  void change(const ConfigChange& change);
  /// Empty until the first add().
  const LastValues& groups() const { return groups_; }

 private:
  const Config& config_;
  LastValues groups_;
};

}  // namespace fxagent
