// Recovers what earlier runs left, when it becomes known only during this run: of devices that a
// config change adds, and of a store that was not available at the start. Uplink thread. Time is an
// argument.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "agent/commands/commands.h"
#include "agent/config/model.h"
#include "agent/steady_time.h"
#include "agent/store/guarded_store.h"

namespace fxagent {

class LateRecovery final {
 public:
  using UtcClock = std::function<std::int64_t()>;
  using NumberAbove = std::function<void(std::vector<std::uint64_t>)>;

  /// All references outlive the object. `store` is null if there is no store. `number_above` is
  /// called when a store has opened late, with the last sequence number of each device; it may be
  /// empty.
  LateRecovery(const Config& config, Commands& commands, GuardedStore* store, UtcClock utc_ms,
               NumberAbove number_above);

  /// A config change begins. Until it ends, nothing is taken from a store that opens: rows
  /// recovered for a device that ends would come too late.
  void begin_change() { changing_ = true; }
  void end_change() { changing_ = false; }
  /// Adds devices that were in no config of this run before.
  void join(const std::vector<std::string>& devices);

  /// Recovers the contents of a store that has opened late.
  void take_found_late(SteadyTime now);
  /// Recovers what the joined devices have in the store. Tries again later if the store hangs.
  void recover_joined(SteadyTime now);

 private:
  const Config& config_;
  Commands& commands_;
  GuardedStore* const store_;
  const UtcClock utc_ms_;
  const NumberAbove number_above_;
  std::vector<std::string> joined_;  ///< devices whose earlier runs are to be recovered
  bool changing_ = false;
};

}  // namespace fxagent
