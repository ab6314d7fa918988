// Chooses the next server and the time of the attempt. A round tries each server once, and a
// growing delay follows it. After the loss of a stable connection a round begins within 1 s, with a
// single server 250 ms later. It tries the lost server last, because that one may be silent. With
// `reconnect_spread_s` the agents of a fleet reconnect at random times within it. Uplink thread.
// Time is an argument.
#pragma once

#include <cstddef>
#include <optional>
#include <string>

#include "agent/config/model.h"
#include "agent/steady_time.h"
#include "agent/uplink/jittered_backoff.h"

namespace fxagent {

class ConnectSchedule final {
 public:
  /// The references outlive the object.
  ConnectSchedule(const MqttConfig& mqtt, JitteredBackoff& backoff)
      : mqtt_(mqtt), backoff_(backoff) {}

  /// Index in the config of the server to which the session is connected, or the next to try.
  std::size_t index() const;
  const std::string& server() const { return mqtt_.servers.at(index()); }
  /// Longest time that the next attempt may take. In the first round of several servers it is
  /// short: another server may answer at once.
  SteadyTime::duration patience() const;
  /// Lifetime after which a connection is stable: no other client keeps taking it over.
  SteadyTime::duration steady_after() const;

  void connection_began(SteadyTime now);
  void connection_ended(SteadyTime now) { last_up_ = now; }
  // These return the time of the next attempt, and choose its server.
  /// An attempt to connect has failed.
  SteadyTime after_failure(SteadyTime now);
  /// A connection that began at `connected_at` was lost.
  SteadyTime after_loss(SteadyTime connected_at, SteadyTime now);
  /// The servers of the config have changed; restart() follows.
  void settings_changed() { begin_round(std::nullopt); }
  /// Starts again with the first server and without a delay.
  void restart();

 private:
  void begin_round(std::optional<std::size_t> lost);
  /// Chooses the next server of this round, or the first of another. True if the round goes on.
  bool next_of_round();

  const MqttConfig& mqtt_;
  JitteredBackoff& backoff_;
  std::size_t position_ = 0;         ///< of the server in the round
  std::optional<std::size_t> lost_;  ///< server that this round tries last
  int failed_rounds_ = 0;            ///< rounds of all servers without a connection
  int thrown_rounds_ = 0;            ///< rounds of all servers without a stable connection
  /// Between the last loss and the attempt after it, without the spread.
  SteadyTime::duration last_pause_{};
  std::optional<SteadyTime> last_up_;  ///< last time with a connection
};

}  // namespace fxagent
