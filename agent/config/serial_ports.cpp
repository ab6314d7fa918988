#include "agent/config/serial_ports.h"

#include <unistd.h>

#include <cerrno>
#include <system_error>

#include "agent/config/read/tree.h"
#include "agent/process/port_access.h"

namespace fxagent {
namespace {

constexpr std::string_view kOurName = "fxagent";

/// Returns why the agent that runs `file` cannot use this port; empty if it can.
std::string why_no_port(const std::string& path, const std::string& file) {
  if (::access(path.c_str(), R_OK | W_OK) != 0) {
    const int error = errno;
    return shown(path) + " cannot be opened: " + std::generic_category().message(error) +
           port_cure(path, error);
  }
  const auto holder = port_holder(path);
  if (!holder) return {};
  const bool is_agent = holder->program == kOurName;
  if (is_agent && is_called_with(holder->pid, file)) return {};
  return shown(path) + " is in use by another program: " + holder->program + ", pid " +
         std::to_string(holder->pid) + (is_agent ? ", which runs another config" : "");
}

}  // namespace

std::vector<ConfigError> unavailable_ports(const Config& config, const std::string& file) {
  std::vector<ConfigError> list;
  for (std::size_t i = 0; i < config.links.size(); ++i) {
    const auto* serial = std::get_if<SerialSettings>(&config.links[i].channel);
    if (serial == nullptr) continue;
    if (auto why = why_no_port(serial->path, file); !why.empty())
      list.push_back({"/links/" + std::to_string(i) + "/serial/path", 0, std::move(why)});
  }
  return list;
}

}  // namespace fxagent
