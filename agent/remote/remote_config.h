// Decides which config is in force: the local file alone, or merged with a remote config that has
// arrived over MQTT. A new remote config is first on trial, with the last good one as the way back.
// agent/reload.h passes the events in and applies the configs. One thread, except interrupt();
// calls read and write files.
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <tl/expected.hpp>
#include <utility>
#include <vector>

#include "agent/config/model.h"
#include "agent/handover/status.h"
#include "agent/remote/config_in_force.h"
#include "agent/remote/kept_configs.h"
#include "agent/remote/kept_file.h"
#include "agent/remote/local_config.h"
#include "agent/remote/remote_report.h"
#include "agent/steady_time.h"

namespace fxagent {

class RemoteConfig final {
 public:
  /// One instant by both clocks.
  struct Moment {
    SteadyTime steady{};
    std::int64_t utc_ms = 0;
  };

  /// `path` is the local file. `trial` is the length of a trial, and the time that the broker may
  /// be away during it. `boot` is the boot id of the machine: if the machine restarts, the end of
  /// the process does not count against a good config.
  RemoteConfig(std::string path, std::chrono::milliseconds trial, std::string boot);

  // ---- start and stop

  /// Returns the config to start with: the local file, merged with the config kept by the last run.
  /// Writes nothing, since another agent may run here. Errors: those of the local file.
  tl::expected<Config, ConfigErrors> start(Moment now);
  /// Persists the outcome of start(). Call once, after the stop handler is installed and before the
  /// config is applied; a crash after this call counts against the config.
  void begin();
  /// Ends reading and judging early, because the process is stopping. Any thread.
  void interrupt() { local_.interrupt(); }
  /// Persists that the process was stopped: the next one begins the trial again, and judges again a
  /// document that was being judged. Call after the last other call has returned.
  void stop() { kept_.stop(); }

  // ---- events

  /// A config to apply. Call accept() once it is in force, or refuse() if that fails.
  struct Next {
    enum class Why : std::uint8_t {
      local_file,
      desired,
      withdrawn,
      rolled_back,
      given_up,  ///< the trial cannot go on, because its state cannot be saved on disk
    };
    Why why = Why::local_file;
    Config config;
    std::vector<std::string> servers{};    ///< mqtt.servers of `config`
    LocalFile local{};                     ///< set for Why::local_file
    std::optional<KeptConfig> document{};  ///< the document in `config`
    /// Errors of the document in force with `local`. The local file takes precedence.
    ConfigErrors misfit{};
  };
  /// Reads the local file again and merges it with the document in force, or else the last good
  /// one, if that fits. Errors: those of the local file; the config in force stays.
  tl::expected<Next, ConfigErrors> read_local() const;
  /// Handles a document of {base}/config/desired; an empty payload withdraws it. Returns nullopt if
  /// there is nothing to apply.
  std::optional<Next> receive(std::string_view payload, Moment now);
  /// Handles the end of a trial, judges a document that had to wait, and repeats failed writes.
  /// Call by next_wake(). Returns nullopt if there is nothing to apply.
  std::optional<Next> due(Moment now);
  SteadyTime next_wake() const;
  /// Call when the connection to the broker was made or lost.
  void set_connected(bool is_connected, SteadyTime now) { in_force_.connection(is_connected, now); }
  void accept(Next next, Moment now);
  void refuse(const Next& next, const ConfigErrors& errors, Moment now);

  // ---- reports

  bool is_enabled() const { return local_.limits().enabled; }
  /// The answer for {base}/config/reported, and the last rejected document, for receive() after the
  /// local file has changed.
  const RemoteAnswer& answer() const { return answer_; }
  /// Returns the payload of the answer. `hash` is that of the config in force.
  std::string report_text(const std::string& hash) const;
  /// Call when the answer is published. True if it differs from the previous one.
  bool take_news() { return answer_.take_news(); }
  /// True, once, if the answer of an earlier run must be cleared: remote config is now forbidden.
  bool take_left_answer() { return std::exchange(has_left_answer_, false); }
  /// Returns the status for health; nullopt if remote config is not allowed.
  std::optional<ConfigStatus::Remote> status() const;

 private:
  LocalConfig local_;
  KeptFile kept_;
  ConfigInForce in_force_;
  RemoteAnswer answer_;
  std::string held_;         ///< document with another change of servers; waits for the outcome
  std::string judge_again_;  ///< document that was being judged when the last process stopped
  bool has_left_answer_ = false;
};

/// Returns the length of a trial: 60 s in the product. A test program may define its own version:
/// ours is alone in its archive member, so the linker then leaves it out. Any thread.
std::chrono::milliseconds trial_time() noexcept;

}  // namespace fxagent
