// A Session keeps one connection to the MQTT servers of a config. It connects, detects a loss even
// if the library does not report it, and connects again to the server and at the time that its
// ConnectSchedule chooses.
//
// The caller passes the broker's connection events to on(), and calls step() at next_wake() or
// sooner. The Listener receives the changes. Uplink thread. No function blocks; time is an
// argument.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
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
  /// Called from on(), step() and the functions that disconnect. None is empty.
  struct Listener {
    /// The session is connected. Publications go to this broker now.
    std::function<void(const Connected& event, SteadyTime now)> connection_began;
    /// The connection is gone. Publications in flight must be published again.
    std::function<void(SteadyTime now)> connection_ended;
    /// An attempt to connect has failed or was abandoned.
    std::function<void()> attempt_failed;
    /// The broker has given our session to another client. connection_ended() follows.
    std::function<void()> session_taken_over;
  };

  /// Creates a session that connects with the first step(). All references outlive it; `mqtt` has
  /// the servers. `profile` names the session in the log; empty: it is the agent's own. `will` is
  /// the fate of the last will when the session disconnects. A server that acknowledges nothing is
  /// always left with Will::published.
  Session(Broker& broker, Outgoing& outgoing, const MqttConfig& mqtt, JitteredBackoff& backoff,
          Listener listener, std::string profile = {}, Will will = Will::discarded);

  // ---- run

  void on(const Connected& event, SteadyTime now);
  void on(const ConnectFailed& event, SteadyTime now);
  void on(const Lost& event, SteadyTime now);
  void on(const Disconnected& event, SteadyTime now);
  /// Does what is due: connects, ends an attempt that takes too long, detects a loss.
  void step(SteadyTime now);
  /// Returns the time by which step() must be called again.
  SteadyTime next_wake() const;

  // ---- state

  bool is_connected() const { return state_ == State::connected; }
  /// True until the first attempt to connect has ended.
  bool is_starting() const { return starting_; }
  /// True if the session is neither connected nor trying to connect.
  bool is_idle() const { return state_ == State::waiting || state_ == State::leaving; }
  /// Returns the URL of the server that the session is connected to or tries next.
  const std::string& server() const { return connects_.server(); }
  /// Returns the URL for the log, followed by the profile.
  std::string log_name() const;
  /// Returns the time of the last connect or loss; the clock's epoch before the first connect.
  SteadyTime since() const { return is_connected() ? connected_at_ : lost_at_; }
  /// Returns the reason of the last failure or loss; empty: connected, or never tried.
  const std::string& why_not_connected() const { return why_not_connected_; }
  /// Returns the age at which a connection is stable: no other client keeps taking it over.
  SteadyTime::duration stable_after() const { return connects_.steady_after(); }
  /// Returns the Receive Maximum sent to the broker: the number of messages that it may send ahead
  /// of our acknowledgements.
  std::uint16_t receive_maximum() const { return receive_maximum_; }

  // ---- change the connection

  /// Takes note that the servers in `mqtt` have changed. The connection stays until restart().
  void settings_changed() { connects_.settings_changed(); }
  /// Abandons the connection or attempt, and starts again with the first server.
  void restart(SteadyTime now);
  /// Disconnects, and connects to the next server after at least 2 s.
  /// Requires: is_connected().
  void connect_to_next_server(SteadyTime now);
  /// Disconnects, and connects to the same server with Receive Maximum 1. The caller still receives
  /// the messages that arrived before; those that the broker has queued are lost, as with every
  /// loss. Requires: is_connected().
  void reconnect_with_one_in_flight(SteadyTime now);

  // ---- shutdown

  /// Skips the wait before the new connection that restart(), connect_to_next_server() or
  /// reconnect_with_one_in_flight() has begun: its broker must also receive the final state.
  void reconnect_if_leaving(SteadyTime now);
  /// Sends the DISCONNECT. on(Disconnected) reports that it is sent; call close() in any case.
  void disconnect() { broker_.disconnect(will_); }
  /// Ends the session. Publications without an acknowledgement stay undelivered.
  void close(SteadyTime now);

 private:
  /// waiting: for the next attempt. leaving: disconnected in order to reconnect; events from before
  /// the disconnect still arrive.
  enum class State : std::uint8_t { waiting, connecting, connected, leaving };

  void connect(SteadyTime now);
  void end(SteadyTime now);
  void watch(SteadyTime now);

  Broker& broker_;
  Outgoing& outgoing_;
  ConnectSchedule connects_;
  const Listener listener_;
  const std::string profile_;
  const Will will_;

  State state_ = State::waiting;
  bool starting_ = true;
  SteadyTime act_at_{};      ///< next attempt; while one is in progress, its deadline
  SteadyTime not_before_{};  ///< the next attempt, even if the server is left sooner
  std::map<std::string, std::string> failures_;  ///< last one of each server, until a connection
  std::string why_not_connected_;
  SteadyTime lost_at_{};
  SteadyTime connected_at_{};
  SteadyTime check_at_{};                 ///< next check that the connection still exists
  std::optional<SteadyTime> down_since_;  ///< unreported: the library has no connection
  std::uint16_t receive_maximum_ = kReceiveMaximum;  ///< reset when a connection is lost
};

}  // namespace fxagent
