// The MQTT session. Connects, and detects losses even if the library does not report them. Tries
// the next server, with a delay after each round. Repeats the subscription to commands until it is
// granted. Uplink thread. Time is an argument. More than twenty functions: five take the broker's
// events, nine return one fact each.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <set>
#include <string>

#include "agent/config/model.h"
#include "agent/steady_time.h"
#include "agent/uplink/broker.h"
#include "agent/uplink/jittered_backoff.h"
#include "agent/uplink/outgoing.h"

namespace fxagent {

class Session final {
 public:
  /// Receives the changes of the connection. None is empty.
  struct Listener {
    /// Connected; publications go to this broker now.
    std::function<void(SteadyTime now)> connection_began;
    /// Publications in flight must be published again.
    std::function<void(SteadyTime now)> connection_ended;
    std::function<void()> attempt_failed;
    /// The broker has given our session to another client; connection_ended() follows.
    std::function<void()> session_taken_over;
    /// Commands are received, or no longer received: not_heard_why() gives the reason.
    std::function<void()> subscription_changed;
  };

  /// All references outlive the session. `base` is the beginning of the agent's topics.
  Session(const MqttConfig& mqtt, std::string base, Broker& broker, Outgoing& outgoing,
          JitteredBackoff& backoff, Listener listener);

  void on(const Connected& event, SteadyTime now);
  void on(const ConnectFailed& event, SteadyTime now);
  void on(const Lost& event, SteadyTime now);
  void on(const Disconnected& event, SteadyTime now);
  void on(const Subscribed& event, SteadyTime now);

  /// Does what is due. `may_hear`: after pause_commands(), enough results have been delivered to
  /// subscribe to commands again.
  void keep(SteadyTime now, bool may_hear);
  /// Returns the time by which keep() must run again.
  SteadyTime next_wake() const;

  /// Unsubscribes from commands. Call when more commands arrive than can be answered and they
  /// cannot be held back: they would fill the memory. not_heard_why() gives this reason until
  /// commands are received again.
  void pause_commands(SteadyTime now);
  bool is_paused() const { return paused_; }
  /// Disconnects, and connects to the same server again with Receive Maximum 1. Messages received
  /// so far are answered. Messages queued at the broker are lost with the session, as with every
  /// loss.
  void connect_anew(SteadyTime now);
  /// The MQTT settings have changed; begin_anew() follows.
  void settings_changed() { server_ = 0; }
  /// Starts again with the first server. Ends an existing connection with a DISCONNECT.
  void begin_anew(SteadyTime now);
  /// Subscribes to {base}/config/desired, or unsubscribes.
  void hear_configs(bool heard);
  /// Begins the shutdown: unsubscribes from commands. If the session is leaving, it connects again,
  /// so that the broker that received a DISCONNECT also receives the final state.
  void begin_end(SteadyTime now);
  /// Completes the shutdown: publications not delivered yet stay undelivered.
  void give_up(SteadyTime now);

  bool is_connected() const { return link_ == Link::connected; }
  /// Time since which the session has been connected, or without a connection; the clock's epoch if
  /// it has not had one yet.
  SteadyTime since() const { return is_connected() ? connected_at_ : lost_at_; }
  /// Reason of the last failure or loss; empty: connected, or never tried.
  const std::string& why_not_connected() const { return why_not_connected_; }
  /// The server of the config to which the session is connected or connecting.
  const std::string& server() const { return mqtt_.servers.at(server_); }
  /// True if the session is neither connected nor on the way to it.
  bool is_waiting() const { return link_ == Link::waiting; }
  /// True while retained topics of removed devices are searched for.
  bool looks_for_leftovers() const { return leftovers_until_.has_value(); }
  /// Lifetime after which a connection is stable: no other client keeps taking it over.
  SteadyTime::duration steady_after() const;
  /// True until the first attempt to connect has ended.
  bool is_starting() const { return starting_; }
  /// True while the first SUBACK is neither received nor overdue, so that it is not known if
  /// commands are received.
  bool awaits_first_suback() const { return suback_by_ && !not_heard_why_; }
  bool awaits_suback() const { return suback_by_.has_value(); }
  /// Reason why commands are not received; nullopt: they are.
  const std::optional<std::string>& not_heard_why() const { return not_heard_why_; }
  /// Receive Maximum sent to the broker: messages that it may send ahead of acknowledgements.
  std::uint16_t receive_maximum() const { return receive_maximum_; }

 private:
  /// leaving: a DISCONNECT was sent in order to reconnect; events read before it still arrive.
  enum class Link : std::uint8_t { waiting, connecting, connected, leaving };

  void connect(SteadyTime now);
  void end(SteadyTime now);
  void watch(SteadyTime now);
  void keep_subscribed(SteadyTime now, bool may_hear);
  void subscribe_to_commands(SteadyTime now);
  void unheard(const std::string& reason, SteadyTime now);
  void retry_after_failure(SteadyTime now);
  void retry_after_loss(SteadyTime now);

  const MqttConfig& mqtt_;
  const std::string base_;
  const std::string commands_filter_;
  const std::string configs_filter_;
  Broker& broker_;
  Outgoing& outgoing_;
  JitteredBackoff& backoff_;
  const Listener listener_;

  Link link_ = Link::waiting;
  bool starting_ = true;
  std::size_t server_ = 0;
  int failed_rounds_ = 0;              ///< rounds of all servers without a connection
  int thrown_rounds_ = 0;              ///< rounds of all servers without a stable connection
  SteadyTime::duration last_pause_{};  ///< between the last loss and the attempt after it
  std::optional<SteadyTime> last_up_;  ///< last time with a connection
  SteadyTime retry_at_{};
  std::string last_failure_;
  std::string why_not_connected_;
  SteadyTime lost_at_{};
  SteadyTime connect_deadline_{};
  SteadyTime connected_at_{};
  SteadyTime look_again_{};               ///< next check that the connection still exists
  std::optional<SteadyTime> down_since_;  ///< unreported: the library has no connection
  std::uint16_t receive_maximum_ = kReceiveMaximum;  ///< reset when a connection is lost
  std::optional<SteadyTime> leftovers_until_;  ///< end of the search for topics of removed devices
  std::set<std::string> refused_filters_;      ///< filters other than for commands; logged once

  // The subscription to commands.
  std::optional<SteadyTime> suback_by_;  ///< deadline of the SUBACK that is awaited
  std::optional<SteadyTime> ask_again_at_;
  int unheard_ = 0;  ///< consecutive refusals and timeouts in this connection
  std::optional<std::string> not_heard_why_;
  bool hears_configs_ = false;
  bool paused_ = false;  ///< unsubscribed because too many results are pending
};

}  // namespace fxagent
