// Detects another agent with the same id, by the texts on the agent's own state topic and by
// sessions that were taken over. During the conflict neither agent carries out commands. Uplink
// thread. Pure: time is an argument.
//
// Another agent that is running answers: it replaces our state with its own within about 1 s. An
// agent that is gone does not answer, whatever its retained state contains. So the state of an
// earlier boot of this agent, left behind by a kill, is a conflict only for the time that an answer
// may take.
#pragma once

#include <functional>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <utility>

#include "agent/steady_time.h"

namespace fxagent {

class IdentityConflict final {
 public:
  /// Returned by other() for an agent whose boot was never received.
  static constexpr std::string_view kUnknown = "unknown";

  /// `boot` is our own. `is_ours` returns true for the boot of another process that may have our
  /// id, such as the other gateway of a pair; empty: none may.
  explicit IdentityConflict(std::string boot,
                            std::function<bool(const std::string& boot)> is_ours = {})
      : boot_(std::move(boot)), is_ours_too_(std::move(is_ours)) {}

  /// Processes a text on {base}/state, from any publisher.
  void heard(std::string_view payload, SteadyTime now);
  /// The broker has reported that it gave our session to another client. Many brokers do not report
  /// it: the other agent's last will is then in place of our state when we reconnect.
  void taken_over() { taken_over_ = true; }
  /// `server` identifies the broker, because each has its own state on the topic. `steady_after` is
  /// the lifetime after which another agent no longer takes a connection over.
  void connection_began(const std::string& server, SteadyTime now,
                        SteadyTime::duration steady_after);
  void connection_ended();
  /// Ends the conflict if the others were silent for long enough. `messages_held`: answers may be
  /// waiting in the network, so silence proves nothing. Returns true if our own state has not come
  /// back from the broker although this connection has lasted long enough; once, until it has.
  bool keep(SteadyTime now, bool messages_held);
  /// Returns the time by which keep() must run again.
  SteadyTime next_wake() const;

  /// Returns the other agent's boot, "unknown" if it never came; nullopt: no agent has our id.
  std::optional<std::string> other() const;

 private:
  const std::string boot_;
  const std::function<bool(const std::string& boot)> is_ours_too_;
  /// Boots that were "online" and have not gone, and when each counts as gone if it stays silent.
  std::map<std::string, SteadyTime> online_;
  std::string other_boot_;         ///< last one received; empty: none
  bool taken_over_ = false;        ///< the other agent has our client id too
  std::set<std::string> ours_on_;  ///< with our own state in earlier connections
  std::string server_;             ///< of this connection, or of the last
  bool is_ours_ = false;           ///< our own state has come back in this connection
  SteadyTime steady_at_ = SteadyTime::max();
  SteadyTime unheard_at_ = SteadyTime::max();  ///< deadline for our own state
  bool logged_unheard_ = false;
};

}  // namespace fxagent
