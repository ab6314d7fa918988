#include "agent/cli/subcommands.h"

#include <algorithm>
#include <iostream>
#include <string_view>
#include <utility>

#include "agent/cli/check/check_target.h"
#include "agent/cli/exit_status.h"
#include "agent/cli/report/plan_report.h"
#include "agent/config/loader.h"
#include "agent/config/machine.h"
#include "agent/config/read/config_limits.h"
#include "agent/config/read/sections.h"
#include "agent/config/source.h"
#include "agent/process/port_access.h"
#include "agent/remote/desired_config.h"
#include "agent/text/text.h"
#include "agent/uplink/paho/tls_files.h"

namespace fxagent {
namespace {

std::string counts(const Config& config) {
  std::size_t tags = 0;
  for (const DeviceConfig& device : config.devices) tags += device.tags.size();
  return counted(config.links.size(), "link") + ", " + counted(config.devices.size(), "device") +
         ", " + counted(tags, "tag");
}

/// Checks the document in the file `desired` as if it arrived on {base}/config/desired.
int check_desired(const std::string& path, const Config& local, const std::string& text,
                  const std::string& desired) {
  const auto refuse = [&desired](const ConfigErrors& errors) {
    print_errors(errors, desired);
    return kWrong;
  };
  if (!local.remote.enabled)
    return refuse(
        {{"", 0,
          "the agent does not accept remote configs: agent.remote_config is not set in " + path}});
  const auto document = read_config_file(desired);
  if (!document) return refuse(document.error());
  if (document->empty()) {
    std::cout << desired << ": valid: empty, so it withdraws the remote config\n";
    return 0;
  }
  const auto [read, faults] = read_desired(*document);
  if (!faults.empty()) return refuse(faults);
  const ConfigLimits limits = remote_limits(local);
  const auto config = effective_config(text, local, read, [&](std::string_view both) {
    return config_of_file(path, both, privacy_of(path), {.limits = limits});
  });
  if (!config) return refuse(config.error());
  for (const std::string& warning : config->warnings)
    std::cerr << desired << ": warning: " << warning << '\n';
  std::cout << desired << ": valid: version " << shown(read.version) << ", with it "
            << counts(*config) << '\n';
  return 0;
}

/// Checks the contents of the TLS files, which check_files() does not. An unreadable file is
/// already in `found`.
std::vector<ConfigError> tls_faults(const Config& config, const std::vector<ConfigError>& found) {
  std::vector<ConfigError> faults;
  for (const auto& [place, mqtt] : brokers_of(config)) {
    const std::string tls = place + "/tls/";
    const auto is_of_it = [&](const ConfigError& error) { return error.pointer.starts_with(tls); };
    if (!mqtt->tls || std::ranges::any_of(found, is_of_it)) continue;
    if (const auto fault = fault_in(*mqtt->tls))
      faults.push_back({tls + std::string(fault->key), 0, fault->text});
  }
  return faults;
}

/// Prints what the broker `target` refuses. Returns the exit status.
int check_for_target(const std::string& path, const Config& config, const std::string& text,
                     const std::string& target) {
  const auto findings = target_findings(config, text, target);
  std::size_t refusals = 0;
  for (const TargetFinding& finding : findings) {
    const bool is_refused = finding.severity == TargetFinding::Severity::refused;
    if (is_refused) ++refusals;
    ConfigError error = finding.error;
    if (!is_refused) error.pointer.insert(0, "warning: ");
    std::cerr << to_string(error, path) << '\n';
  }
  std::cout << path << ": " << broker_of(target) << " refuses "
            << (refusals == 0 ? "nothing" : counted(refusals, "thing")) << " of this config\n";
  return refusals == 0 ? kDone : kFailed;
}

}  // namespace

void print_errors(const std::vector<ConfigError>& errors, const std::string& path) {
  for (const ConfigError& error : errors) std::cerr << to_string(error, path) << '\n';
}

std::optional<Config> loaded(const std::string& path, std::string* text) {
  auto config = load_config(path, text);
  if (config) return std::move(*config);
  print_errors(config.error(), path);
  return std::nullopt;
}

std::optional<Config> loaded_for_lines(const std::string& path, std::string* text) {
  auto config = loaded(path, text);
  if (config && config->pair)
    std::cerr << "note: the other gateway of the pair may use the line now, and this call does not "
                 "ask it. Two masters disturb each other: stop both agents first, or send the "
                 "command over MQTT\n";
  return config;
}

std::optional<int> note_running_agent(const std::string& path) {
  for (const CalledProcess& agent : processes_called("fxagent", "run")) {
    if (!is_called_with(agent.pid, path)) continue;
    std::cerr << "note: fxagent, pid " << agent.pid
              << ", runs this config. It holds each serial port of the config, and a network "
                 "device may accept only one connection. Stop it first, or ask it over MQTT: "
                 "fxagent check --online "
              << path << " prints a command for it\n";
    return agent.pid;
  }
  return std::nullopt;
}

int run_check(const std::string& path, const CheckQuestion& what) {
  if (!what.target.empty())
    if (const std::string fault = target_fault(what.target); !fault.empty())
      return refused("check", fault);
  std::string text;
  const auto config = what.online ? loaded_for_lines(path) : loaded(path, &text);
  if (!config) return kWrong;
  if (!what.desired.empty()) return check_desired(path, *config, text, what.desired);
  for (const std::string& warning : config->warnings)
    std::cerr << path << ": warning: " << warning << '\n';
  const std::vector<ConfigError> files = check_files(*config);
  for (const auto& findings :
       {files, tls_faults(*config, files), unavailable_ports(*config, path), weak_secrets(*config)})
    for (const ConfigError& finding : findings)
      std::cerr << path << ": warning: " << text_of(finding) << '\n';
  for (const std::string& overload : overloads(*config))
    std::cerr << path << ": warning: link " << overload << '\n';
  if (what.online && what.as_json) return run_online_check(*config, path, /*as_json=*/true);
  std::cout << path << ": valid: " << counts(*config) << '\n';
  if (config->remote.enabled)
    std::cout << path << ": a remote config may set: " << to_string(config->remote) << '\n';
  if (config->pair && config->mqtt.servers.size() > 1)
    std::cout
        << path << ": a pair with " << config->mqtt.servers.size()
        << " mqtt.servers needs a cluster: if these are separate brokers, both gateways become "
           "active; then keep one server\n";
  if (!what.target.empty()) return check_for_target(path, *config, text, what.target);
  return what.online ? run_online_check(*config, path, /*as_json=*/false) : 0;
}

}  // namespace fxagent
