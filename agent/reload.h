// Applies another config at run time, on a thread of its own: the local file at SIGHUP, and a
// remote config whenever one arrives. Field and uplink adopt only the differences. An invalid
// config changes nothing. The outcome is in the log, in health, in {base}/config/reported, in the
// audit and in the status that the service manager shows.
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <functional>
#include <future>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "agent/config/config_difference.h"
#include "agent/config/config_error.h"
#include "agent/config/model.h"
#include "agent/field/field.h"
#include "agent/handover/outbox.h"
#include "agent/handover/status.h"
#include "agent/remote/remote_config.h"
#include "agent/uplink/publisher.h"

namespace fxagent {

/// Owns one thread. SIGHUP is blocked in every thread of the process, so a signal that arrives
/// early, or while a file is being read, stays pending; several pending signals count as one.
/// wake() sends the same signal to this thread alone.
class Reload final {
 public:
  enum class Begin : std::uint8_t { with_reload, waiting };
  /// Answers the commands for these devices that wait on their way to the field, then calls `done`,
  /// perhaps on another thread.
  using TakeBack =
      std::function<void(const std::vector<std::uint32_t>& devices, std::function<void()> done)>;

  /// `running` is the config in force: the file at `path` with the changes of `remote` applied. All
  /// references must outlive this object. Starts its thread; construct it before the uplink runs.
  /// `with_reload`: hangup_within() has taken a SIGHUP.
  Reload(std::string path, RemoteConfig& remote, std::shared_ptr<const Config> running,
         Field& field, Outbox& outbox, Publisher& publisher, TakeBack take_back, Begin begin);
  /// Calls stop() if necessary and joins the thread. Waits for a read of an unresponsive file.
  ~Reload();

  /// Abandons a reload in progress, except for steps that field and uplink already perform. Call it
  /// before the field stops. Does not wait.
  void stop();
  /// Call after stop(). Returns true if the thread ended within `patience`. Its last act is to
  /// record how a trial was stopped; an unresponsive file or disk may delay it beyond `patience`.
  bool wait_for_end(std::chrono::nanoseconds patience);

 private:
  using Next = RemoteConfig::Next;

  /// Events that the uplink has received and this thread has not yet handled.
  struct News {
    std::optional<std::string> desired;  ///< the newest
    std::optional<bool> connected;
    SteadyTime connected_at{};
  };

  void listen();
  void wake();
  /// Waits for SIGHUP or a timer. True if the signal came from another process, not from wake().
  bool wait();
  void run(Begin begin);
  void look_at_news();
  void reload();
  /// Returns nullopt if the config is rejected (already logged) or the agent is stopping.
  std::optional<Next> wanted();
  void hear(const std::string& desired);
  void take_over(Next next);
  /// Returns false if the reload was stopped before it was complete.
  bool apply(Config config);
  void reject(const ConfigErrors& errors);
  void say(const std::string& state, const ConfigErrors& errors);
  void log_report();
  std::string audit_record() const;
  enum class Log : std::uint8_t { news, always };
  void report(Log when = Log::news);
  void publish_status();

  const std::string path_;
  RemoteConfig& remote_;
  std::shared_ptr<const Config> running_;
  Field& field_;
  Outbox& outbox_;
  Publisher& publisher_;
  const TakeBack take_back_;
  ConfigStatus status_;
  bool has_reported_ = false;
  /// Field and uplink have completed a change, or stop() was called. Shared with the calls that
  /// pass through them, which may outlive the wait.
  const std::shared_ptr<std::atomic<bool>> applied_;
  std::mutex mutex_;
  News news_;  ///< under the mutex
  std::atomic<bool> stopping_ = false;
  std::promise<void> ended_;
  const std::future<void> end_ = ended_.get_future();
  std::thread thread_;
};

/// Takes a SIGHUP before a Reload exists. False: none came within `patience`. Main thread.
bool hangup_within(std::chrono::seconds patience);

/// Logs each error of a rejected config; `path` is the local file.
void log_errors(const ConfigErrors& errors, const std::string& path);

/// Reads and checks the local file, and logs its errors or that it has none. Applies nothing. For
/// the standby of a pair, whose `running` config is that of its start.
void check_local(const Config& running, const std::string& path, const RemoteConfig& remote);

/// Returns the number of files and sockets that the agent may have open at once with this config.
std::size_t files_needed(const Config& config);

/// Maximum number of config errors shown in health.
inline constexpr std::size_t kErrorsInHealth = 10;

}  // namespace fxagent
