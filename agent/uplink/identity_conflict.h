// Two agents with one id: whether another one is there, by what is heard on the agent's own state
// topic and by sessions that were taken over. While it is, neither carries out commands. Uplink
// thread. Pure: time is an argument.
//
// Another agent that lives answers: it puts its own state in the place of ours within a second or
// so. One that is gone does not, whatever its retained state still says; so a state of an earlier
// boot of this agent, left by a kill, is no conflict for longer than an answer may take.
#pragma once

#include <cstddef>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <utility>

#include "agent/messages.h"

namespace fxagent {

class IdentityConflict final {
 public:
  /// What other() says of an agent that was never heard.
  static constexpr std::string_view kUnknown = "unknown";

  /// `boot`: our own.
  explicit IdentityConflict(std::string boot) : boot_(std::move(boot)) {}

  /// A text on {base}/state, whoever published it.
  void heard(std::string_view payload, SteadyTime now);
  /// The broker says that it has given our session to another client. Many do so without a word:
  /// then the other's last will stands where our state was, when we are back.
  void taken_over() { taken_over_ = true; }
  /// `server`: which one it is, since each has a state of its own on the topic. `steady_after`: a
  /// connection that lives so long is not taken over any more.
  void connection_began(const std::string& server, SteadyTime now,
                        SteadyTime::duration steady_after);
  void connection_ended();
  /// Ends the conflict where the others were silent for long enough. `messages_held`: answers may
  /// wait behind what is not let in, so that silence says nothing.
  void keep(SteadyTime now, bool messages_held);
  /// Whether our own state has not come back from the broker although this connection has lasted
  /// long enough for it: true once, until it has come back.
  bool take_unheard() { return std::exchange(is_unheard_, false); }
  /// When keep() has something to do at the latest.
  SteadyTime next_wake() const;

  /// The other's boot, "unknown" where it was never heard; nullopt: nobody else has our id.
  std::optional<std::string> other() const;

 private:
  const std::string boot_;
  /// Boots that said "online" and have not gone since, and when each counts as gone without a word.
  std::map<std::string, SteadyTime> online_;
  std::string other_boot_;         ///< the last that was heard; empty: none
  bool taken_over_ = false;        ///< it has our client id too
  std::set<std::string> ours_on_;  ///< servers where our own state has stood in other connections
  std::string server_;             ///< of this connection, or of the last
  bool is_ours_ = false;           ///< our own state has come back in this one
  SteadyTime steady_at_ = SteadyTime::max();
  SteadyTime unheard_at_ = SteadyTime::max();  ///< when it is too late for it
  bool is_unheard_ = false;
  bool told_unheard_ = false;
};

}  // namespace fxagent
