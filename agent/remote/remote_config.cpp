#include "agent/remote/remote_config.h"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <utility>

#include "agent/config/tree.h"
#include "agent/log/log.h"

namespace fxagent {
namespace {

using State = RemoteReport::State;

constexpr const char* kFileName = "remote_config.json";
constexpr std::chrono::seconds kSaveAgain{60};

/// Beside the store; without one where systemd lets the agent keep what it needs. Empty: nowhere.
std::string directory_for(const Config& config) {
  if (!config.store.path.empty()) return config.store.path;
  const std::string states = process_environment("STATE_DIRECTORY").value_or("");
  return states.substr(0, states.find(':'));
}

DesiredConfig without_text(DesiredConfig desired) {
  desired.text.clear();
  return desired;
}

bool same_errors(const ConfigErrors& one, const ConfigErrors& other) {
  return std::ranges::equal(one, other, {}, text_of, text_of);
}

}  // namespace

std::string text_of(const ConfigError& error) {
  return error.pointer.empty() ? error.text : error.pointer + ": " + error.text;
}

std::string_view to_string(State state) {
  switch (state) {
    case State::applied:
      return "applied";
    case State::rejected:
      return "rejected";
    case State::rolled_back:
      return "rolled_back";
  }
  return {};
}

RemoteConfig::RemoteConfig(std::string path, std::chrono::milliseconds trial)
    : path_(std::move(path)), trial_time_(trial) {}

tl::expected<Config, ConfigErrors> RemoteConfig::local(std::string_view text) const {
  return config_of_file(path_, text);
}

tl::expected<Config, ConfigErrors> RemoteConfig::with(std::string_view local_text,
                                                      const DesiredConfig& document) const {
  auto config = local(local_text);
  if (!config) return config;
  return effective_config(local_text, *config, document,
                          [this](std::string_view text) { return local(text); });
}

// ---- the start ----------------------------------------------------------------------------------

tl::expected<Config, ConfigErrors> RemoteConfig::start(Moment now) {
  auto text = read_config_file(path_);
  if (!text) return tl::unexpected(std::move(text.error()));
  auto config = local(*text);
  if (!config) return config;
  limits_ = config->remote;
  local_since_ms_ = now.utc_ms;
  if (const std::string directory = directory_for(*config); !directory.empty())
    file_.emplace(directory, kFileName);
  if (!limits_.enabled) {
    forget();
    return config;
  }
  local_text_ = std::move(*text);
  report_.since_ms = now.utc_ms;
  take_kept(now);
  const bool is_trial = kept_.trying.has_value();
  if (is_trial)
    if (auto on_trial = start_with(kept_.trying, now)) {
      trial_.emplace(trial_time_, now.steady, /*is_connected=*/false);
      report_in_force();
      is_news_ = false;
      return std::move(*on_trial);
    }
  if (is_trial) kept_.trying.reset();
  if (auto good = start_with(kept_.good, now)) return std::move(*good);
  return config;
}

/// What is on disk, and what the end of the last process says of it.
void RemoteConfig::take_kept(Moment now) {
  if (!file_) return;
  const auto text = file_->read(kMaxKeptBytes);
  if (!text)
    return log::error("remote_config",
                      {{"note", "the kept config cannot be read"}, {"reason", text.error()}});
  if (!*text) return;
  auto kept = kept_configs_from(**text);
  if (!kept)
    return log::error("remote_config", {{"note", "the kept config is damaged and left out"},
                                        {"file", file_->path()},
                                        {"reason", kept.error()}});
  kept_ = std::move(*kept);
  // What was kept was said when it came.
  if (kept_.good) report(State::applied, kept_.good->document, {}, kept_.good->since_ms);
  if (kept_.rolled_back) report_rolled_back();
  is_news_ = false;
  if (kept_.trying && kept_.stopped) {
    // From now on an end is the config's own fault again.
    kept_.stopped = false;
    if (const std::string why = save(); !why.empty()) {
      log::warn("remote_config",
                {{"note", "the trial cannot go on: the disk refuses"}, {"reason", why}});
      kept_.trying.reset();
    }
  } else if (kept_.trying) {
    const DesiredConfig& document = kept_.trying->document;
    kept_.rolled_back = {document.hash, document.version,
                         "the process ended while the config was on trial", now.utc_ms};
    kept_.trying.reset();
    save_or_say("the rollback");
    report_rolled_back();
  }
}

std::optional<Config> RemoteConfig::start_with(const std::optional<KeptConfig>& kept, Moment now) {
  if (!kept) return std::nullopt;
  auto config = with(local_text_, kept->document);
  if (!config) {
    rejected_ = kept->document.text;
    report(State::rejected, kept->document, std::move(config.error()), now.utc_ms);
    return std::nullopt;
  }
  in_force_ = kept;
  return std::move(*config);
}

// ---- the local file -----------------------------------------------------------------------------

tl::expected<RemoteConfig::Next, ConfigErrors> RemoteConfig::read_local() const {
  auto text = read_config_file(path_);
  if (!text) return tl::unexpected(std::move(text.error()));
  auto config = local(*text);
  if (!config) return tl::unexpected(std::move(config.error()));
  Next next;
  if (config->remote.enabled && in_force_) {
    if (auto both = with(*text, in_force_->document)) {
      *config = std::move(*both);
      next.document = in_force_;
    } else {
      next.misfit = std::move(both.error());
    }
  }
  next.limits = config->remote;
  next.config = std::move(*config);
  next.local_text = std::move(*text);
  return next;
}

void RemoteConfig::settle_local_file(Next next, Moment now) {
  limits_ = std::move(next.limits);
  if (!limits_.enabled) return forget();
  has_answer_ = true;  // the hash of the config in force may be another
  if (local_text_.empty()) report_.since_ms = now.utc_ms;
  local_text_ = std::move(next.local_text);
  local_since_ms_ = now.utc_ms;
  if (next.misfit.empty()) return;
  rejected_ = in_force_->document.text;
  report(State::rejected, in_force_->document, std::move(next.misfit), now.utc_ms);
  in_force_.reset();
  trial_.reset();
  kept_.good.reset();
  kept_.trying.reset();
  save_or_say("that the local file alone is in force");
}

// ---- what comes from afar -----------------------------------------------------------------------

std::optional<RemoteConfig::Next> RemoteConfig::hear(std::string_view payload, Moment now) {
  if (!limits_.enabled) return std::nullopt;
  if (payload.empty()) return withdraw(now);
  ReadDesired read = read_desired(payload);
  if (answer_known(read.desired)) return std::nullopt;
  const auto reject = [&](ConfigErrors errors) {
    rejected_ = payload.size() <= kMaxDesiredBytes ? payload : std::string_view();
    report(State::rejected, read.desired, std::move(errors), now.utc_ms);
    return std::nullopt;
  };
  if (!read.errors.empty()) return reject(std::move(read.errors));
  auto config = with(local_text_, read.desired);
  if (!config) return reject(std::move(config.error()));
  if (const std::string why = keep_for_trial(read.desired, now); !why.empty())
    return reject({{"", 0,
                    "cannot be kept on disk for a way back, and agent.remote_without_disk of the "
                    "local file is not set: " +
                        why}});
  rejected_.clear();
  Next next;
  next.why = Next::Why::desired;
  next.config = std::move(*config);
  next.document = KeptConfig{std::move(read.desired), now.utc_ms};
  return next;
}

/// What comes again with each connection is answered again, and nothing else.
bool RemoteConfig::answer_known(const DesiredConfig& desired) {
  if (in_force_ && in_force_->document.hash == desired.hash) {
    rejected_.clear();
    report_in_force();
    return true;
  }
  const auto& back = kept_.rolled_back;
  if (!back || back->hash != desired.hash) return false;
  report_rolled_back();
  return true;
}

/// Before the config is in force: what it may do to the process must find this on disk. Empty: it
/// is, or the local file does without.
std::string RemoteConfig::keep_for_trial(const DesiredConfig& desired, Moment now) {
  KeptConfigs before = kept_;
  kept_.trying = KeptConfig{desired, now.utc_ms};
  kept_.stopped = false;
  kept_.rolled_back.reset();
  std::string why = save();
  if (why.empty()) return why;
  if (!limits_.without_disk) {
    kept_ = std::move(before);
    return why;
  }
  log::warn("remote_config",
            {{"note",
              "the config is taken over and cannot be kept: after a crash nothing is known "
              "of it (agent.remote_without_disk)"},
             {"reason", why}});
  return {};
}

std::optional<RemoteConfig::Next> RemoteConfig::withdraw(Moment now) {
  const bool was_in_force = in_force_.has_value();
  if (!was_in_force && report_.desired.hash.empty()) {
    has_answer_ = true;  // somebody asks
    return std::nullopt;
  }
  kept_ = {};
  rejected_.clear();
  save_or_say("that the config was withdrawn");
  if (!was_in_force) {
    report(State::applied, {}, {}, now.utc_ms);
    return std::nullopt;
  }
  auto config = local(local_text_);
  if (!config) return std::nullopt;  // it was right when it was read, and memory is what it was
  Next next;
  next.why = Next::Why::withdrawn;
  next.config = std::move(*config);
  return next;
}

// ---- the trial ----------------------------------------------------------------------------------

void RemoteConfig::connection(bool is_up, SteadyTime now) {
  is_connected_ = is_up;
  if (trial_) trial_->connection(is_up, now);
}

SteadyTime RemoteConfig::next_wake() const {
  const SteadyTime decided = trial_ ? trial_->decided_at() : SteadyTime::max();
  return is_unsaved_ ? std::min(decided, save_again_at_) : decided;
}

std::optional<RemoteConfig::Next> RemoteConfig::due(Moment now) {
  save_again(now.steady);
  const auto verdict = trial_ ? trial_->verdict(now.steady) : Trial::Verdict::pending;
  if (verdict == Trial::Verdict::pending) return std::nullopt;
  trial_.reset();
  kept_.trying.reset();
  if (verdict == Trial::Verdict::good) {
    kept_.good = in_force_;
    save_or_say("that the config is good");
    has_answer_ = true;
    return std::nullopt;
  }
  const DesiredConfig& document = in_force_->document;
  const auto seconds = std::chrono::duration_cast<std::chrono::seconds>(trial_time_);
  kept_.rolled_back = {document.hash, document.version,
                       "the broker was lost for " + std::to_string(seconds.count()) +
                           " s while the config was on trial",
                       now.utc_ms};
  save_or_say("the rollback");
  Next next;
  next.why = Next::Why::rolled_back;
  auto config = kept_.good ? with(local_text_, kept_.good->document) : local(local_text_);
  if (config) next.document = kept_.good;
  if (!config) config = local(local_text_);
  if (!config) return std::nullopt;
  next.config = std::move(*config);
  return next;
}

void RemoteConfig::accept(Next next, Moment now) {
  switch (next.why) {
    case Next::Why::local_file:
      return settle_local_file(std::move(next), now);
    case Next::Why::desired:
      in_force_ = std::move(next.document);
      trial_.emplace(trial_time_, now.steady, is_connected_);
      return report_in_force();
    case Next::Why::withdrawn:
      in_force_.reset();
      trial_.reset();
      return report(State::applied, {}, {}, now.utc_ms);
    case Next::Why::rolled_back:
      in_force_ = std::move(next.document);
      return report_rolled_back();
  }
}

void RemoteConfig::refuse(const Next& next, ConfigErrors errors, Moment now) {
  if (next.why != Next::Why::desired) return;
  kept_.trying = trial_ ? in_force_ : std::nullopt;
  save_or_say("that the config was rejected");
  report(State::rejected, next.document->document, std::move(errors), now.utc_ms);
}

void RemoteConfig::stop() {
  if (!kept_.trying) return;
  kept_.stopped = true;
  save_or_say("that the agent was stopped during a trial");
}

// ---- what is kept and what is said --------------------------------------------------------------

std::string RemoteConfig::save() {
  if (!file_) return "there is no store, and no STATE_DIRECTORY of systemd";
  return kept_.empty() ? file_->remove() : file_->write(to_text(kept_));
}

void RemoteConfig::save_again(SteadyTime now) {
  if (!is_unsaved_ || now < save_again_at_) return;
  save_again_at_ = now + kSaveAgain;
  is_unsaved_ = !save().empty();
}

void RemoteConfig::save_or_say(std::string_view what) {
  const std::string why = save();
  is_unsaved_ = file_ && !why.empty();
  if (why.empty() || !file_) return;  // without a place that was said when the config came
  log::error("remote_config", {{"note", std::string(what) + " cannot be kept on disk: after a "
                                                            "restart it is not known"},
                               {"reason", why}});
}

void RemoteConfig::forget() {
  kept_ = {};
  in_force_.reset();
  trial_.reset();
  local_text_.clear();
  rejected_.clear();
  report_ = {};
  has_answer_ = false;
  is_news_ = false;
  const std::string why = file_ ? file_->remove() : std::string();
  if (!why.empty())
    log::warn("remote_config", {{"note", "a kept config cannot be removed"}, {"reason", why}});
}

void RemoteConfig::report(State state, const DesiredConfig& desired, ConfigErrors errors,
                          std::int64_t since_ms) {
  const bool is_same = report_.state == state && report_.desired.hash == desired.hash &&
                       same_errors(report_.errors, errors);
  if (!is_same) report_ = {state, without_text(desired), std::move(errors), since_ms};
  if (!is_same) is_news_ = true;
  has_answer_ = true;
}

void RemoteConfig::report_rolled_back() {
  const RolledBackConfig& back = *kept_.rolled_back;
  report(State::rolled_back, {"", back.hash, back.version, ""}, {{"", 0, back.why}}, back.since_ms);
}

void RemoteConfig::report_in_force() {
  if (in_force_)
    report(State::applied, in_force_->document, {}, in_force_->since_ms);
  else
    report(State::applied, {}, {}, local_since_ms_);
}

std::string RemoteConfig::reported(const std::string& hash) const {
  const auto word = [](const std::string& text) {
    return text.empty() ? nlohmann::ordered_json(nullptr) : nlohmann::ordered_json(text);
  };
  nlohmann::ordered_json out;
  out["version"] = word(report_.desired.version);
  out["hash"] = hash;
  out["state"] = to_string(report_.state);
  auto& errors = out["errors"] = nlohmann::ordered_json::array();
  std::size_t bytes = 0;
  for (const ConfigError& error : report_.errors) {
    std::string text = text_of(error);
    bytes += text.size();
    if (errors.size() == kMostReportedErrors || bytes > kMostReportedBytes) break;
    errors.push_back(std::move(text));
  }
  out["errors_in_all"] = report_.errors.size();
  out["since"] = report_.since_ms;
  out["desired_hash"] = word(report_.desired.hash);
  out["in_force"] = in_force_ ? word(in_force_->document.version) : nullptr;
  out["confirmed"] = !trial_.has_value();
  return out.dump(-1, ' ', false, nlohmann::ordered_json::error_handler_t::replace);
}

std::optional<ConfigStatus::Remote> RemoteConfig::status() const {
  if (!limits_.enabled) return std::nullopt;
  return ConfigStatus::Remote{in_force_ ? in_force_->document.version : "",
                              std::string(to_string(report_.state)), !trial_.has_value()};
}

}  // namespace fxagent
