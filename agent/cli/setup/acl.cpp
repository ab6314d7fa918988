#include "agent/cli/setup/acl.h"

#include <algorithm>
#include <array>
#include <initializer_list>
#include <iostream>
#include <set>
#include <string_view>
#include <vector>

#include "agent/cli/describe/topics.h"
#include "agent/cli/exit_status.h"
#include "agent/text/text.h"
#include "agent/uplink/topics.h"

namespace fxagent {
namespace {

// Topics below {root}/{id}/. Device names are wildcards because the agent also clears retained
// topics of devices that the config no longer has. `state` is also the last will; topics below
// `result` are MQTT 5 response topics.
constexpr std::array<std::string_view, 7> kAgentWrites{
    "state", "health", "+/state", "+/meta", "+/data/#", "+/result", "+/result/#"};
constexpr std::array<std::string_view, 4> kAgentReads{"+/command", "state", "+/state", "+/meta"};
// Only if the config allows remote configs.
constexpr std::array<std::string_view, 1> kConfigsOut{"config/reported"};
constexpr std::array<std::string_view, 1> kConfigsIn{"config/desired"};

/// Returns why `name` cannot be a user in an acl_file and a password_file; empty if it can.
std::string_view user_fault(std::string_view name) {
  if (name.empty()) return "is empty";
  if (name.front() == ' ' || name.back() == ' ') return "begins or ends with a space";
  if (name.find(':') != name.npos) return "has a colon, which is not allowed in a password_file";
  if (std::ranges::any_of(name, is_control)) return "has control characters";
  return {};
}

/// Returns the faults of the names: each that is unusable or appears twice; empty if none.
std::string faults_of(const AclQuestion& what) {
  std::set<std::string_view> taken;
  std::string faults;
  const auto look_at = [&](std::string_view name) {
    std::string_view fault = user_fault(name);
    if (fault.empty() && !taken.insert(name).second) fault = "is named twice";
    if (fault.empty()) return;
    if (!faults.empty()) faults += '\n';
    faults += "the user \"" + std::string(name) + "\" " + std::string(fault);
  };
  look_at(what.agent);
  for (const auto* names : {&what.operators, &what.engineers, &what.viewers})
    std::ranges::for_each(*names, look_at);
  return faults;
}

/// Filters of the profiles' topics.
struct ProfileFilters {
  std::vector<std::string> out;       ///< the agent publishes there
  std::vector<std::string> commands;  ///< from operators
  std::vector<std::string> in;        ///< from others
};

ProfileFilters profile_filters(const Config& config) {
  ProfileFilters filters;
  for (const contract::ProfileTopic& topic : contract::profile_topics(config)) {
    const bool is_sent = topic.sender == contract::Sender::agent;
    if (is_sent) filters.out.push_back(topic.filter());
    if (topic.is_command)
      filters.commands.push_back(topic.filter());
    else if (!is_sent || topic.is_read_back)
      filters.in.push_back(topic.filter());
  }
  return filters;
}

/// Adds a rule for each topic, with `base` in front of it.
template <class Topics = std::initializer_list<std::string_view>>
void add(std::string& out, std::string_view access, std::string_view base, const Topics& topics) {
  for (const std::string_view topic : topics)
    out.append("topic ").append(access).append(" ").append(base).append(topic).append("\n");
}

}  // namespace

tl::expected<std::string, std::string> acl_text(const Config& config, const AclQuestion& what) {
  AclQuestion users = what;
  if (users.agent.empty()) users.agent = config.mqtt.username;
  if (users.agent.empty())
    return tl::unexpected(
        std::string("mqtt.username is not set: name the agent's user with --agent (with "
                    "use_identity_as_username it is the common name of its certificate)"));
  if (const std::string faults = faults_of(users); !faults.empty()) return tl::unexpected(faults);
  if (!users.engineers.empty() && !config.remote.enabled)
    return tl::unexpected(std::string(
        "--engineer names a user who sends configs over MQTT, but agent.remote_config is not set"));

  const std::string base = config.base_topic() + "/";
  std::string out =
      "# Access to " + config.base_topic() +
      ", an acl_file of mosquitto made by `fxagent acl`. A user\n" +
      "# who is not named here has no access. The files of several agents can be joined.\n"
      "\n"
      "# The agent writes what it publishes. It reads the commands for its devices, and its own\n"
      "# states and meta: to restore them if another client overwrites them, to detect another "
      "agent\n"
      "# with its id, and to clear those of devices that are no longer configured.\n"
      "user " +
      users.agent + "\n";
  add(out, "write", base, kAgentWrites);
  add(out, "read", base, kAgentReads);
  if (config.pair) add(out, "readwrite", base, kPairTopics);
  const bool configs = config.remote.enabled;
  if (configs) {
    out += "# It receives remote configs and reports on them.\n";
    add(out, "write", base, kConfigsOut);
    add(out, "read", base, kConfigsIn);
  }
  const ProfileFilters profiles = profile_filters(config);
  if (!profiles.out.empty()) {
    out += "# Its profiles.\n";
    add(out, "write", "", profiles.out);
    add(out, "read", "", profiles.commands);
    add(out, "read", "", profiles.in);
  }
  const auto add_reader = [&](std::string_view role, const std::string& name) {
    out += "\n# " + std::string(role) + "\nuser " + name + "\n";
    add(out, "read", base, kAgentWrites);
    if (config.pair) add(out, "read", base, {"pair/+"});
    if (configs) add(out, "read", base, kConfigsOut);
    add(out, "read", "", profiles.out);
  };
  for (const std::string& name : users.operators) {
    add_reader("Reads everything and sends commands.", name);
    add(out, "write", base, {"+/command"});
    add(out, "write", "", profiles.commands);
  }
  for (const std::string& name : users.engineers) {
    add_reader("Reads everything and sends configs.", name);
    add(out, "readwrite", base, kConfigsIn);
  }
  for (const std::string& name : users.viewers) add_reader("Reads everything.", name);
  return out;
}

int run_acl(const Config& config, const AclQuestion& what) {
  const auto text = acl_text(config, what);
  if (!text) return refused("acl", text.error());
  std::cout << *text;
  return kDone;
}

}  // namespace fxagent
