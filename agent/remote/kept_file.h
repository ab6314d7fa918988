// The kept configs and their file in the store's directory. Saves them, repeats a failed save, and
// watches the first hour of the good config. One thread; calls read and write the file.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

#include "agent/remote/kept_configs.h"
#include "agent/steady_time.h"
#include "agent/store/disk/durable_file.h"

namespace fxagent {

class KeptFile final {
 public:
  /// `boot` is the boot id of the machine.
  explicit KeptFile(std::string boot) : boot_(std::move(boot)) {}

  /// Sets the directory (empty: none) and the agent's base topic. Does not touch the disk.
  void open(const std::string& directory, std::string agent);
  /// Loads the configs that the last run kept. Leaves out those of another agent. Returns the fault
  /// if they cannot be read or are damaged, already logged; otherwise empty.
  std::string load();
  /// Applies judge_last_run() to the configs.
  std::string judge_last_run(std::int64_t now_ms);

  /// Call save() after a change.
  KeptConfigs& configs() { return configs_; }
  const KeptConfigs& configs() const { return configs_; }

  /// Returns empty on success, else the reason; due() then tries again, except without a directory.
  std::string save();
  /// Saves and logs a failure. `what` is the change, "the rollback". Without a directory it logs
  /// nothing: an earlier step has reported that.
  void save_or_log(std::string_view what);
  bool is_unsaved() const { return is_unsaved_; }
  /// Ends the judging of a document, if there is one, and saves that.
  void end_judging();

  /// Watches the good config for an hour, if it is `in_force`: until then, a process that ends
  /// without stop() counts against it. Call save() afterwards.
  void watch(const std::optional<KeptConfig>& in_force, SteadyTime now);
  void end_watch() { watched_until_.reset(); }
  bool is_watched() const { return watched_until_.has_value(); }

  /// Repeats a failed save, and ends the hour.
  void due(SteadyTime now);
  SteadyTime next_wake() const;
  /// Saves that the process was stopped.
  void stop();

  /// Forgets the configs and deletes the file. A failure is logged.
  void forget();
  /// Deletes the file of an earlier run. Returns false if there is none, or if another agent that
  /// runs here may own it.
  bool forget_earlier_run();

 private:
  const std::string boot_;
  std::string agent_;                ///< base topic of the agent
  std::optional<DurableFile> file_;  ///< nullopt: no directory for it
  KeptConfigs configs_;
  bool is_unsaved_ = false;  ///< configs_ is not on disk
  SteadyTime save_again_at_{};
  std::optional<SteadyTime> watched_until_;  ///< end of the hour; nullopt: not watched
};

}  // namespace fxagent
