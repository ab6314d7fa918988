// The agents of a plant as their retained topics describe them. Pure: messages in, states out; no
// network, no clock.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace fxagent {

/// A report on {base}/config/reported.
struct FleetReport {
  std::string state;         ///< applied, rejected or rolled_back
  std::string version;       ///< of the answered document; empty: none, or unreadable
  std::string desired_hash;  ///< of the answered document; empty: none
  std::string in_force;      ///< remote version in force; empty: the local file alone
  std::string hash;          ///< of the config in force
  bool confirmed = false;
  std::vector<std::string> errors;
};

/// A document on {base}/config/desired.
struct FleetDesired {
  std::string version;  ///< empty if it could not be read
  std::string hash;     ///< first 16 digits of the SHA-256 of its bytes
};

struct FleetAgent {
  enum class Presence : std::uint8_t { unknown, offline, online };
  Presence presence = Presence::unknown;
  std::optional<std::int64_t> since_ms;  ///< of the state, UTC; none in a last will
  std::string offline_reason;            ///< stopped or lost
  std::string conflict;                  ///< `boot` of another agent with this id
  bool receives_commands = true;
  std::string version;                    ///< of the program, from state or health
  std::optional<std::int64_t> health_ms;  ///< time of the last health message, UTC
  std::string hash;                       ///< of the config in force, from health
  std::optional<FleetReport> report;
  std::size_t reports = 0;  ///< received on {base}/config/reported, the retained one included
  std::optional<FleetDesired> desired;
};

/// Agreement between the config that an agent has and the one that it was sent.
enum class Agreement : std::uint8_t {
  local_file,  ///< nothing is sent: the local file alone
  as_asked,    ///< the document is in force
  on_trial,    ///< the document is in force, and its trial is not over
  /// The agent has applied a document that was not received: this user may not read
  /// config/desired, or the broker has lost the document.
  unread,
  refused,      ///< the agent rejected the document
  rolled_back,  ///< the document was in force and no longer is
  no_answer,    ///< the agent has not answered the document
};

/// True if the agent has refused or rolled back a document, and the broker's document, another one,
/// is in force: the other one was sent without retain, or the broker has it no more.
bool has_refused_another(const FleetAgent& agent);
/// Compares the last report of an agent with the document that the broker has for it.
Agreement agreement_of(const FleetAgent& agent);
/// True unless the document was refused, rolled back or not answered.
bool is_as_asked(Agreement agreement);

class Fleet final {
 public:
  /// `root` is agent.root of the configs: agents are at {root}/{agent}.
  explicit Fleet(std::string root) : root_(std::move(root)) {}

  /// Adds an agent that no message has named so far.
  void add(const std::string& name) { agents_.try_emplace(name); }
  /// Returns the topics to subscribe to: by wildcard, or those of `names` if there are any.
  std::vector<std::string> filters(const std::vector<std::string>& names) const;
  /// Returns the topic {root}/{name}/config/desired.
  std::string desired_topic(const std::string& name) const;
  /// Processes a message. Ignores other topics. An empty payload clears what its topic said.
  void take(std::string_view topic, std::string_view payload);

  /// Returns the agent, or one of which nothing is known.
  const FleetAgent& agent(const std::string& name) const;
  const std::map<std::string, FleetAgent>& agents() const { return agents_; }

 private:
  const std::string root_;
  std::map<std::string, FleetAgent> agents_;
};

}  // namespace fxagent
