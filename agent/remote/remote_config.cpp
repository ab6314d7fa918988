#include "agent/remote/remote_config.h"

#include <algorithm>
#include <utility>

#include "agent/failpoint.h"
#include "agent/log/log.h"
#include "agent/process/this_process.h"

namespace fxagent {
namespace {

using State = RemoteReport::State;
using Next = RemoteConfig::Next;

/// Time until the next attempt to roll back.
constexpr std::chrono::seconds kTryAgain{60};

/// Returns the directory of the store, or else the first STATE_DIRECTORY of systemd; empty if there
/// is neither.
std::string directory_for(const Config& config) {
  if (!config.store.path.empty()) return config.store.path;
  const std::string states = process_environment("STATE_DIRECTORY").value_or("");
  return states.substr(0, states.find(':'));
}

Next next_of(Next::Why why, Config config) {
  std::vector<std::string> servers = config.mqtt.servers;
  return {.why = why, .config = std::move(config), .servers = std::move(servers)};
}

constexpr const char* kCannotBeKept =
    "cannot be saved to disk for a rollback, and the local file does not set "
    "agent.remote_without_disk: ";

/// Saves the document and then builds its config: if that crashes the process, the next start must
/// find it on disk. Returns nullopt if the process is stopping.
tl::expected<std::optional<Config>, ConfigErrors> judge(const DesiredConfig& desired,
                                                        const LocalConfig& local, KeptFile& kept) {
  kept.configs().judged = desired;
  if (const std::string why = kept.save(); !why.empty() && !local.limits().without_disk)
    return tl::unexpected(ConfigErrors{{"", 0, kCannotBeKept + why}});
  failpoint("remote_config_judged");
  auto config = local.with(desired);
  if (local.is_interrupted()) return std::nullopt;  // KeptFile::stop() persists this
  if (!config) return tl::unexpected(std::move(config.error()));
  return std::move(*config);
}

/// Saves the document before it is applied, for the same reason. Errors: it must not be applied.
ConfigErrors keep_on_trial(const KeptConfig& document, const LocalConfig& local, KeptFile& kept) {
  KeptConfigs& configs = kept.configs();
  const KeptConfigs before = configs;
  configs.trying = document;
  configs.stopped = false;
  configs.judged.reset();
  configs.rolled_back.reset();
  const std::string why = kept.save();
  if (why.empty()) return {};
  if (!local.limits().without_disk) {
    configs = before;
    return {{"", 0, kCannotBeKept + why}};
  }
  log::warn(
      "remote_config",
      {{"note",
        "the config is applied but cannot be saved: a crash loses it (agent.remote_without_disk)"},
       {"reason", why}});
  return {};
}

/// Returns the config without the document in force; nullopt if there is nothing to apply.
std::optional<Next> withdraw(const ConfigInForce& in_force, const LocalConfig& local,
                             KeptFile& kept, RemoteAnswer& answer, std::int64_t now_ms) {
  std::optional<Next> next;
  if (in_force.document()) {
    auto config = local.alone();
    if (!config && !local.is_interrupted()) {
      answer.report(State::rejected, {}, config.error(), now_ms);
      return std::nullopt;
    }
    if (config) next = next_of(Next::Why::withdrawn, std::move(*config));
  } else if (answer.last().desired.hash.empty()) {
    answer.publish_again();  // a client asks for the report
    return std::nullopt;
  }
  kept.configs() = {};
  kept.end_watch();
  answer.clear_rejected();
  kept.save_or_log("the withdrawal of the config");
  if (!next) answer.report(State::applied, {}, {}, now_ms);
  return next;
}

/// Returns the last good config, or else the local file alone. Errors: neither can be built now.
tl::expected<Next, ConfigErrors> way_back(Next::Why why, const std::optional<KeptConfig>& good,
                                          const LocalConfig& local) {
  auto config = good ? local.with(good->document) : local.alone();
  const bool is_good = good && config;
  if (good && !config) config = local.alone();
  if (!config) return tl::unexpected(std::move(config.error()));
  Next next = next_of(why, std::move(*config));
  if (is_good) next.document = good;
  return next;
}

}  // namespace

RemoteConfig::RemoteConfig(std::string path, std::chrono::milliseconds trial, std::string boot)
    : local_(std::move(path)), kept_(std::move(boot)), in_force_(trial) {}

// ---- the start ----------------------------------------------------------------------------------

tl::expected<Config, ConfigErrors> RemoteConfig::start(Moment now) {
  auto local = local_.read();
  if (!local) return tl::unexpected(std::move(local.error()));
  Config& config = local->config;
  in_force_.set_servers(config.mqtt.servers);
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

  const auto build = [&](const std::optional<KeptConfig>& document) -> std::optional<Config> {
    if (!document) return std::nullopt;
    auto merged = local_.with(document->document);
    if (merged) return std::move(*merged);
    answer_.reject(document->document.text, document->document, merged.error(), now.utc_ms);
    return std::nullopt;
  };
  if (auto on_trial = build(kept.trying)) {
    in_force_.put_on_trial(kept.trying, on_trial->mqtt.servers, now.steady);
    if (!answer_.is_news()) {  // no other document was rolled back
      answer_.report_in_force(kept.trying, local_.since_ms());
      answer_.clear_news();
    }
    return std::move(*on_trial);
  }
  kept.trying.reset();
  if (auto good = build(kept.good)) {
    in_force_.put_in_force(kept.good, good->mqtt.servers);
    kept_.watch(kept.good, now.steady);
    return std::move(*good);
  }
  return std::move(config);
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
  in_force_.give_up();
  log::error(
      "remote_config",
      {{"note",
        in_force_.is_given_up()
            ? "the trial cannot continue: the disk refuses writes"
            : "the outcome of the last run could not be saved to disk; the agent tries again"},
       {"reason", why}});
}

// ---- documents ----------------------------------------------------------------------------------

std::optional<Next> RemoteConfig::receive(std::string_view payload, Moment now) {
  if (!is_enabled()) return std::nullopt;
  held_.clear();
  judge_again_.clear();
  if (payload.empty()) return withdraw(in_force_, local_, kept_, answer_, now.utc_ms);
  ReadDesired read;
  const auto reject = [&](const ConfigErrors& errors) {
    kept_.end_judging();
    answer_.reject(payload, read.desired, errors, now.utc_ms);
    return std::nullopt;
  };
  try {
    read = read_desired(payload);
    if (answer_.repeat(read.desired, in_force_.document(), kept_.configs().rolled_back))
      return std::nullopt;
    if (!read.errors.empty()) return reject(read.errors);
    auto config = judge(read.desired, local_, kept_);
    if (!config) return reject(config.error());
    if (!*config) return std::nullopt;
    if (in_force_.would_move_again((*config)->mqtt.servers)) {
      kept_.end_judging();
      held_ = payload;
      answer_.clear_rejected();  // a reload would judge it again in place of this one
      answer_.publish_again();
      log::info("remote_config",
                {{"note", "another change of mqtt.servers waits for the end of the trial"},
                 {"version", log::excerpt(read.desired.version)}});
      return std::nullopt;
    }
    const KeptConfig document{read.desired, now.utc_ms};
    if (const auto errors = keep_on_trial(document, local_, kept_); !errors.empty())
      return reject(errors);
    answer_.clear_rejected();
    Next next = next_of(Next::Why::desired, std::move(**config));
    next.document = document;
    return next;
  } catch (const std::exception& fault) {
    return reject(not_built(fault));
  }
}

void RemoteConfig::refuse(const Next& next, const ConfigErrors& errors, Moment now) {
  if (next.why != Next::Why::desired) return;
  kept_.configs().trying = in_force_.is_on_trial() ? in_force_.document() : std::nullopt;
  kept_.save_or_log("the rejection of the config");
  answer_.report(State::rejected, next.document->document, errors, now.utc_ms);
}

// ---- the config in force ------------------------------------------------------------------------

tl::expected<Next, ConfigErrors> RemoteConfig::read_local() const {
  auto local = local_.read();
  if (!local) return tl::unexpected(std::move(local.error()));
  Next next;
  next.local = std::move(local->file);
  next.config = std::move(local->config);
  // If the document on trial no longer fits, the last good one may.
  const bool may_have_one = next.local.limits.enabled && in_force_.document();
  for (const auto* document : {&in_force_.document(), &kept_.configs().good}) {
    if (!may_have_one || !*document || next.document) continue;
    if (auto both = local_.build(next.local, &(*document)->document)) {
      next.config = std::move(*both);
      next.document = *document;
    } else if (next.misfit.empty()) {
      next.misfit = std::move(both.error());
    }
  }
  next.servers = next.config.mqtt.servers;
  return next;
}

void RemoteConfig::accept(Next next, Moment now) {
  KeptConfigs& kept = kept_.configs();
  const std::optional<KeptConfig>& in_force = in_force_.document();
  switch (next.why) {
    case Next::Why::local_file:
      if (!next.local.limits.enabled) {
        local_.put_in_force({}, 0);
        in_force_.put_in_force({}, std::move(next.servers));
        held_.clear();
        judge_again_.clear();
        answer_ = {};
        return kept_.forget();
      }
      answer_.publish_again();  // the hash of the config in force may have changed
      if (!is_enabled()) answer_.begin(now.utc_ms);
      local_.put_in_force(std::move(next.local), now.utc_ms);
      in_force_.set_servers(next.servers);
      if (next.misfit.empty()) return;
      answer_.reject(in_force->document.text, in_force->document, next.misfit, now.utc_ms);
      in_force_.put_in_force(std::move(next.document), std::move(next.servers));
      if (!kept.is_good(in_force)) kept.before.reset();
      kept.good = in_force;
      kept.trying.reset();
      kept_.watch(in_force, now.steady);
      if (!held_.empty()) judge_again_ = std::exchange(held_, {});  // the trial has ended
      return kept_.save_or_log("the removal of a config that the local file no longer allows");
    case Next::Why::desired:
      in_force_.put_on_trial(std::move(next.document), std::move(next.servers), now.steady);
      kept_.end_watch();
      return answer_.report_in_force(in_force, local_.since_ms());
    case Next::Why::withdrawn:
      in_force_.put_in_force({}, std::move(next.servers));
      return answer_.report(State::applied, {}, {}, now.utc_ms);
    case Next::Why::rolled_back:
    case Next::Why::given_up:
      in_force_.put_in_force(std::move(next.document), std::move(next.servers));
      kept_.watch(in_force, now.steady);
      if (kept_.is_watched()) kept_.save_or_log("the return to the previous config");
      if (next.why == Next::Why::rolled_back) return answer_.report_rolled_back(*kept.rolled_back);
      return answer_.report_in_force(in_force, local_.since_ms());
  }
}

SteadyTime RemoteConfig::next_wake() const {
  const SteadyTime decided = judge_again_.empty() ? in_force_.next_wake() : SteadyTime{};
  return std::min(decided, kept_.next_wake());
}

std::optional<Next> RemoteConfig::due(Moment now) {
  kept_.due(now.steady);
  if (!judge_again_.empty()) return receive(std::exchange(judge_again_, {}), now);
  KeptConfigs& kept = kept_.configs();
  const std::optional<KeptConfig>& in_force = in_force_.document();
  const auto outcome = in_force_.outcome(now.steady);
  if (outcome == ConfigInForce::Outcome::pending) return std::nullopt;
  if (outcome == ConfigInForce::Outcome::good) {
    in_force_.end_trial();
    kept.trying.reset();
    if (!kept.is_good(in_force)) kept.before = std::exchange(kept.good, in_force);
    kept.ends = 0;
    kept_.watch(kept.good, now.steady);
    kept_.save_or_log("the confirmation of the config");
    answer_.publish_again();
    if (held_.empty()) return std::nullopt;
    return receive(std::string(held_), now);
  }
  const bool is_given_up = in_force_.is_given_up();
  auto next =
      way_back(is_given_up ? Next::Why::given_up : Next::Why::rolled_back, kept.good, local_);
  if (local_.is_interrupted()) return std::nullopt;  // the next process will reach the same outcome
  const DesiredConfig& document = in_force->document;
  if (!next) {
    in_force_.put_off(now.steady + kTryAgain);
    log::error("remote_config",
               {{"note", "the config could not be rolled back; the agent tries again"},
                {"reason", log::excerpt(text_of(next.error().front()))}});
    answer_.report(State::applied, document, next.error(), in_force->since_ms);
    return std::nullopt;
  }
  in_force_.end_trial();
  kept.trying.reset();
  held_.clear();
  if (is_given_up) return std::move(*next);
  const auto seconds = std::chrono::duration_cast<std::chrono::seconds>(in_force_.trial_time());
  kept.rolled_back = {document.hash, document.version, document.by,
                      "the broker was lost for " + std::to_string(seconds.count()) +
                          " s while the config was on trial",
                      now.utc_ms};
  kept_.save_or_log("the rollback");
  return std::move(*next);
}

// ---- the answer ---------------------------------------------------------------------------------

std::string RemoteConfig::report_text(const std::string& hash) const {
  return reported_text(answer_.last(), hash, in_force_.version(), !in_force_.is_on_trial());
}

std::optional<ConfigStatus::Remote> RemoteConfig::status() const {
  if (!is_enabled()) return std::nullopt;
  return ConfigStatus::Remote{in_force_.version(), std::string(to_string(answer_.last().state)),
                              !in_force_.is_on_trial()};
}

}  // namespace fxagent
