#include "agent/cli/acl.h"

#include <algorithm>
#include <array>
#include <iostream>
#include <set>
#include <string_view>

namespace fxagent {
namespace {

constexpr int kDone = 0;
constexpr int kWrongQuestion = 2;

// Below {root}/{id}/. Retained topics of devices that the config no longer has are cleared too, so
// that devices are not named one by one. `state` is also the last will; what is below `result` are
// response topics of MQTT 5.
constexpr std::array<std::string_view, 7> kAgentWrites{
    "state", "health", "+/state", "+/meta", "+/data/#", "+/result", "+/result/#"};
constexpr std::array<std::string_view, 4> kAgentReads{"+/command", "state", "+/state", "+/meta"};
constexpr std::array<std::string_view, 1> kOperatorWrites{"+/command"};

/// Why `name` cannot be a user of an acl_file and of a password_file; empty where it can.
std::string_view user_fault(std::string_view name) {
  if (name.empty()) return "is empty";
  if (name.front() == ' ' || name.back() == ' ') return "begins or ends with a blank";
  if (name.find(':') != name.npos) return "has a colon, which ends the name in a password_file";
  const auto is_control = [](char c) { return static_cast<unsigned char>(c) < 0x20 || c == 0x7F; };
  if (std::ranges::any_of(name, is_control)) return "has control characters";
  return {};
}

/// False, and a word on stderr, where a name cannot be used or stands for two roles.
bool are_usable(const AclQuestion& what) {
  std::set<std::string_view> taken;
  const auto is_usable = [&taken](std::string_view name) {
    std::string_view fault = user_fault(name);
    if (fault.empty() && !taken.insert(name).second) fault = "is named twice";
    if (!fault.empty()) std::cerr << "acl: the user \"" << name << "\" " << fault << '\n';
    return fault.empty();
  };
  bool usable = is_usable(what.agent);
  for (const std::string& name : what.operators) usable = is_usable(name) && usable;
  for (const std::string& name : what.viewers) usable = is_usable(name) && usable;
  return usable;
}

template <class Topics>
void print(std::string_view access, const std::string& base, const Topics& topics) {
  for (const std::string_view topic : topics)
    std::cout << "topic " << access << ' ' << base << '/' << topic << '\n';
}

}  // namespace

int run_acl(const Config& config, const AclQuestion& what) {
  AclQuestion users = what;
  if (users.agent.empty()) users.agent = config.mqtt.username;
  if (users.agent.empty()) {
    std::cerr << "acl: mqtt.username is not set: give the agent's user with --agent (with "
                 "use_identity_as_username it is the common name of its certificate)\n";
    return kWrongQuestion;
  }
  if (!are_usable(users)) return kWrongQuestion;

  const std::string base = config.base_topic();
  std::cout
      << "# Access to " << base << ", an acl_file of mosquitto made by `fxagent acl`. A user\n"
      << "# who is not named here has no access. The files of several agents can be joined.\n\n"
      << "# The agent writes what it publishes. It reads the commands for its devices, and its "
         "own\n"
      << "# states and meta: to put them right where somebody else has written there, to notice "
         "another\n"
      << "# agent with its id, and to clear those of devices that are no longer configured.\n"
      << "user " << users.agent << '\n';
  print("write", base, kAgentWrites);
  print("read", base, kAgentReads);
  for (const std::string& name : users.operators) {
    std::cout << "\n# Reads everything and sends commands.\nuser " << name << '\n';
    print("read", base, kAgentWrites);
    print("write", base, kOperatorWrites);
  }
  for (const std::string& name : users.viewers) {
    std::cout << "\n# Reads everything.\nuser " << name << '\n';
    print("read", base, kAgentWrites);
  }
  return kDone;
}

}  // namespace fxagent
