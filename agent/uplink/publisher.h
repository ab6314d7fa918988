// The Publisher is the uplink: it publishes what the field produces, stores it while the broker is
// away, and passes commands from the broker to Commands and their results back. If the broker does
// not accept everything at once, results go first, then states, live samples and the backlog.
//
// Create it with its parts, add() the profiles, and let run_uplink() step it on the uplink thread
// until a clean stop. Other threads reach it only through Outbox::post(), and read its status from
// board(). Uplink thread only. Time is an argument.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <set>
#include <stop_token>
#include <string>
#include <vector>

#include "agent/commands/commands.h"
#include "agent/config/config_difference.h"
#include "agent/config/model.h"
#include "agent/handover/command_message.h"
#include "agent/handover/outbox.h"
#include "agent/handover/status.h"
#include "agent/handover/status_board.h"
#include "agent/steady_time.h"
#include "agent/store/guarded_store.h"
#include "agent/uplink/broker.h"
#include "agent/uplink/commands/command_intake.h"
#include "agent/uplink/commands/result_delivery.h"
#include "agent/uplink/drop_warning.h"
#include "agent/uplink/jittered_backoff.h"
#include "agent/uplink/outgoing.h"
#include "agent/uplink/own_topics.h"
#include "agent/uplink/payload/json_payload.h"
#include "agent/uplink/profile/outlet.h"
#include "agent/uplink/retained/device_states.h"
#include "agent/uplink/retained/retained_state.h"
#include "agent/uplink/samples/sample_delivery.h"
#include "agent/uplink/session/session.h"
#include "agent/uplink/session/shutdown.h"
#include "agent/uplink/session/subscriptions.h"
#include "agent/uplink/status/status_source.h"

namespace fxagent {

struct PublisherSettings {
  std::string boot;  ///< 8 hex digits, different at every start
  std::string version;
  std::size_t backlog_bytes = std::size_t{64} << 20;  ///< in memory, without a store or disk
  /// Results that the broker has not acknowledged. Above this the agent unsubscribes from commands,
  /// until half of it is delivered.
  std::size_t result_bytes = std::size_t{16} << 20;
  std::uint64_t first_seq = 0;    ///< lowest sequence number of devices that a reload adds
  std::uint32_t jitter_seed = 1;  ///< of the retry delays; differs between agents
  /// Returns true for the boot of another process that may have our id. Empty: none may.
  std::function<bool(const std::string& boot)> is_ours{};
  /// Called when a store opens that was not available at the start, with the last sequence number
  /// of each device. The field numbers samples above these afterwards. May be empty.
  std::function<void(std::vector<std::uint64_t>)> number_above{};
  /// Makes the field send its counters through the outbox, for health. May be empty.
  std::function<void()> ask_counters{};
};

class Publisher final {
 public:
  using UtcClock = std::function<std::int64_t()>;

  /// All references outlive the publisher. `payload` and `commands` were created with `config`,
  /// which only the publisher changes afterwards, in change(). `utc_ms` returns the current
  /// calendar time. `store` is also the journal of `commands`; null: memory only.
  Publisher(Config& config, PublisherSettings settings, JsonPayload& payload, Outbox& outbox,
            Broker& broker, Commands& commands, UtcClock utc_ms, GuardedStore* store = nullptr);
  Publisher(const Publisher&) = delete;
  Publisher& operator=(const Publisher&) = delete;

  /// Adds a profile with a session of its own. The publisher steps it until finished(). Call before
  /// the first step().
  void add(Outlet& outlet) {
    outlet.answer_in_stop([this] { return !shutdown_.finished() && !intake_.empty(); });
    outlets_.push_back(&outlet);
  }

  // ---- run, as run_uplink() does

  /// Processes all events and does what is due. Returns the time by which it must be called again.
  /// Call it sooner if the outbox or the broker has events.
  SteadyTime step(SteadyTime now);
  /// Returns the time until which the next step() may wait for more samples to send together.
  SteadyTime gather_until() const { return samples_.gather_until(); }
  /// Begins a clean stop. Publishes what is waiting for up to 3 s, results first, then the agent's
  /// state offline, and closes the connection. step() does the work until finished().
  void stop(SteadyTime now);
  bool finished() const;

  // ---- commands that do not come from the agent's own session

  /// Takes a command from the page or a profile. Its result is also published on the result topic.
  /// If too many commands or results wait, the command is rejected, and the result goes only to
  /// `reply`, or to the log without one.
  void take_relayed(RelayedCommand command, SteadyTime now);

