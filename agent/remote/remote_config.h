// The config in force: the local file, and onto it the remote config. Decides what is to be in
// force next, keeps the last config that proved good, and knows what is to be reported. Applying is
// somebody else's work (agent/reload.h). One thread; files are read and written within the calls.
#pragma once

#include <atomic>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <tl/expected.hpp>
#include <utility>
#include <vector>

#include "agent/config/config.h"
#include "agent/messages.h"
#include "agent/remote/desired_config.h"
#include "agent/remote/kept_configs.h"
#include "agent/remote/remote_report.h"
#include "agent/remote/trial.h"
#include "agent/status.h"
#include "agent/store/durable_file.h"

namespace fxagent {

class RemoteConfig final {
 public:
  struct Moment {
    SteadyTime steady{};
    std::int64_t utc_ms = 0;
  };

  /// The local file as it was read: who could read it then counts for as long as its text does.
  struct LocalFile {
    std::string text;
    FilePrivacy privacy = FilePrivacy::shared;
  };

  /// A config to be applied. accept() it when it is in force; else refuse() it.
  struct Next {
    enum class Why : std::uint8_t {
      local_file,
      desired,
      withdrawn,
      rolled_back,
      given_up,  ///< a trial that the disk lets nobody go on with
    };
    Why why = Why::local_file;
    Config config;
    std::vector<std::string> servers{};    ///< of `config`
    LocalFile local{};                     ///< where it was read again
    RemoteLimits limits{};                 ///< of `local`
    std::optional<KeptConfig> document{};  ///< that is in `config`
    /// Why the document that was in force does not fit `local`: the local file wins.
    ConfigErrors misfit{};
  };

  /// `path`: of the local file. `trial`: how long a new config is on trial, and how long the broker
  /// may be away meanwhile. `boot`: of the machine; a process that ends with the machine says
  /// nothing of a good config.
  RemoteConfig(std::string path, std::chrono::milliseconds trial, std::string boot);

  /// The config to start with: the local file, and what was kept of the last run. Reads only: it
  /// may be that another agent runs here. Errors: those of the local file.
  tl::expected<Config, ConfigErrors> start(Moment now);
  /// Writes what start() has found out. Once, when a stop is heard, and before anything of the
  /// config begins: from here on an end of the process that is no stop is held against it.
  void begin();

  /// The local file as it is now, with the document in force where it fits. Errors: those of the
  /// local file; what is in force stays.
  tl::expected<Next, ConfigErrors> read_local() const;
  /// A document of {base}/config/desired; empty: it was withdrawn. Nothing: it was answered, and
  /// nothing is to be applied.
  std::optional<Next> hear(std::string_view payload, Moment now);
  /// What the trial has come to. Nothing: there is nothing to apply. What the disk refused is tried
  /// again.
  std::optional<Next> due(Moment now);
  /// When due() is to be called.
  SteadyTime next_wake() const;

  void accept(Next next, Moment now);
  void refuse(const Next& next, const ConfigErrors& errors, Moment now);

  /// A document that was rejected, to be heard again after the local file has changed.
  const std::string& rejected() const { return rejected_; }
  void connection(bool is_up, SteadyTime now);
  /// The process was told to end: what is being read or judged goes no further. Any thread.
  void interrupt() { interrupted_ = true; }
  /// Writes that it was, once the last call has returned: a trial goes on with the next process,
  /// and a document that was judged is judged by it.
  void stop();

  /// An answer of an earlier run is to be cleared, since remote config is no longer allowed. Once.
  bool take_left_answer() { return std::exchange(has_left_answer_, false); }

  bool is_enabled() const { return limits_.enabled; }
  const RemoteReport& report() const { return report_; }
  /// Whether reported() is to be published, again or for the first time.
  bool has_answer() const { return has_answer_; }
  /// The answer is published. Whether it says something that was not said before.
  bool take_news() {
    has_answer_ = false;
    return std::exchange(is_news_, false);
  }
  /// The text for {base}/config/reported. `hash`: of the config in force.
  std::string reported(const std::string& hash) const;
  /// For health; nothing: remote config is not allowed.
  std::optional<ConfigStatus::Remote> status() const;

 private:
  tl::expected<Config, ConfigErrors> alone(const LocalFile& local) const;
  tl::expected<Config, ConfigErrors> with(const LocalFile& local,
                                          const DesiredConfig& document) const;
  bool is_in_force(const std::optional<KeptConfig>& kept) const;
  void watch(SteadyTime now);
  void take_kept(Moment now);
  void judge_last_run(Moment now);
  std::optional<Config> start_with(const std::optional<KeptConfig>& kept, Moment now);
  std::optional<Next> withdraw(Moment now);
  bool answer_known(const DesiredConfig& desired);
  std::optional<Next> judge(std::string_view payload, const DesiredConfig& desired, Moment now);
  std::optional<Next> reject(std::string_view payload, const DesiredConfig& desired,
                             const ConfigErrors& errors, Moment now);
  std::optional<Next> way_back(Next::Why why, Moment now);
  void end_judging();
  void settle_local_file(Next next, Moment now);
  void report(RemoteReport::State state, const DesiredConfig& desired, const ConfigErrors& errors,
              std::int64_t since_ms);
  void report_in_force();
  void report_rolled_back();
  void forget();
  std::string save();
  void save_or_say(std::string_view what);
  void save_again(SteadyTime now);

  const std::string path_;
  const std::chrono::milliseconds trial_time_;
  const std::string boot_;
  std::atomic<bool> interrupted_ = false;
  RemoteLimits limits_;
  std::string base_;  ///< topic of the agent
  LocalFile local_;   ///< in force; empty where remote config is not allowed
  std::int64_t local_since_ms_ = 0;
  std::optional<DurableFile> file_;  ///< nothing: there is no place for one
  KeptConfigs kept_;
  bool has_left_answer_ = false;
  bool is_unsaved_ = false;  ///< it is not on disk
  SteadyTime save_again_at_{};
  std::optional<KeptConfig> in_force_;
  std::optional<Trial> trial_;  ///< of in_force_
  bool is_given_up_ = false;    ///< the trial, whatever it comes to
  SteadyTime back_again_at_{};  ///< when the way back is tried again
  /// When the process has gone on long enough with the good config; nothing: it has, or none is.
  std::optional<SteadyTime> watched_until_;
  std::vector<std::string> servers_;  ///< in force
  bool has_moved_ = false;            ///< the config on trial has other servers than that before
  std::string held_;                  ///< a document that moves again, until the verdict
  std::string judge_again_;           ///< a document that the last process was stopped at
  bool is_connected_ = false;
  std::string rejected_;
  RemoteReport report_;
  bool has_answer_ = false;
  bool is_news_ = false;
};

}  // namespace fxagent
