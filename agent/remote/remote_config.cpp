#include "agent/remote/remote_config.h"

#include <algorithm>
#include <utility>

#include "agent/config/source.h"
#include "agent/failpoint.h"
#include "agent/log/log.h"

namespace fxagent {
namespace {

using State = RemoteReport::State;

constexpr std::chrono::seconds kTryAgain{60};

/// Returns the directory of the store, or else the first STATE_DIRECTORY of systemd; empty if there
/// is neither.
std::string directory_for(const Config& config) {
  if (!config.store.path.empty()) return config.store.path;
  const std::string states = process_environment("STATE_DIRECTORY").value_or("");
  return states.substr(0, states.find(':'));
}

constexpr const char* kCannotBeKept =
    "cannot be kept on disk for a way back, and agent.remote_without_disk of the local file is not "
    "set: ";

}  // namespace

RemoteConfig::RemoteConfig(std::string path, std::chrono::milliseconds trial, std::string boot)
    : local_(std::move(path)), trial_time_(trial), kept_(std::move(boot)) {}

// ---- the start ----------------------------------------------------------------------------------

tl::expected<Config, ConfigErrors> RemoteConfig::start(Moment now) {
  auto local = local_.read();
  if (!local) return tl::unexpected(std::move(local.error()));
  Config& config = local->config;
  servers_ = config.mqtt.servers;
  kept_.open(directory_for(config), config.base_topic());
  if (!config.remote.enabled) return std::move(config);
  local_.put_in_force(std::move(local->file), now.utc_ms);
  answer_.begin(now.utc_ms);
  KeptConfigs& kept = kept_.configs();
  if (const std::string fault = kept_.load(); !fault.empty())
    answer_.report(State::applied, {}, {{"", 0, fault}}, now.utc_ms);
  else
    answer_.resume(kept);
  judge_again_ = kept_.judge_last_run(now.utc_ms);
  if (kept.rolled_back) answer_.report_rolled_back(*kept.rolled_back);
  if (auto on_trial = start_with(kept.trying, now)) {
    trial_.emplace(trial_time_, now.steady, /*is_connected=*/false);
    has_moved_ = on_trial->mqtt.servers != servers_;
    servers_ = on_trial->mqtt.servers;
    if (answer_.is_news()) return std::move(*on_trial);  // another document was rolled back
    answer_.report_in_force(in_force_, local_.since_ms());
    answer_.clear_news();
    return std::move(*on_trial);
  }
  kept.trying.reset();
  if (auto good = start_with(kept.good, now)) {
    servers_ = good->mqtt.servers;
    kept_.watch(in_force_, now.steady);
    return std::move(*good);
  }
  return std::move(config);
}

std::optional<Config> RemoteConfig::start_with(const std::optional<KeptConfig>& kept, Moment now) {
  if (!kept) return std::nullopt;
  auto config = local_.with(kept->document);
  if (!config) {
    answer_.reject(kept->document.text, kept->document, config.error(), now.utc_ms);
    return std::nullopt;
  }
  in_force_ = kept;
  return std::move(*config);
}

void RemoteConfig::begin() {
  if (!is_enabled()) {
    has_left_answer_ = kept_.forget_earlier_run();
    return;
  }
  if (!kept_.is_unsaved()) return;
  const std::string why = kept_.save();
  if (why.empty()) return;
  // The file on disk still records a stop, so the next process would take a crash for a stop and
  // resume the trial, again and again.
  is_given_up_ = trial_.has_value();
  log::error("remote_config",
             {{"note", is_given_up_ ? "the trial cannot go on: the disk refuses"
                                    : "what the last run has come to cannot be kept on disk yet"},
              {"reason", why}});
}

// ---- the local file -----------------------------------------------------------------------------

tl::expected<RemoteConfig::Next, ConfigErrors> RemoteConfig::read_local() const {
  auto local = local_.read();
  if (!local) return tl::unexpected(std::move(local.error()));
  Next next;
  next.local = std::move(local->file);
  next.config = std::move(local->config);
  // If the document on trial no longer fits, the last good one may.
  std::vector<const std::optional<KeptConfig>*> documents;
  if (next.local.limits.enabled && in_force_) documents = {&in_force_, &kept_.configs().good};
  for (const auto* document : documents) {
    if (!*document || next.document) continue;
    if (auto both = local_.with(next.local, (*document)->document)) {
      next.config = std::move(*both);
      next.document = *document;
    } else if (next.misfit.empty()) {
      next.misfit = std::move(both.error());
    }
  }
  next.servers = next.config.mqtt.servers;
  return next;
}

void RemoteConfig::settle_local_file(Next next, Moment now) {
  if (!next.local.limits.enabled) return forget();
  answer_.publish_again();  // the hash of the config in force may have changed
  if (!is_enabled()) answer_.begin(now.utc_ms);
  local_.put_in_force(std::move(next.local), now.utc_ms);
  if (next.misfit.empty()) return;
  answer_.reject(in_force_->document.text, in_force_->document, next.misfit, now.utc_ms);
  in_force_ = std::move(next.document);
  trial_.reset();
  is_given_up_ = false;
  KeptConfigs& kept = kept_.configs();
  if (!kept.is_good(in_force_)) kept.before.reset();
  kept.good = in_force_;
  kept.trying.reset();
  kept_.watch(in_force_, now.steady);
  kept_.save_or_log("that the local file does not let the config in any more");
}

// ---- remote configs -----------------------------------------------------------------------

std::optional<RemoteConfig::Next> RemoteConfig::hear(std::string_view payload, Moment now) {
  if (!is_enabled()) return std::nullopt;
  held_.clear();
  judge_again_.clear();
  if (payload.empty()) return withdraw(now);
  ReadDesired read;
  try {
    read = read_desired(payload);
    if (answer_.repeat(read.desired, in_force_, kept_.configs().rolled_back)) return std::nullopt;
    if (!read.errors.empty()) return reject(payload, read.desired, read.errors, now);
    return judge(payload, read.desired, now);
  } catch (const std::exception& fault) {
    return reject(payload, read.desired, not_built(fault), now);
  }
}

/// Saves the document before it judges it, and again before it is applied: if either step crashes
/// the process, the next start must find it on disk.
std::optional<RemoteConfig::Next> RemoteConfig::judge(std::string_view payload,
                                                      const DesiredConfig& desired, Moment now) {
  const auto refuse_disk = [&](const std::string& why) {
    return reject(payload, desired, {{"", 0, kCannotBeKept + why}}, now);
  };
  KeptConfigs& kept = kept_.configs();
  kept.judged = {desired.text, desired.hash, desired.version, desired.by};
  if (const std::string why = kept_.save(); !why.empty() && !local_.limits().without_disk)
    return refuse_disk(why);
  failpoint("remote_config_judged");
  auto config = local_.with(desired);
  if (local_.is_interrupted()) return std::nullopt;  // stop() persists this
  if (!config) return reject(payload, desired, config.error(), now);
  if (trial_ && has_moved_ && config->mqtt.servers != servers_) {
    end_judging();
    held_ = payload;
    answer_.publish_again();
    log::info("remote_config", {{"note",
                                 "another change of mqtt.servers waits for the end of the "
                                 "trial"},
                                {"version", log::excerpt(desired.version)}});
    return std::nullopt;
  }
  const KeptConfigs before = kept;
  const KeptConfig document{desired, now.utc_ms};
  kept.trying = document;
  kept.stopped = false;
  kept.judged.reset();
  kept.rolled_back.reset();
  const std::string why = kept_.save();
  if (!why.empty() && !local_.limits().without_disk) {
    kept = before;
    return refuse_disk(why);
  }
  if (!why.empty())
    log::warn("remote_config",
              {{"note",
                "the config is taken over and cannot be kept: after a crash nothing is known of it "
                "(agent.remote_without_disk)"},
               {"reason", why}});
  answer_.clear_rejected();
  Next next;
  next.why = Next::Why::desired;
  next.config = std::move(*config);
  next.servers = next.config.mqtt.servers;
  next.document = document;
  return next;
}

std::optional<RemoteConfig::Next> RemoteConfig::reject(std::string_view payload,
                                                       const DesiredConfig& desired,
                                                       const ConfigErrors& errors, Moment now) {
  end_judging();
  answer_.reject(payload, desired, errors, now.utc_ms);
  return std::nullopt;
}

void RemoteConfig::end_judging() {
  if (!kept_.configs().judged) return;
  kept_.configs().judged.reset();
  kept_.save_or_log("that the config was judged");
}

std::optional<RemoteConfig::Next> RemoteConfig::withdraw(Moment now) {
  const bool was_in_force = in_force_.has_value();
  if (!was_in_force && answer_.last().desired.hash.empty()) {
    answer_.publish_again();  // a client asks for the report
    return std::nullopt;
  }
  std::optional<Next> next;
  if (was_in_force) {
    auto config = local_.alone();
    if (!config && !local_.is_interrupted()) {
      answer_.report(State::rejected, {}, config.error(), now.utc_ms);
      return std::nullopt;
    }
    if (config) {
      next.emplace();
      next->why = Next::Why::withdrawn;
      next->config = std::move(*config);
      next->servers = next->config.mqtt.servers;
    }
  }
  kept_.configs() = {};
  kept_.end_watch();
  answer_.clear_rejected();
  kept_.save_or_log("that the config was withdrawn");
  if (!next) answer_.report(State::applied, {}, {}, now.utc_ms);
  return next;
}

// ---- the trial ----------------------------------------------------------------------------------

void RemoteConfig::connection(bool is_up, SteadyTime now) {
  is_connected_ = is_up;
  if (trial_) trial_->connection(is_up, now);
}

SteadyTime RemoteConfig::next_wake() const {
  SteadyTime decided = trial_ ? trial_->decided_at() : SteadyTime::max();
  if (is_given_up_) decided = {};
  decided = std::max(decided, back_again_at_);
  if (!judge_again_.empty()) decided = {};
  return std::min(decided, kept_.next_wake());
}

std::optional<RemoteConfig::Next> RemoteConfig::due(Moment now) {
  kept_.due(now.steady);
  KeptConfigs& kept = kept_.configs();
  if (!judge_again_.empty()) return hear(std::exchange(judge_again_, {}), now);
  auto outcome = trial_ ? trial_->outcome(now.steady) : Trial::Outcome::pending;
  if (is_given_up_) outcome = Trial::Outcome::lost;
  if (outcome == Trial::Outcome::pending) return std::nullopt;
  if (outcome == Trial::Outcome::good) {
    trial_.reset();
    kept.trying.reset();
    if (!kept.is_good(in_force_)) kept.before = std::exchange(kept.good, in_force_);
    kept.ends = 0;
    kept_.watch(in_force_, now.steady);
    kept_.save_or_log("that the config is good");
    answer_.publish_again();
    if (held_.empty()) return std::nullopt;
    return hear(std::string(held_), now);
  }
  if (now.steady < back_again_at_) return std::nullopt;
  auto next = way_back(is_given_up_ ? Next::Why::given_up : Next::Why::rolled_back, now);
  if (!next) return std::nullopt;
  trial_.reset();
  kept.trying.reset();
  held_.clear();
  if (std::exchange(is_given_up_, false)) return next;
  const DesiredConfig& document = in_force_->document;
  const auto seconds = std::chrono::duration_cast<std::chrono::seconds>(trial_time_);
  kept.rolled_back = {document.hash, document.version, document.by,
                      "the broker was lost for " + std::to_string(seconds.count()) +
                          " s while the config was on trial",
                      now.utc_ms};
  kept_.save_or_log("the rollback");
  return next;
}

/// Returns the last good config, or else the local file alone. Returns nullopt if neither can be
/// built now, which it logs and reports, or if the process is stopping.
std::optional<RemoteConfig::Next> RemoteConfig::way_back(Next::Why why, Moment now) {
  Next next;
  next.why = why;
  const auto& good = kept_.configs().good;
  auto config = good ? local_.with(good->document) : local_.alone();
  if (config) next.document = good;
  if (!config && good) config = local_.alone();
  if (local_.is_interrupted()) return std::nullopt;  // the next process will reach the same outcome
  if (!config) {
    back_again_at_ = now.steady + kTryAgain;
    log::error("remote_config", {{"note", "the config cannot be rolled back yet"},
                                 {"reason", log::excerpt(text_of(config.error().front()))}});
    answer_.report(State::applied, in_force_->document, config.error(), in_force_->since_ms);
    return std::nullopt;
  }
  back_again_at_ = {};
  next.config = std::move(*config);
  next.servers = next.config.mqtt.servers;
  return next;
}

void RemoteConfig::accept(Next next, Moment now) {
  const bool moves = next.servers != std::exchange(servers_, next.servers);
  switch (next.why) {
    case Next::Why::local_file:
      return settle_local_file(std::move(next), now);
    case Next::Why::desired:
      in_force_ = std::move(next.document);
      kept_.end_watch();
      trial_.emplace(trial_time_, now.steady, is_connected_);
      has_moved_ = moves;
      is_given_up_ = false;
      return answer_.report_in_force(in_force_, local_.since_ms());
    case Next::Why::withdrawn:
      in_force_.reset();
      trial_.reset();
      is_given_up_ = false;
      return answer_.report(State::applied, {}, {}, now.utc_ms);
    case Next::Why::rolled_back:
    case Next::Why::given_up:
      in_force_ = std::move(next.document);
      kept_.watch(in_force_, now.steady);
      if (kept_.is_watched()) kept_.save_or_log("that the config before is in force");
      if (next.why == Next::Why::rolled_back)
        return answer_.report_rolled_back(*kept_.configs().rolled_back);
      return answer_.report_in_force(in_force_, local_.since_ms());
  }
}

void RemoteConfig::refuse(const Next& next, const ConfigErrors& errors, Moment now) {
  if (next.why != Next::Why::desired) return;
  kept_.configs().trying = trial_ ? in_force_ : std::nullopt;
  kept_.save_or_log("that the config was rejected");
  answer_.report(State::rejected, next.document->document, errors, now.utc_ms);
}

void RemoteConfig::stop() { kept_.stop(); }

// ---- reports ------------------------------------------------------------------------------------

void RemoteConfig::forget() {
  kept_.forget();
  in_force_.reset();
  trial_.reset();
  is_given_up_ = false;
  judge_again_.clear();
  local_.put_in_force({}, 0);
  held_.clear();
  answer_ = {};
}

std::string RemoteConfig::reported(const std::string& hash) const {
  return reported_text(answer_.last(), hash, in_force_ ? in_force_->document.version : "",
                       !trial_.has_value());
}

std::optional<ConfigStatus::Remote> RemoteConfig::status() const {
  if (!is_enabled()) return std::nullopt;
  return ConfigStatus::Remote{in_force_ ? in_force_->document.version : "",
                              std::string(to_string(answer_.last().state)), !trial_.has_value()};
}

}  // namespace fxagent
