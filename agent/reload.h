// Takes over another config, on a thread of its own: at SIGHUP the local file as it is then, and at
// any time a remote config. Field and uplink take over what differs. A wrong one changes
// nothing. What became of it stands in the log, in health, in {base}/config/reported, in the audit
// and in the status that the service manager shows.
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <future>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "agent/config/config.h"
#include "agent/config/config_difference.h"
#include "agent/field/field.h"
#include "agent/outbox.h"
#include "agent/remote/remote_config.h"
#include "agent/status.h"
#include "agent/uplink/publisher.h"

namespace fxagent {

/// Needs a thread. SIGHUP is blocked in every thread of the process, so that one that comes early
/// or while a file is being read waits for its turn; several that wait are one. The thread is woken
/// with the same signal, sent to it alone.
class Reload final {
 public:
  /// `running` is in force, read from `path` and what `remote` has put onto it. All references
  /// outlive it. Starts its thread; the uplink may not run yet.
  Reload(std::string path, RemoteConfig& remote, std::shared_ptr<const Config> running,
         Field& field, Outbox& outbox, Publisher& publisher);
  /// Stops, if stop() was not called, and waits for the end of its thread: where a file that does
  /// not answer is being read, for as long as that takes.
  ~Reload();

  /// A reload that is under way goes no further than field and uplink take it by themselves. Before
  /// the field is stopped; waits for nothing.
  void stop();
  /// After stop(): whether the thread has ended, which writes last how a trial was stopped. A file
  /// or a disk that does not answer may keep it for longer.
  bool wait_for_end(std::chrono::nanoseconds patience);

 private:
  class Turn;
  using Next = RemoteConfig::Next;

  /// What the uplink has heard and this thread has not looked at.
  struct News {
    std::optional<std::string> desired;  ///< the newest
    std::optional<bool> connected;
    SteadyTime connected_at{};
  };

  void listen();
  void wake();
  /// Whether a SIGHUP came that was meant.
  bool wait();
  void run();
  void look_at_news();
  void reload();
  /// Nothing: it is wrong, and that was said.
  std::optional<Next> wanted();
  void hear(const std::string& desired);
  void take_over(Next next);
  /// False: it was stopped on the way.
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
  ConfigStatus status_;
  bool has_reported_ = false;
  const std::shared_ptr<Turn> turn_;
  std::mutex mutex_;
  News news_;  ///< under the mutex
  std::atomic<bool> stopping_ = false;
  std::promise<void> ended_;
  const std::future<void> end_ = ended_.get_future();
  std::thread thread_;
};

/// Files and sockets that the agent may have open at once with this config.
std::size_t files_needed(const Config& config);

/// Where health has no room for more.
inline constexpr std::size_t kErrorsInHealth = 10;

}  // namespace fxagent
