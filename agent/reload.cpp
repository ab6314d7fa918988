#include "agent/reload.h"

#include <malloc.h>
#include <pthread.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <mutex>
#include <optional>
#include <utility>

#include "agent/commands/audit_records.h"
#include "agent/config/config_error.h"
#include "agent/config/machine.h"
#include "agent/failpoint.h"
#include "agent/field/transport/host_lookup.h"
#include "agent/http/web_server.h"
#include "agent/log/log.h"
#include "agent/process/service_manager.h"
#include "agent/process/this_process.h"
#include "agent/uplink/broker.h"
#include "agent/uplink/own_topics.h"
#include "agent/without_signals.h"

namespace fxagent {
namespace {

RemoteConfig::Moment moment() { return {std::chrono::steady_clock::now(), utc_now_ms()}; }

/// Takes a SIGHUP. Returns its sender; nullopt: none came within `patience`.
std::optional<pid_t> hangup_by(std::chrono::nanoseconds patience) {
  sigset_t signals;
  sigemptyset(&signals);
  sigaddset(&signals, SIGHUP);
  const auto whole = std::chrono::floor<std::chrono::seconds>(patience);
  const timespec limit{.tv_sec = whole.count(),
                       .tv_nsec = static_cast<long>((patience - whole).count())};
  siginfo_t heard{};
  if (sigtimedwait(&signals, &heard, &limit) != SIGHUP) return std::nullopt;
  return heard.si_pid;
}

void set(std::atomic<bool>& done) {
  done = true;
  done.notify_all();
}

}  // namespace

void log_errors(const ConfigErrors& errors, const std::string& path) {
  for (const ConfigError& error : errors)
    log::error("config", {{"state", "rejected"}, {"error", to_string(error, path)}});
}

bool hangup_within(std::chrono::seconds patience) { return hangup_by(patience).has_value(); }

void check_local(const Config& running, const std::string& path, const RemoteConfig& remote) {
  service_manager::notify_reloading();
  const auto next = remote.read_local();
  const ConfigErrors errors =
      next ? needs_restart(running, next->config, next->local.text) : next.error();
  log_errors(errors, path);
  if (errors.empty())
    log::info("config", {{"state", "checked"},
                         {"hash", next->config.hash},
                         {"note",
                          "no errors; this gateway is on standby, and applies the file when it "
                          "takes over"}});
  else
    log::warn("config", {{"state", "rejected"},
                         {"errors", std::to_string(errors.size())},
                         {"note",
                          "this gateway is on standby, and reads the file again when it takes "
                          "over; if it has an error then, the config of the start is in force"},
                         {"hash", running.hash}});
  malloc_trim(0);  // returns the memory that a large file took
  service_manager::notify_ready();
}

std::size_t files_needed(const Config& config) {
  const auto links = std::ranges::count_if(
      config.links, [](const LinkConfig& link) { return !link.name.empty(); });
  return static_cast<std::size_t>(links) + static_cast<std::size_t>(kFilesNotForLinks) +
         (config.http ? WebServer::kMostFiles : 0);
}

Reload::Reload(std::string path, RemoteConfig& remote, std::shared_ptr<const Config> running,
               Field& field, Outbox& outbox, Publisher& publisher, TakeBack take_back, Begin begin)
    : path_(std::move(path)),
      remote_(remote),
      running_(std::move(running)),
      field_(field),
      outbox_(outbox),
      publisher_(publisher),
      take_back_(std::move(take_back)),
      applied_(std::make_shared<std::atomic<bool>>(false)) {
  status_.hash = running_->hash;
  status_.since_ms = utc_now_ms();
  listen();
  has_reported_ = remote_.take_left_answer();
  report(Log::always);
  const WithoutSignals quiet;
  thread_ = std::thread([this, begin] { run(begin); });
}

Reload::~Reload() {
  stop();
  thread_.join();
}

void Reload::stop() {
  if (stopping_.exchange(true)) return;
  remote_.interrupt();
  set(*applied_);
  wake();
}

bool Reload::wait_for_end(std::chrono::nanoseconds patience) {
  return end_.wait_for(patience) == std::future_status::ready;
}

// ---- events -------------------------------------------------------------------------------------

/// The listeners may hold `this`: the uplink ends before this object.
void Reload::listen() {
  OwnTopics::ConfigListener listener;
  listener.desired = [this](std::string payload) {
    const std::lock_guard lock(mutex_);
    news_.desired = std::move(payload);
    wake();
  };
  listener.connection = [this](bool connected, SteadyTime now) {
    const std::lock_guard lock(mutex_);
    news_.connected = connected;
    news_.connected_at = now;
    wake();
  };
  outbox_.post([&publisher = publisher_, listener](SteadyTime) {
    publisher.own_topics().set_config_listener(listener);
  });
}

void Reload::wake() { pthread_kill(thread_.native_handle(), SIGHUP); }

bool Reload::wait() {
  const auto left = remote_.next_wake() - std::chrono::steady_clock::now();
  // The C library does not distinguish pthread_kill() from kill(); a signal of this process is
  // wake().
  // No longer than a day: old kernels of 32-bit machines take no wait beyond 2038.
  const auto wait = std::clamp<SteadyTime::duration>(left, {}, std::chrono::hours(24));
  return hangup_by(wait).value_or(::getpid()) != ::getpid();
}

void Reload::run(Begin begin) {
  if (begin == Begin::with_reload) reload();
  while (true) {
    const bool is_meant = wait();
    if (stopping_) break;
    if (is_meant) reload();
    if (!stopping_) look_at_news();
  }
  remote_.stop();
  ended_.set_value();
}

void Reload::look_at_news() {
  std::unique_lock lock(mutex_);
  const News news = std::exchange(news_, {});
  lock.unlock();
  if (news.connected) remote_.set_connected(*news.connected, news.connected_at);
  if (auto next = remote_.due(moment())) take_over(std::move(*next));
  if (news.desired && !stopping_) hear(*news.desired);
  if (!stopping_ && remote_.answer().is_due()) report();
}

// ---- the local file -----------------------------------------------------------------------------

void Reload::reload() {
  service_manager::notify_reloading();
  log::info("config", {{"state", "reading"}, {"file", path_}});
  std::optional<Next> next;
  try {
    next = wanted();
  } catch (const std::exception& error) {  // out of memory, for example
    reject(not_built(error));
  }
  if (next) {
    const std::string hash = next->config.hash;
    const bool is_fit = next->misfit.empty();
    if (!change_between(*running_, next->config).empty()) {
      take_over(std::move(*next));
      if (!stopping_) say("applied", {});
    } else {
      remote_.accept(std::move(*next), moment());
      status_.hash = hash;
      log::info("config", {{"state", "unchanged"}, {"hash", status_.hash}});
      say("unchanged", {});
    }
    if (is_fit && !stopping_ && !remote_.answer().rejected().empty())
      hear(std::string(remote_.answer().rejected()));
    if (!stopping_) report();  // a remote config that was rejected may be in force now
  }
  malloc_trim(0);  // returns the memory that a large file took
  if (!stopping_) service_manager::notify_ready();
}

std::optional<Reload::Next> Reload::wanted() {
  auto next = remote_.read_local();
  if (!next) {
    if (!stopping_) reject(next.error());
    return std::nullopt;
  }
  const ConfigErrors errors = needs_restart(*running_, next->config, next->local.text);
  if (!errors.empty()) {
    reject(errors);
    return std::nullopt;
  }
  log_warnings(next->config);
  return std::move(*next);
}

// ---- remote configs -----------------------------------------------------------------------------

void Reload::hear(const std::string& desired) {
  if (auto next = remote_.receive(desired, moment())) take_over(std::move(*next));
  malloc_trim(0);
}

void Reload::take_over(Next next) {
  // In a pair, a remote config with other mqtt.servers needs a restart.
  if (const ConfigErrors errors = needs_restart(*running_, next.config); !errors.empty())
    return remote_.refuse(next, errors, moment());
  const bool is_desired = next.why == Next::Why::desired;
  if (is_desired) failpoint("remote_config_kept");
  if (!apply(std::exchange(next.config, {}))) return;
  remote_.accept(std::move(next), moment());
  if (is_desired) failpoint("remote_config_applied");
}

bool Reload::apply(Config config) {
  ConfigChange change = change_between(*running_, std::move(config));
  if (change.empty()) {
    status_.hash = change.config.hash;
    return true;
  }
  const auto began = std::chrono::steady_clock::now();
  const auto shared = std::make_shared<const ConfigChange>(std::move(change));
  const std::string what = to_string(*shared, *running_);
  log::info("config", {{"state", "applying"}, {"change", what}});
  *applied_ = false;
  if (stopping_) return false;
  // Order: the uplink stops using the parts that end, the pair gives back those of their commands
  // that still wait, the field ends the parts, the uplink forgets them, the field starts the new
  // ones. Each step sees everything that the previous one left.
  Field& field = field_;
  Outbox& outbox = outbox_;
  Publisher& publisher = publisher_;
  const auto begin = [&field, &publisher, shared, done = applied_](SteadyTime now) {
    auto last_seq = publisher.change(*shared, now);
    if (!last_seq) return set(*done);
    field.begin(shared, std::move(*last_seq), [done] { set(*done); });
  };
  outbox.post([&field, &outbox, &publisher, take_back = take_back_, shared, begin](SteadyTime) {
    publisher.begin_change(*shared);
    take_back(shared->devices_end, [&field, &outbox, shared, begin] {
      field.end(shared, [&outbox, begin] { outbox.post(begin); });
    });
  });
  applied_->wait(false);
  if (stopping_) return false;
  // Frees what only the old config owned here, and not on the field or uplink thread.
  running_ = {shared, &shared->config};
  status_.hash = running_->hash;
  status_.since_ms = utc_now_ms();
  status_.change = what;
  const auto took = std::chrono::duration_cast<std::chrono::milliseconds>(
      std::chrono::steady_clock::now() - began);
  log::info(
      "config",
      {{"state", "applied"}, {"hash", status_.hash}, {"took_ms", std::to_string(took.count())}});
  check_file_limit(files_needed(*running_));
  return true;
}

// ---- reports ------------------------------------------------------------------------------------

void Reload::reject(const ConfigErrors& errors) {
  log_errors(errors, path_);
  log::warn("config", {{"state", "rejected"},
                       {"errors", std::to_string(errors.size())},
                       {"note", "nothing was changed; the earlier config stays in force"},
                       {"hash", status_.hash}});
  say("rejected", errors);
}

void Reload::say(const std::string& state, const ConfigErrors& errors) {
  ConfigStatus::Reload reload;
  reload.state = state;
  reload.ts_ms = utc_now_ms();
  const std::size_t unlisted = errors.empty() ? 0 : errors.front().unlisted;
  reload.errors_in_all = errors.size() + unlisted - (unlisted > 0 ? 1 : 0);
  for (std::size_t i = 0; i < std::min(errors.size(), kErrorsInHealth); ++i)
    reload.errors.push_back(to_string(errors[i], path_));
  const std::string more = reload.errors_in_all > 1
                               ? " (and " + std::to_string(reload.errors_in_all - 1) + " more)"
                               : "";
  const std::size_t first = unlisted > 0 && errors.size() > 1 ? 1 : 0;  // after the number
  service_manager::notify_status(
      errors.empty() ? "reload: config " + state + ", " + status_.hash
                     : "reload rejected, nothing changed: " + reload.errors[first] + more);
  status_.last_reload = std::move(reload);
  publish_status();
}

void Reload::publish_status() {
  status_.remote = remote_.status();
  outbox_.post([&publisher = publisher_, status = status_](SteadyTime now) {
    publisher.set_config_status(status, now);
  });
}

void Reload::log_report() {
  const RemoteReport& report = remote_.answer().last();
  const std::string& version = report.desired.version;
  const std::size_t shown_errors = std::min(report.errors.size(), kErrorsInHealth);
  for (std::size_t i = 0; i < shown_errors; ++i)
    log::error("remote_config", {{"version", log::excerpt(version)},
                                 {"error", log::excerpt(text_of(report.errors[i]))}});
  log::info("remote_config", {{"state", std::string(to_string(report.state))},
                              {"version", log::excerpt(version)},
                              {"by", log::excerpt(report.desired.by)},
                              {"desired_hash", report.desired.hash},
                              {"errors", std::to_string(report.errors_in_all)},
                              {"hash", status_.hash}});
}

std::string Reload::audit_record() const {
  const RemoteReport& report = remote_.answer().last();
  audit::ConfigReceipt receipt;
  receipt.version = report.desired.version;
  receipt.by = report.desired.by;
  receipt.state = to_string(report.state);
  receipt.desired_hash = report.desired.hash;
  receipt.hash = status_.hash;
  for (const ConfigError& error : report.errors) receipt.errors.push_back(text_of(error));
  receipt.errors_in_all = report.errors_in_all;
  return audit::config(receipt, running_->base_topic() + std::string(kDesiredTopic), utc_now_ms());
}

/// Reports to the broker, and to log and audit if the report is new. Then publishes the status.
void Reload::report(Log when) {
  const bool is_news = remote_.take_news();
  const bool had_reported = std::exchange(has_reported_, remote_.is_enabled());
  if (has_reported_) {
    if (is_news || when == Log::always) log_report();
    outbox_.post([&publisher = publisher_, text = remote_.report_text(status_.hash),
                  audit = is_news ? audit_record() : std::string()](SteadyTime) {
      publisher.own_topics().report_config(text, audit);
    });
  } else if (had_reported) {
    outbox_.post(
        [&publisher = publisher_](SteadyTime) { publisher.own_topics().report_config({}, {}); });
  }
  publish_status();
}

}  // namespace fxagent
