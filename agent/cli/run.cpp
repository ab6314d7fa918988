#include "agent/cli/subcommands.h"

#include <malloc.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <cstddef>
#include <cstdint>
#include <exception>
#include <optional>
#include <stdexcept>
#include <string_view>
#include <utility>

#include "agent/agent.h"
#include "agent/cli/exit_status.h"
#include "agent/config/config_error.h"
#include "agent/config/json/tree.h"
#include "agent/config/machine.h"
#include "agent/config/model.h"
#include "agent/config/suggestions.h"
#include "agent/log/log.h"
#include "agent/process/service_manager.h"
#include "agent/process/stop_watchdog.h"
#include "agent/process/this_process.h"
#include "agent/reload.h"
#include "agent/remote/remote_config.h"
#include "agent/steady_time.h"
#include "agent/store/store.h"

namespace fxagent {
namespace {

// Threads: watchdog, log, field and its name lookups, recorder, uplink, reload, three of the store
// and two of the MQTT library.
constexpr int kThreads = 12;
constexpr int kThreadsOfAStore = 3;
constexpr std::size_t kRoomToBegin = std::size_t{16} << 20;

/// Resolves the links to trace to indexes in Config::links. Returns nullopt, after an error on
/// stderr, if a link does not exist. With a remote config in force, or in a gateway of a pair that
/// starts itself anew, an unknown link is only a warning: the agent must still start.
std::optional<std::vector<std::uint32_t>> traced_links(const Config& config,
                                                       const RunQuestion& what,
                                                       const RemoteConfig& remote) {
  const auto status = remote.status();
  const bool is_local = (!status || status->version.empty()) && !was_restarted();

  const auto names = names_in(config.links);
  std::vector<std::uint32_t> links;
  for (const std::string& name : what.traced) {
    const auto found = std::ranges::find(names, name);
    if (found == names.end()) {
      log::say(is_local ? log::Level::error : log::Level::warn, "config",
               "--trace: there is no link " + shown(name) + in_place_of(name, names));
      if (is_local) return std::nullopt;
      continue;
    }
    links.push_back(static_cast<std::uint32_t>(found - names.begin()));
  }
  return links;
}

/// Loads the config, and logs its errors. A gateway of a pair that starts itself anew waits until
/// its file is right: systemd does not start a program again whose config is wrong. SIGHUP repeats
/// the errors. A stop signal ends the process meanwhile.
std::optional<Config> started_config(RemoteConfig& remote, const std::string& path) {
  constexpr std::chrono::seconds kLookAgain{2};
  std::vector<ConfigError> said;
  while (true) {
    auto config = remote.start({std::chrono::steady_clock::now(), utc_now_ms()});
    if (config) return std::move(*config);
    if (!was_restarted()) {
      for (const ConfigError& error : config.error())
        log::say(log::Level::error, "config", to_string(error, path));
      return std::nullopt;
    }
    if (config.error() != said) {
      said = config.error();
      log_errors(said, path);
      log::warn("config", {{"state", "waiting"},
                           {"errors", std::to_string(said.size())},
                           {"note",
                            "this gateway has left its pair until its config has no errors; until "
                            "then, if the other gateway fails, none takes over"}});
    }
    service_manager::notify_status("away from its pair, waits for a config without errors");
    service_manager::notify_alive();
    if (hangup_within(kLookAgain)) said.clear();
  }
}

}  // namespace

int run_until_stopped(const std::string& path, const RunQuestion& what) {
  log::set_level(*log::level_from(what.log_level));
  log::set_format(*log::format_from(what.log_format));
  std::signal(SIGPIPE, SIG_IGN);
  std::signal(SIGUSR1, SIG_IGN);  // until the field uses it to switch traces
  std::signal(SIGUSR2, SIG_IGN);  // and this one to ask for recordings
  std::signal(SIGHUP, SIG_IGN);
  // A file at its size limit counts as a disk that rejects writes; it must not end the process.
  std::signal(SIGXFSZ, SIG_IGN);
  if (const std::string missing = lacks(kThreads, kRoomToBegin); !missing.empty())
    throw std::runtime_error("cannot start: " + missing);
  // Blocked before any thread starts, as the stop signals are by the watchdog. The reload takes it,
  // or this thread before there is a reload.
  sigset_t reload_signal;
  sigemptyset(&reload_signal);
  sigaddset(&reload_signal, SIGHUP);
  pthread_sigmask(SIG_BLOCK, &reload_signal, nullptr);
  std::signal(SIGHUP, SIG_DFL);  // an ignored signal would not stay pending
  StopWatchdog watchdog;
  const log::InBackground background;
  try {
    std::optional<RemoteConfig> remote;
    std::optional<Config> config;
    // Another agent with this store may change the kept remote config until it ends.
    do {
      remote.emplace(path, trial_time(), boot_id());
      config = started_config(*remote, path);
      if (!config) return kWrong;
    } while (!config->store.path.empty() && await_other_agent(config->store));
    const auto traced = traced_links(*config, what, *remote);
    if (!traced) return kWrong;
    // Each profile may have a store of its own, and a pair has a thread.
    const int more =
        kThreadsOfAStore * static_cast<int>(config->profiles.size()) + (config->pair ? 1 : 0);
    if (const std::string missing = lacks(more, 0); more > 0 && !missing.empty())
      throw std::runtime_error("cannot start the profiles or the pair: " + missing);
    malloc_trim(0);  // returns the memory that a large file took
    log_warnings(*config);
    run_agent(std::move(*config), path, *remote, watchdog, *traced);
  } catch (const std::exception& error) {
    log::say(log::Level::error, "agent", std::string("fxagent: ") + error.what());
    return 1;
  }
  return 0;
}

}  // namespace fxagent
