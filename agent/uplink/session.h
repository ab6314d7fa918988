// The session with the broker: connects, notices a loss whoever tells it or not, tries the next
// server in time and never in haste, and asks for the subscription to commands until it is granted.
// Uplink thread. Time is an argument. More than twenty functions: five take the broker's news, nine
// say one word about the state.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <set>
#include <string>

#include "agent/config/config.h"
#include "agent/messages.h"
#include "agent/uplink/broker.h"
#include "agent/uplink/jittered_backoff.h"
#include "agent/uplink/outgoing.h"

namespace fxagent {

class Session final {
 public:
  /// Who must know how it goes.
  class Listener {
   public:
    virtual ~Listener() = default;
    /// Connected; what is published now goes to this broker.
    virtual void connection_began(SteadyTime now) = 0;
    /// What was on its way is to be published again.
    virtual void connection_ended(SteadyTime now) = 0;
    virtual void attempt_failed(SteadyTime now) = 0;
    /// The broker has given our session to another client; connection_ended() follows.
    virtual void session_taken_over() = 0;
    /// Commands are heard, or not heard, since now: not_heard_why() says why.
    virtual void subscription_changed() = 0;
  };

  /// All references outlive it. `base`: of the agent's topics.
  Session(const MqttConfig& mqtt, std::string base, Broker& broker, Outgoing& outgoing,
          JitteredBackoff& backoff, Listener& listener);

  void on(const Connected& event, SteadyTime now);
  void on(const ConnectFailed& event, SteadyTime now);
  void on(const Lost& event, SteadyTime now);
  void on(const Disconnected& event, SteadyTime now);
  void on(const Subscribed& event, SteadyTime now);

  /// What is due. `may_hear`: enough results are out for the subscription to be asked for again,
  /// where pause_commands() has ended it.
  void keep(SteadyTime now, bool may_hear);
  /// When keep() has something to do at the latest.
  SteadyTime next_wake() const;

  /// More commands come than can be answered, and they cannot be held back: what they would fill is
  /// memory. not_heard_why() says so until they are heard again.
  void pause_commands(SteadyTime now);
  bool is_paused() const { return paused_; }
  /// Says goodbye and asks the same server for one message at a time. What has come is answered;
  /// what the broker had queued goes with the session, as with every loss.
  void connect_anew(SteadyTime now);
  /// The settings that it was made with are others now, and begin_anew() follows.
  void settings_changed() { server_ = 0; }
  /// Begins with the first server. A connection is ended with a goodbye.
  void begin_anew(SteadyTime now);
  /// Whether {base}/config/desired is heard, from now on.
  void hear_configs(bool heard);
  /// The end: no command is heard any more. A session that was leaving comes back, so that who was
  /// told goodbye hears the last word too.
  void begin_end(SteadyTime now);
  /// Of the end: what is not delivered by now is not delivered.
  void give_up(SteadyTime now);

  bool is_connected() const { return link_ == Link::connected; }
  /// Since when it is as it is: connected, or without a connection; the clock's beginning where
  /// there was none yet.
  SteadyTime since() const { return is_connected() ? connected_at_ : lost_at_; }
  /// The last failure, or why the connection was lost; empty: it is connected, or was never tried.
  const std::string& why_not_connected() const { return why_not_connected_; }
  /// The one of the config that it is connected to, or tries.
  const std::string& server() const { return mqtt_.servers.at(server_); }
  /// Neither connected nor on the way to it.
  bool is_waiting() const { return link_ == Link::waiting; }
  /// Retained topics of devices that are gone are being looked for.
  bool looks_for_leftovers() const { return leftovers_until_.has_value(); }
  /// A connection that lives so long is a good one: nobody throws it off.
  SteadyTime::duration steady_after() const;
  /// The first attempt is not over.
  bool is_starting() const { return starting_; }
  /// Neither confirmed nor overdue: nobody knows yet whether commands are heard.
  bool awaits_first_suback() const { return suback_by_ && !not_heard_why_; }
  bool awaits_suback() const { return suback_by_.has_value(); }
  /// Why commands are not heard; nullopt: they are.
  const std::optional<std::string>& not_heard_why() const { return not_heard_why_; }
  /// How many messages the broker was told that it may send ahead of acknowledgements.
  std::uint16_t receive_maximum() const { return receive_maximum_; }

 private:
  /// leaving: goodbye was said to connect anew, and what was read before it still comes.
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
  Listener& listener_;

  Link link_ = Link::waiting;
  bool starting_ = true;
  std::size_t server_ = 0;
  int failed_rounds_ = 0;              ///< through all servers, none of which took us
  int thrown_rounds_ = 0;              ///< through all servers, none of which kept us for long
  SteadyTime::duration last_pause_{};  ///< between the last loss and the attempt after it
  std::optional<SteadyTime> last_up_;  ///< when there was a connection
  SteadyTime retry_at_{};
  std::string last_failure_;
  std::string why_not_connected_;
  SteadyTime lost_at_{};
  SteadyTime connect_deadline_{};
  SteadyTime connected_at_{};
  SteadyTime look_again_{};               ///< whether the connection is still there
  std::optional<SteadyTime> down_since_;  ///< the library has no connection and has not said so
  std::uint16_t receive_maximum_ = kReceiveMaximum;  ///< until a connection is lost
  std::optional<SteadyTime> leftovers_until_;  ///< looking for retained topics of unknown devices
  std::set<std::string> refused_filters_;      ///< of states and meta; told once

  // the subscription to commands
  std::optional<SteadyTime> suback_by_;  ///< asked for: until when the answer may take
  std::optional<SteadyTime> ask_again_at_;
  int unheard_ = 0;  ///< refusals and silences of this connection, in a row
  std::optional<std::string> not_heard_why_;
  bool hears_configs_ = false;
  bool paused_ = false;  ///< they are not heard since too many results wait
};

}  // namespace fxagent
