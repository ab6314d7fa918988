// Roles of the two gateways of a pair, as a pure state machine: events in, actions out, time as an
// argument. PairPeers is what this gateway hears of the others, PairState what it may do.
//
// The fence. A gateway holds the pair while its lease session lasts: the MQTT session with the
// pair's own client id. A broker keeps one session per client id, so a claim ends the other
// gateway's. The holder sends heartbeats over that session. One that was sent at `t` and
// acknowledged proves that no other gateway had claimed by `t`, and permits requests until `t` +
// quiet / 2. A claimer waits for `quiet` after the broker has accepted its session, so the
// permission of the other gateway ended at least quiet / 2 earlier. If the settings of the two
// differ, which is a fault, each waits for the longer one.
#pragma once

#include <chrono>
#include <cstdint>
#include <deque>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "agent/handover/line_permit.h"

namespace fxagent {

enum class PairRole : std::uint8_t { standby, claiming, active };
/// Returns "standby", "claiming" or "active".
std::string_view to_string(PairRole role);

struct PairSettings {
  std::string member;  ///< name of this gateway
  std::string boot;    ///< of this process
  std::chrono::nanoseconds quiet{};
};

/// The status that a gateway publishes about itself.
struct PairStatus {
  std::string member{};
  std::string boot{};
  std::string role{};  ///< of PairRole, or "offline"
  bool is_third = false;
  std::chrono::nanoseconds quiet{};  ///< its setting; 0: not named
  // For people.
  std::string why{};
  std::string peer{};
  std::int64_t since_ms = 0;
};

/// A fault that a person must repair. It is named when it begins and when it is over.
struct PairFault {
  std::string text{};  ///< empty: there is none
  bool is_over = false;
};

/// Other gateways of the pair, as this one hears them over its member session: who is there, which
/// one holds the pair, and the faults that a person must repair.
class PairPeers final {
 public:
  explicit PairPeers(PairSettings settings)
      : settings_(std::move(settings)), quiet_(settings_.quiet) {}

  /// The member session is connected and its subscriptions are granted.
  void joined(BootTime now);
  /// It has ended. `taken_over`: another client has its client id.
  void left(bool taken_over);
  /// A status; `role`: of this gateway. Called by PairState::heard().
  void heard(const PairStatus& status, PairRole role, BootTime now);
  /// A heartbeat of the holder. `seq`: no sequence number above it was used.
  void heard_heartbeat(const std::string& member, const std::string& boot, std::uint64_t seq,
                       BootTime now);
  /// Judges the faults that begin or end with time. Called by PairState::step().
  void step(BootTime now);

  /// Time since which this gateway hears the others; nullopt: it does not.
  std::optional<BootTime> joined_at() const { return joined_at_; }
  /// The longest setting of all gateways that were heard, and of this one.
  std::chrono::nanoseconds quiet() const { return quiet_; }
  /// True if two others are there: this gateway is not one of the pair.
  bool is_third() const { return third_; }
  /// Member name of the other gateway; empty: it is not there.
  std::string peer() const;
  /// True if this gateway has listened for quiet(): an empty peer() then means that there is none.
  bool has_listened(BootTime now) const { return joined_at_ && now >= *joined_at_ + quiet_; }
  /// True if a gateway of the pair is there whose name is lower.
  bool has_lower_name() const;
  /// Time of the last heartbeat of another holder; nullopt: none has come, or the holder has ended.
  std::optional<BootTime> holder_heard_at() const { return holder_heard_at_; }
  /// Highest number of all heartbeats so far.
  std::uint64_t highest_seq() const { return highest_seq_; }
  /// True if the other gateway has held the pair after the earlier processes of this one: numbers
  /// grow with each takeover.
  bool other_held_last() const { return other_seq_ > own_seq_; }
  /// True for the boot of another gateway of this pair, or of an earlier process of this one.
  bool knows(const std::string& boot) const { return boots_.contains(boot); }
  /// True, once, if a change makes it necessary to publish this gateway's status.
  bool take_change() { return std::exchange(changed_, false); }
  /// Returns the next fault that has begun or is over.
  PairFault take_fault();

