#include "agent/reload.h"

#include <malloc.h>
#include <pthread.h>

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <csignal>
#include <mutex>
#include <optional>
#include <utility>

#include "agent/log/log.h"
#include "agent/process/service_manager.h"
#include "agent/process/startup.h"

namespace fxagent {
namespace {

std::int64_t utc_now() { return utc_ms(std::chrono::system_clock::now()); }

sigset_t hangup() {
  sigset_t set;
  sigemptyset(&set);
  sigaddset(&set, SIGHUP);
  return set;
}

}  // namespace

/// Whether field and uplink have taken over the change; shared with the calls that go through them,
/// which may outlive the wait for them.
class Reload::Turn final {
 public:
  void begin() {
    const std::lock_guard lock(mutex_);
    done_ = false;
  }
  void end() {
    {
      const std::lock_guard lock(mutex_);
      done_ = true;
    }
    ended_.notify_all();
  }
  void wait() {
    std::unique_lock lock(mutex_);
    ended_.wait(lock, [this] { return done_; });
  }

 private:
  std::mutex mutex_;
  std::condition_variable ended_;
  bool done_ = false;
};

Reload::Reload(std::string path, std::shared_ptr<const Config> running, Field& field,
               Outbox& outbox, Publisher& publisher)
    : path_(std::move(path)),
      running_(std::move(running)),
      field_(field),
      outbox_(outbox),
      publisher_(publisher),
      turn_(std::make_shared<Turn>()) {
  status_.hash = running_->hash;
  status_.since_ms = utc_now();
  outbox_.ask(
      [&publisher, status = status_](SteadyTime now) { publisher.set_config_status(status, now); });
  const WithoutSignals quiet;
  thread_ = std::thread([this] { run(); });
}

Reload::~Reload() {
  stop();
  thread_.join();
}

void Reload::stop() {
  if (stopping_.exchange(true)) return;
  turn_->end();
  pthread_kill(thread_.native_handle(), SIGHUP);
}

void Reload::run() {
  const sigset_t signals = hangup();
  while (true) {
    int signal = 0;
    sigwait(&signals, &signal);
    if (stopping_) return;
    reload();
    malloc_trim(0);  // what reading a large file took goes back
  }
}

void Reload::reload() {
  service_manager::tell_reloading();
  log::info("config", {{"state", "reading"}, {"file", path_}});
  std::optional<ConfigChange> change;
  try {
    change = wanted();
  } catch (const std::exception& error) {  // memory, for one
    reject({{"", 0, std::string("cannot be taken over: ") + error.what()}});
  }
  if (change) {
    if (!change->empty()) {
      apply(std::move(*change));
    } else {
      status_.hash = change->config.hash;
      log::info("config", {{"state", "unchanged"}, {"hash", status_.hash}});
      say("unchanged", {});
    }
  }
  if (!stopping_) service_manager::tell_ready();
}

std::optional<ConfigChange> Reload::wanted() {
  auto config = load_config(path_);
  if (!config) {
    reject(config.error());
    return std::nullopt;
  }
  if (const Errors errors = needs_restart(*running_, *config); !errors.empty()) {
    reject(errors);
    return std::nullopt;
  }
  for (const std::string& warning : std::exchange(config->warnings, {}))
    log::warn("config", {{"note", warning}});
  for (const ConfigError& secret : exposed_secrets(*config))
    log::warn("config", {{"note", secret.pointer + ": " + secret.text}});
  return change_between(*running_, std::move(*config));
}

void Reload::apply(ConfigChange change) {
  const auto began = std::chrono::steady_clock::now();
  const auto shared = std::make_shared<const ConfigChange>(std::move(change));
  log::info("config", {{"state", "applying"}, {"change", to_string(*shared, *running_)}});
  turn_->begin();
  if (stopping_) return;
  // Uplink, field, uplink, field: nobody asks for what ends; it ends; nothing refers to it; what is
  // new begins. Each step sees all that the one before has left.
  Field& field = field_;
  Outbox& outbox = outbox_;
  Publisher& publisher = publisher_;
  const auto begin = [&field, &publisher, shared, turn = turn_](SteadyTime now) {
    auto last_seq = publisher.change(*shared, now);
    if (!last_seq) return turn->end();
    field.begin(shared, std::move(*last_seq), [turn] { turn->end(); });
  };
  outbox.ask([&field, &outbox, &publisher, shared, begin](SteadyTime) {
    publisher.begin_change(*shared);
    field.end(shared, [&outbox, begin] { outbox.ask(begin); });
  });
  turn_->wait();
  if (stopping_) return;
  // Here, and not on one of their threads, goes what the old config alone has had.
  running_ = {shared, &shared->config};
  status_.hash = running_->hash;
  status_.since_ms = utc_now();
  const auto took = std::chrono::duration_cast<std::chrono::milliseconds>(
      std::chrono::steady_clock::now() - began);
  log::info(
      "config",
      {{"state", "applied"}, {"hash", status_.hash}, {"took_ms", std::to_string(took.count())}});
  say("applied", {});
}

void Reload::reject(const Errors& errors) {
  for (const ConfigError& error : errors)
    log::error("config", {{"state", "rejected"}, {"error", to_string(error, path_)}});
  log::warn("config", {{"state", "rejected"},
                       {"errors", std::to_string(errors.size())},
                       {"note", "nothing was changed; the config of before is in force"},
                       {"hash", status_.hash}});
  say("rejected", errors);
}

void Reload::say(const std::string& state, const Errors& errors) {
  ConfigStatus::Reload reload;
  reload.state = state;
  reload.ts_ms = utc_now();
  reload.errors_in_all = errors.size();
  for (std::size_t i = 0; i < std::min(errors.size(), kErrorsInHealth); ++i)
    reload.errors.push_back(to_string(errors[i], path_));
  const std::string more =
      errors.size() > 1 ? " (and " + std::to_string(errors.size() - 1) + " more)" : "";
  service_manager::tell_status(
      errors.empty() ? "reload: config " + state + ", " + status_.hash
                     : "reload rejected, nothing changed: " + reload.errors.front() + more);
  status_.last_reload = std::move(reload);
  outbox_.ask([&publisher = publisher_, status = status_](SteadyTime now) {
    publisher.set_config_status(status, now);
  });
}

}  // namespace fxagent
