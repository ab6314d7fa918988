// This gateway in its pair: keeps its two MQTT sessions on a thread of its own, so that neither a
// flood of commands nor a full window of samples delays a heartbeat. PairState decides. While this
// gateway is on standby, it keeps the journal of the active one in its own store.
//
// The sessions:
// * MemberSession, with the client id of this gateway: hears the other one, the commands that it
//   announces and their results;
// * the lease session, with the client id of the pair: only the holder has it.
//
// If the lease session ends while the agent runs, the process restarts itself: no state of the old
// role remains, and the new process recovers as after a crash.
#pragma once

#include <atomic>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "agent/commands/journal.h"
#include "agent/config/model.h"
#include "agent/handover/line_permit.h"
#include "agent/pair/announcements.h"
#include "agent/pair/member_session.h"
#include "agent/pair/pair_messages.h"
#include "agent/pair/pair_state.h"
#include "agent/pair/standby_journal.h"
#include "agent/store/store.h"
#include "agent/uplink/broker.h"

namespace fxagent {

class PairMember final {
 public:
  /// What the agent gives to the pair. All are called on the pair's thread.
  struct Agent {
    std::function<std::uint64_t()> highest_seq;  ///< in use
    std::function<void()> goes_on;               ///< in each round of the pair's thread
    /// True if the agent is to stop: then the end of the lease does not start it anew.
    std::function<bool()> is_stopping;
    /// Takes a command of which the other gateway does not know a published result, and the topic
    /// of its announcement.
    std::function<void(JournalEntry left, const std::string& topic)> take_unanswered;
  };

  /// What the agent begins with after the claim.
  struct Claimed {
    std::uint64_t floor = 0;              ///< no sequence number below it may be used
    std::vector<JournalEntry> unwritten;  ///< what the disk refused to record on standby
  };

  /// `config` has a pair. `boot`: of this process. Starts the thread. Throws std::system_error, and
  /// what Store() throws.
  PairMember(const Config& config, std::string boot);
  ~PairMember();
  PairMember(const PairMember&) = delete;
  PairMember& operator=(const PairMember&) = delete;

  /// Waits until this gateway has claimed the pair and its store has the journal of the other one.
  /// The store is closed afterwards. Calls `waits` about every second while the pair's thread goes
  /// on. Main thread.
  Claimed await_claim(const std::function<void()>& waits);
  /// The agent runs.
  void agent_began(Agent agent);
  const LinePermit& permit() const { return permit_; }

  /// Announces the commands of the agent. Any thread, as described there.
  Announcements& announcements() { return announcements_; }
  /// Tells the other gateway that the result of this command is published. Any thread.
  void reply(JournalEntry answered);
  /// Ends the role of this gateway, after the field has stopped: the other one takes over.
  void leave();

  /// True for the boot of another process of this pair. Any thread.
  bool knows(const std::string& boot) const;

 private:
  /// Steps of a claim, in order.
  enum class Claim : std::uint8_t { none, evicting, marking, marked, claimed };

  /// Calls `change` under mutex_, and makes the thread begin its next round.
  void wake(const std::function<void()>& change = [] {});
  void run(const std::stop_token& stop);
  void keep(BootTime now);
  void take_member_events(BootTime now);
  void take_lease_events(BootTime now);
  void take_evicting_events(BootTime now);
  void drop_lease(BootTime now);
  void hear(const Message& message, BootTime now);
  void hear_announcement(pair_messages::Announcement announcement, const std::string& member,
                         const std::string& topic);
  void lease_ended(bool taken_over, BootTime now);
  void end_member_session();
  void save_heard(const std::string& where, const std::string& text);
  void go_on_with_claim(BootTime now);
  void carry_out(PairState::Action action, BootTime now);
  void publish_status();
  void send_journal(BootTime now);
  void log_changes(BootTime now);
  /// Publishes under a new id, and returns it.
  std::uint64_t publish(Broker& session, Publication publication);
  /// Same on the topic of this gateway's announcements.
  std::uint64_t publish_in_journal(Broker& session, std::string text);
  std::string topic(const char* leaf = "") const;
  Publication offline_status() const;

  const Config config_;
  const PairConfig pair_;
  const std::string boot_;
  LinePermit permit_;

  // Outlives the sessions: the threads of the MQTT library call wake() until they are closed.
  std::atomic<bool> leaving_ = false;  ///< written under mutex_ with woken_, read without it
  mutable std::mutex mutex_;
  std::condition_variable news_;
  bool woken_ = false;                 ///< under mutex_
  bool left_ = false;                  ///< under mutex_
  std::uint64_t rounds_ = 0;           ///< under mutex_
  std::optional<Claimed> claimed_;     ///< under mutex_; nullopt: the pair is not claimed yet
  std::optional<Agent> agent_;         ///< under mutex_; nullopt: it does not run yet
  std::deque<JournalEntry> answered_;  ///< under mutex_

  // Of the pair's thread.
  PairPeers peers_;  ///< what it hears is written under mutex_, for knows()
  PairState state_;
  PairRole logged_ = PairRole::claiming;
  std::optional<std::string> logged_peer_;
  std::unique_ptr<StandbyJournal> journal_;  ///< until this gateway has claimed the pair
  std::optional<MemberSession> member_;      ///< from the first round on
  std::unique_ptr<Broker> lease_;
  std::unique_ptr<Broker> evicting_;  ///< the session of the agent, to end that of the other one
  std::size_t window_ = 0;            ///< of announcements; 0: the lease session is not connected
  Claim claim_ = Claim::none;
  std::uint64_t floor_ = 0;    ///< Claimed::floor; 0 before
  bool over_ = false;          ///< the lease ended while the agent stops
  std::uint64_t next_id_ = 1;  ///< of publish(); heartbeats and marks have it as their number
  std::uint64_t mark_ = 0;
  std::uint64_t farewell_ = 0;    ///< publication of the last status
  std::uint64_t announcing_ = 0;  ///< publication of an unanswered command; 0: none
  Announcements announcements_;
  std::jthread thread_;
};

}  // namespace fxagent
