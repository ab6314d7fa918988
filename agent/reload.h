// Reads the config again at SIGHUP, on a thread of its own, and has field and uplink take over what
// differs. A wrong file changes nothing. What became of it stands in the log, in health and in the
// status that the service manager shows.
#pragma once

#include <atomic>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "agent/config/config.h"
#include "agent/config/config_difference.h"
#include "agent/field/field.h"
#include "agent/outbox.h"
#include "agent/status.h"
#include "agent/uplink/publisher.h"

namespace fxagent {

/// Needs a thread. SIGHUP is blocked in every thread of the process, so that one that comes early
/// or while a file is being read waits for its turn; several that wait are one.
class Reload final {
 public:
  /// `running` is in force, read from `path`. All references outlive it. Starts its thread; the
  /// uplink may not run yet.
  Reload(std::string path, std::shared_ptr<const Config> running, Field& field, Outbox& outbox,
         Publisher& publisher);
  /// Stops, if stop() was not called, and waits for the end of its thread: where a file that does
  /// not answer is being read, for as long as that takes.
  ~Reload();

  /// A reload that is under way goes no further than field and uplink take it by themselves. Before
  /// the field is stopped; waits for nothing.
  void stop();

 private:
  class Turn;
  using Errors = std::vector<ConfigError>;

  void run();
  void reload();
  /// Nothing: it is wrong, and that was said.
  std::optional<ConfigChange> wanted();
  void apply(ConfigChange change);
  void reject(const Errors& errors);
  void say(const std::string& state, const Errors& errors);

  const std::string path_;
  std::shared_ptr<const Config> running_;
  Field& field_;
  Outbox& outbox_;
  Publisher& publisher_;
  ConfigStatus status_;
  const std::shared_ptr<Turn> turn_;
  std::atomic<bool> stopping_ = false;
  std::thread thread_;
};

/// Where health has no room for more.
inline constexpr std::size_t kErrorsInHealth = 10;

}  // namespace fxagent