 private:
  /// Names the fault with this cause, if it has not lasted before. An empty text: it is over.
  void fault(const std::string& cause, const std::string& text);
  void judge_third(PairRole role, BootTime now);

  struct Peer {
    std::string member;
    std::string role;
    bool is_third = false;
    bool was_here = false;  ///< before us
  };

  const PairSettings settings_;
  std::chrono::nanoseconds quiet_;
  std::optional<BootTime> joined_at_;
  bool own_status_came_ = false;       ///< in this member session
  std::map<std::string, Peer> peers_;  ///< by boot
  std::set<std::string> gone_;         ///< boots that have ended
  std::set<std::string> boots_;        ///< all boots of other processes
  bool third_ = false;
  bool changed_ = true;
  std::string holder_;  ///< boot of the last foreign heartbeat
  std::optional<BootTime> holder_heard_at_;
  std::uint64_t highest_seq_ = 0;
  std::uint64_t own_seq_ = 0;                  ///< highest of earlier processes of this gateway
  std::uint64_t other_seq_ = 0;                ///< highest of other gateways
  std::map<std::string, std::string> faults_;  ///< texts of those that last, by cause
  std::deque<PairFault> fault_news_;           ///< not taken yet
  bool same_name_ = false;                     ///< another member of this name, since the last step
  BootTime same_name_at_{};                    ///< the last step with one
};

/// Role of this gateway: when it claims the pair, how long it holds it, and when it is over.
class PairState final {
 public:
  enum class Action : std::uint8_t {
    publish_status,  ///< role, reason or peer has changed
    connect_lease,   ///< connect the lease session
    send_heartbeat,  ///< over the lease session; report it with heartbeat_sent()
    drop_lease       ///< end the lease session
  };

  /// `quiet`: the setting of this gateway. `peers` must outlive this object.
  PairState(std::chrono::nanoseconds quiet, PairPeers& peers) : quiet_(quiet), peers_(peers) {}

  /// A status came over the member session. Passes it to the peers.
  void heard(const PairStatus& status, BootTime now);

  // The lease session.
  void lease_began(BootTime now);
  /// It has ended, or did not begin. `taken_over`: the other gateway has claimed.
  void lease_ended(bool taken_over, BootTime now);
  void heartbeat_sent(std::uint64_t id, BootTime now);
  void heartbeat_acknowledged(std::uint64_t id);
  /// This gateway has the journal of the other one. Earlier heartbeats carry no sequence number of
  /// this gateway, so they permit nothing any more.
  void has_claimed(BootTime now);

  /// The agent runs, so that this gateway becomes active when its wait is over.
  void agent_began() { agent_runs_ = true; }

  /// Returns what is due, in order. Call after each event and at next_wake().
  std::vector<Action> step(BootTime now);
  BootTime next_wake() const;

  PairRole role() const { return role_; }
  /// Reason for the role, for people and for the log.
  const std::string& why() const { return why_; }
  BootTime since() const { return since_; }
  /// Time until which the last acknowledged heartbeat permits requests.
  BootTime holds_until() const { return holds_until_; }
  /// Time at which the first request may be sent.
  BootTime opens_at() const { return opens_at_; }

 private:
  void enter(PairRole role, std::string why, BootTime now);
  /// Returns the time from which this gateway may claim; nullopt: an event must come first.
  std::optional<BootTime> claim_at() const;

  const std::chrono::nanoseconds quiet_;
  PairPeers& peers_;
  PairRole role_ = PairRole::standby;
  std::string why_ = "start";
  BootTime since_{};
  bool status_due_ = true;
  bool agent_runs_ = false;

  bool connecting_ = false;
  BootTime not_before_{};  ///< of the next claim
  int failures_ = 0;       ///< of claims in a row
  BootTime opens_at_{};
  BootTime holds_until_{};
  BootTime claimed_at_{};
  BootTime heartbeat_at_{};
  std::map<std::uint64_t, BootTime> sent_;  ///< heartbeats without an acknowledgement
  bool drop_ = false;
};

}  // namespace fxagent
