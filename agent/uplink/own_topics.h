// The agent's own topics in received messages: commands for its devices, remote configs, and its
// retained states. Uplink thread. Time is an argument.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

#include "agent/commands/commands.h"
#include "agent/config/model.h"
#include "agent/steady_time.h"
#include "agent/store/guarded_store.h"
#include "agent/uplink/broker.h"
#include "agent/uplink/commands/command_intake.h"
#include "agent/uplink/commands/result_delivery.h"
#include "agent/uplink/retained/identity_conflict.h"
#include "agent/uplink/retained/retained_state.h"
#include "agent/uplink/session/session.h"
#include "agent/uplink/session/shutdown.h"
#include "agent/uplink/session/subscriptions.h"
#include "agent/uplink/status/status_source.h"

namespace fxagent {

/// Recognizes the agent's own topics. From its retained states it also detects another agent with
/// the same id, and topics of removed devices. Passes on remote configs and the reports on them.
class OwnTopics final {
 public:
  /// Receives each document of {base}/config/desired, if remote configs are on, and each change of
  /// the connection, from the publisher's step().
  struct ConfigListener {
    std::function<void(std::string payload)> desired;
    std::function<void(bool connected, SteadyTime now)> connection;
  };

  /// The parts that the messages concern; all outlive the object.
  struct Parts {
    const Config& config;
    Commands& commands;
    const Session& session;
    const Subscriptions& subscriptions;
    const Shutdown& shutdown;
    const Farewell& farewell;
    const ResultDelivery& results;
    CommandIntake& intake;
    RetainedState& retained;
    StatusSource& status;
    GuardedStore* store = nullptr;  ///< gets the audit records of reports; null: no store
  };
  /// `boot` is the agent's own.
  OwnTopics(Parts parts, std::string boot,
            std::function<bool(const std::string& boot)> is_ours = {});

  /// Processes a message on any topic.
  void hear(const Message& message, SteadyTime now);
  void connection_began(SteadyTime now);
  void connection_ended(SteadyTime now);
  /// The broker has given our session to another client.
  void session_taken_over() { identity_.taken_over(); }

  void set_config_listener(ConfigListener listener) { configs_ = std::move(listener); }
  /// Sets the text of {base}/config/reported, which is published again after each connect. Empty:
  /// the topic is cleared once, and nothing is published there. `audit` is the body of an audit
  /// record; empty: none.
  void report_config(std::string text, std::string audit);

  /// Begins or ends the conflict with another agent. Call after each step's messages.
  void follow_conflict(SteadyTime now);
  /// Returns the boot of the other agent with our id, as last published; nullopt: there is none.
  const std::optional<std::string>& conflict() const { return conflict_; }
  /// Returns the time by which follow_conflict() must run again.
  SteadyTime next_wake() const { return identity_.next_wake(); }

 private:
  void hear_command(const Message& message, std::string_view name);
  void hear_state(const Message& message, SteadyTime now);
  void warn_of_unheard();

  const Parts parts_;
  const std::string base_;
  IdentityConflict identity_;
  std::optional<std::string> conflict_;
  ConfigListener configs_;
};

}  // namespace fxagent
