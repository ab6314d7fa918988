// Decides which config is in force: the local file, merged with the remote config. Owns the parts
// that keep the local file, the configs on disk, the config in force and the answer for the broker.
// agent/reload.h applies the configs. One thread, except
// interrupt(); calls read and write files.
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <tl/expected.hpp>
#include <utility>
#include <vector>

#include "agent/config/model.h"
#include "agent/config/source.h"
#include "agent/handover/status.h"
#include "agent/remote/config_in_force.h"
#include "agent/remote/desired_config.h"
#include "agent/remote/kept_configs.h"
#include "agent/remote/kept_file.h"
#include "agent/remote/remote_report.h"
#include "agent/steady_time.h"

namespace fxagent {

/// Returns the length of a trial: 60 s in the product. A test program may define its own version:
/// ours is alone in its archive member, so the linker then leaves it out. Any thread.
std::chrono::milliseconds trial_time() noexcept;

struct LocalFile {
  std::string text;
  FilePrivacy privacy = FilePrivacy::shared;  ///< when the text was read
  RemoteLimits limits{};
};

/// The local file in force, and the configs built from it: alone, or merged with a document. Keeps
/// the text in memory, because the file on disk may change before the next reload. One thread,
/// except interrupt().
class LocalConfig final {
 public:
  explicit LocalConfig(std::string path) : path_(std::move(path)) {}

  struct Read {
    LocalFile file;
    Config config;  ///< of `file` alone
  };
  /// Reads the file on disk. Does not put it in force.
  tl::expected<Read, ConfigErrors> read() const;
  /// Puts the file in force, at `now_ms` UTC. An empty one: remote config is not allowed.
  void put_in_force(LocalFile file, std::int64_t now_ms) {
    file_ = std::move(file);
    since_ms_ = now_ms;
  }

  const RemoteLimits& limits() const { return file_.limits; }
  /// Returns when the file was put in force, in ms UTC.
  std::int64_t since_ms() const { return since_ms_; }

  /// Returns the config of the file in force, alone or merged with `document`. Errors: all of the
  /// config; meaningless after interrupt().
  tl::expected<Config, ConfigErrors> alone() const { return build(file_, nullptr); }
  tl::expected<Config, ConfigErrors> with(const DesiredConfig& document) const {
    return build(file_, &document);
  }
  /// The same for a file that is not in force. `document`: nullptr if there is none.
  tl::expected<Config, ConfigErrors> build(const LocalFile& file,
                                           const DesiredConfig* document) const;

  /// Ends reading and merging early, also later ones. Any thread.
  void interrupt() { interrupted_ = true; }
  bool is_interrupted() const { return interrupted_; }

 private:
  const std::string path_;
  LocalFile file_;
  std::int64_t since_ms_ = 0;
  std::atomic<bool> interrupted_ = false;
};

class RemoteConfig final {
 public:
  struct Moment {
    SteadyTime steady{};
    std::int64_t utc_ms = 0;
  };

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

  /// `path` is the local file. `trial` is the length of a trial, and the time that the broker may
  /// be away during it. `boot` is the boot id of the machine: if the machine restarts, the end of
  /// the process does not count against a good config.
  RemoteConfig(std::string path, std::chrono::milliseconds trial, std::string boot);

  /// Returns the config to start with: the local file, merged with the config kept by the last run.
  /// Writes nothing, since another agent may run here. Errors: those of the local file.
  tl::expected<Config, ConfigErrors> start(Moment now);
  /// Persists the outcome of start(). Call once, after the stop handler is installed and before the
  /// config is applied; a crash after this call counts against the config.
  void begin();

  /// Reads the local file again and merges it with the document in force, or else the last good
  /// one, if that fits. Errors: those of the local file; the config in force stays.
  tl::expected<Next, ConfigErrors> read_local() const;
  /// Handles a document of {base}/config/desired; an empty payload withdraws it. Returns nullopt if
  /// there is nothing to apply.
  std::optional<Next> hear(std::string_view payload, Moment now);
  /// Handles the end of a trial, judges a document that had to wait, and repeats failed writes.
  /// Returns nullopt if there is nothing to apply.
  std::optional<Next> due(Moment now);
  /// Returns the time of the next call of due().
  SteadyTime next_wake() const;

  void accept(Next next, Moment now);
  void refuse(const Next& next, const ConfigErrors& errors, Moment now);

  /// Returns the last rejected document, for hear() after the local file has changed; empty if
  /// none.
  const std::string& rejected() const { return answer_.rejected(); }
  void connection(bool is_up, SteadyTime now) { in_force_.connection(is_up, now); }
  /// Ends reading and judging early, because the process is stopping. Any thread.
  void interrupt() { local_.interrupt(); }
  /// Persists that the process was stopped. The next process begins the trial again, and judges
  /// again a document that was being judged.
  /// Call after the last other call has returned.
  void stop() { kept_.stop(); }

  /// True, once, if remote config is not allowed any more and the answer of an earlier run must be
  /// cleared.
  bool take_left_answer() { return std::exchange(has_left_answer_, false); }

  bool is_enabled() const { return local_.limits().enabled; }
  const RemoteReport& report() const { return answer_.last(); }
  /// True if reported() must be published, again or for the first time.
  bool has_answer() const { return answer_.has_answer(); }
  /// Call when the answer is published. True if it differs from the previous one.
  bool take_news() { return answer_.take_news(); }
  /// Returns the payload for {base}/config/reported. `hash` is that of the config in force.
  std::string reported(const std::string& hash) const;
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

}  // namespace fxagent
