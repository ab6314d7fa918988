// The MQTT session. Connects, and detects losses even if the library does not report them. Its
// ConnectSchedule chooses the next server and the time of the next attempt. Uplink thread. Time is
// an argument.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>

#include "agent/config/model.h"
#include "agent/steady_time.h"
#include "agent/uplink/broker.h"
#include "agent/uplink/jittered_backoff.h"
#include "agent/uplink/outgoing.h"
#include "agent/uplink/session/connect_schedule.h"

namespace fxagent {

class Session final {
 public:
  /// Receives the changes of the connection. None is empty.
  struct Listener {
    /// Connected; publications go to this broker now.
    std::function<void(const Connected& event, SteadyTime now)> connection_began;
    /// Publications in flight must be published again.
    std::function<void(SteadyTime now)> connection_ended;
    std::function<void()> attempt_failed;
    /// The broker has given our session to another client; connection_ended() follows.
    std::function<void()> session_taken_over;
  };

  /// All references outlive the session; `mqtt` has the servers. `profile` names it in the log;
  /// empty: it is the agent's own. `will`: at a disconnect; a server that acknowledges nothing is
  /// always left with Will::published.
  Session(Broker& broker, Outgoing& outgoing, const MqttConfig& mqtt, JitteredBackoff& backoff,
          Listener listener, std::string profile = {}, Will will = Will::discarded);

  void on(const Connected& event, SteadyTime now);
  void on(const ConnectFailed& event, SteadyTime now);
  void on(const Lost& event, SteadyTime now);
  void on(const Disconnected& event, SteadyTime now);

  /// Does what is due.
  void keep(SteadyTime now);
  /// Returns the time by which keep() must run again.
  SteadyTime next_wake() const;

  /// Disconnects, and connects to the same server again with Receive Maximum 1. Messages received
  /// so far are answered. Messages queued at the broker are lost with the session, as with every
  /// loss. Call only while is_connected().
  void reconnect_one_at_a_time(SteadyTime now);
  /// Abandons the present connection or attempt, and starts again with the first server.
  void restart(SteadyTime now);
  /// Leaves this server and connects to the next one, not before 2 s are over.
  /// Call only while is_connected().
  void go_to_next(SteadyTime now);
  /// If the session is leaving a server, connects again at once: in a shutdown, that broker also
  /// has to receive the final state.
  void reconnect_if_leaving(SteadyTime now);
  /// Closes the connection, in a shutdown; close() follows.
  void disconnect() { broker_.disconnect(will_); }
  /// Completes the shutdown: publications not delivered yet stay undelivered.
  void close(SteadyTime now);

  /// The servers of the config have changed; restart() follows.
  void settings_changed() { connects_.settings_changed(); }
  const ConnectSchedule& connects() const { return connects_; }
  /// Returns the server for the log, with the profile.
  std::string server() const;

  bool is_connected() const { return link_ == Link::connected; }
  /// Time since which the session has been connected, or without a connection; the clock's epoch if
  /// it has not had one yet.
  SteadyTime since() const { return is_connected() ? connected_at_ : lost_at_; }
  /// Reason of the last failure or loss; empty: connected, or never tried.
  const std::string& why_not_connected() const { return why_not_connected_; }
  /// True if the session is neither connected nor trying to connect.
  bool is_idle() const { return link_ == Link::waiting || link_ == Link::leaving; }
  /// True until the first attempt to connect has ended.
  bool is_starting() const { return starting_; }
  /// Receive Maximum sent to the broker: messages that it may send ahead of acknowledgements.
  std::uint16_t receive_maximum() const { return receive_maximum_; }

 private:
  /// leaving: it has left a server in order to reconnect; events read before that still arrive.
  enum class Link : std::uint8_t { waiting, connecting, connected, leaving };

  void connect(SteadyTime now);
  void end(SteadyTime now);
  void watch(SteadyTime now);

  Broker& broker_;
  Outgoing& outgoing_;
  ConnectSchedule connects_;
  const Listener listener_;
  const std::string profile_;
  const Will will_;

  Link link_ = Link::waiting;
  bool starting_ = true;
  SteadyTime act_at_{};      ///< next attempt; while one is in progress, its deadline
  SteadyTime not_before_{};  ///< the next attempt, even if the server is left sooner
  std::string last_failure_;
  std::string why_not_connected_;
  SteadyTime lost_at_{};
  SteadyTime connected_at_{};
  SteadyTime check_at_{};                 ///< next check that the connection still exists
  std::optional<SteadyTime> down_since_;  ///< unreported: the library has no connection
  std::uint16_t receive_maximum_ = kReceiveMaximum;  ///< reset when a connection is lost
};

}  // namespace fxagent
