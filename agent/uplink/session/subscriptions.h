// The subscriptions of a connection, and the broker's answers to them. Repeats those that the
// broker refuses, and the one to commands until it is granted. Uplink thread. Time is an argument.
#pragma once

#include <functional>
#include <optional>
#include <set>
#include <string>

#include "agent/steady_time.h"
#include "agent/uplink/broker.h"
#include "agent/uplink/jittered_backoff.h"

namespace fxagent {

class Subscriptions final {
 public:
  /// All references outlive the object. `base` is the beginning of the agent's topics. `changed` is
  /// called when commands are received, or no longer received: not_heard_why() gives the reason.
  Subscriptions(std::string base, Broker& broker, JitteredBackoff& backoff,
                std::function<void()> changed);

  /// Subscribes to everything.
  void connection_began(SteadyTime now);
  void connection_ended();
  void on(const Subscribed& event, SteadyTime now);
  /// Does what is due. `may_hear`: after pause_commands(), enough results have been delivered to
  /// subscribe to commands again.
  void step(SteadyTime now, bool may_hear);
  /// Returns the time by which step() must run again.
  SteadyTime next_wake() const;

  /// Unsubscribes from commands. Call when more commands arrive than can be answered and they
  /// cannot be held back: they would fill the memory. not_heard_why() gives this reason until
  /// commands are received again.
  void pause_commands(SteadyTime now);
  bool is_paused() const { return paused_; }
  /// Unsubscribes from commands for the shutdown, which not_heard_why() gives as the reason.
  void end_commands();
  /// Subscribes to {base}/config/desired, or unsubscribes.
  void hear_configs(bool heard);
  /// Lets each refusal be logged again. Call if the broker or its settings may have changed.
  void forget_refusals() { refused_filters_.clear(); }

  /// True while retained topics of removed devices are searched for.
  bool looks_for_leftovers() const { return leftovers_until_.has_value(); }
  /// True while the first SUBACK is neither received nor overdue, so that it is not known if
  /// commands are received.
  bool awaits_first_suback() const { return suback_by_ && !not_heard_why_; }
  bool awaits_suback() const { return suback_by_.has_value(); }
  /// Reason why commands are not received; nullopt: they are.
  const std::optional<std::string>& not_heard_why() const { return not_heard_why_; }

 private:
  void subscribe_to_commands(SteadyTime now);
  void unheard(const std::string& reason, SteadyTime now);

  const std::string base_;
  const std::string commands_filter_;
  const std::string configs_filter_;
  Broker& broker_;
  JitteredBackoff& backoff_;
  const std::function<void()> changed_;

  bool is_connected_ = false;
  bool hears_configs_ = false;
  std::optional<SteadyTime> leftovers_until_;  ///< end of the search for topics of removed devices
  std::set<std::string> refused_filters_;      ///< filters other than for commands; logged once
  std::optional<SteadyTime> ask_refused_at_;   ///< time of the next SUBSCRIBE to these

  // The subscription to commands.
  std::optional<SteadyTime> suback_by_;  ///< deadline of the SUBACK that is awaited
  std::optional<SteadyTime> ask_again_at_;
  int unheard_ = 0;  ///< consecutive refusals and timeouts in this connection
  std::optional<std::string> not_heard_why_;
  bool ended_ = false;   ///< unsubscribed because the agent stops
  bool paused_ = false;  ///< unsubscribed because too many results are pending
};

}  // namespace fxagent