  struct Unanswered {
    JournalEntry entry;
    std::string topic;                            ///< of its announcement
    std::function<void(JournalEntry)> published;  ///< called if its result is published already
  };
  /// Takes a command that the other gateway of a pair left without a result. The next step()
  /// recovers it and publishes its result, unless this gateway knows the command. If the journal
  /// cannot be read then, the command is dropped: the other gateway asks again.
  void take_unanswered(Unanswered command) { unanswered_.push_back(std::move(command)); }

  // ---- change of the config
  // Call begin_change(), the field's end(), change() and the field's begin(), in this order; the
  // two here from Outbox::post(). Call no other function between change() and the field's begin().

  /// Rejects every later command for what ends with the change.
  void begin_change(const ConfigChange& change) {
    is_changing_ = true;
    commands_.begin_change(change);
  }
  /// Puts the config of the change in force. Call when the outbox has delivered the last events of
  /// the field's end(). Returns the last sequence number of each device that begins, as far as the
  /// store has it, by index in Config::devices, for the field's begin(). nullopt: the agent is
  /// stopping, and the config stays as it is.
  std::optional<std::vector<std::uint64_t>> change(const ConfigChange& change, SteadyTime now);
  /// Sets the config status that health reports.
  void set_config_status(ConfigStatus status, SteadyTime now);

  // ---- parts and state. References are valid for the publisher's lifetime.

  /// Returns the part that takes the listener and the reports of remote configs.
  OwnTopics& own_topics() { return own_topics_; }
  /// Returns the board on which the agent's status is published.
  StatusBoard& board() { return status_.board(); }
  /// Returns the samples counted by location, as of the last step().
  SampleCounts samples() const { return status_.samples(); }

 private:
  // The phases of step(), in their order. Outgoing, SampleDelivery and StatusSource have the
  // others.
  void take_broker_events(SteadyTime now);
  /// Recovers what earlier runs left in a store that has opened late.
  void take_found_late(SteadyTime now);
  void take_outbox(SteadyTime now);
  void take_commands(SteadyTime now);
  /// Recovers commands that the other gateway of a pair left.
  void recover_other_gateway(SteadyTime now);
  /// Returns the time by which it must be called again.
  SteadyTime keep_outlets(SteadyTime now);
  void keep_session(SteadyTime now);
  void send(SteadyTime now);
  /// Holds back what arrives faster than it can be sent.
  void press_back(SteadyTime now);
  /// Takes the next step of the shutdown. After the last one, what the broker has not acknowledged
  /// is on disk, for the next boot, and the store is closed.
  void keep_shutdown(SteadyTime now);
  SteadyTime next_wake(SteadyTime now) const;

  void connection_began(SteadyTime now);
  void connection_ended(SteadyTime now);

  Config& config_;
  const PublisherSettings settings_;
  JsonPayload& payload_;
  Outbox& outbox_;
  Broker& broker_;
  Commands& commands_;
  const UtcClock utc_ms_;
  GuardedStore* const store_;

  JitteredBackoff backoff_;
  Outgoing outgoing_;
  Subscriptions subscriptions_;
  Session session_;
  DeviceStates states_;
  RetainedState retained_;
  ResultDelivery results_;
  SampleDelivery samples_;
  DropWarning drops_;
  CommandIntake intake_;
  std::vector<Outlet*> outlets_;
  StatusSource status_;
  Farewell farewell_;  ///< the agent's state becomes offline
  Shutdown shutdown_;
  OwnTopics own_topics_;

  /// From begin_change() to change(). Nothing is taken from a store that opens meanwhile: rows
  /// recovered for a device that ends with the change would come too late.
  bool is_changing_ = false;
  std::vector<Unanswered> unanswered_;  ///< until the next step()
  bool samples_first_ = false;  ///< samples go before results, in a window too small to share
  /// Devices of commands that may have written and whose results are not handed over yet.
  std::set<std::string> written_;
  std::optional<std::int64_t> started_ms_;
};

/// The uplink thread: steps the publisher when there are events or something is due, until `stop`
/// was requested and the clean shutdown is complete. Calls `stepped` after each step.
void run_uplink(Publisher& publisher, Outbox& outbox, std::stop_token stop,
                const std::function<void()>& stepped = {});

}  // namespace fxagent
