// The uplink loop. Sends what the field produces to the broker, or stores it, and passes incoming
// commands to Commands. Its parts do the work: Session and Subscriptions keep the connection;
// RetainedState, ResultDelivery and SampleDelivery publish; OwnTopics and CommandIntake receive;
// Outgoing holds the window that all publications share; Shutdown has the steps of a clean stop.
// The Publisher sets their order: results, then states, then live samples, and the backlog in
// between.
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
  std::size_t backlog_bytes = std::size_t{64} << 20;
  /// Limit for results that the broker has not acknowledged. Above it the agent unsubscribes from
  /// commands, until half of these bytes are delivered.
  std::size_t result_bytes = std::size_t{16} << 20;
  std::uint64_t first_seq = 0;    ///< devices that begin later have no sequence number below it
  std::uint32_t jitter_seed = 1;  ///< of the retry delays; differs between agents
  // Any of these may be empty.
  /// Returns true for the boot of another process that may have our id; empty: none may.
  std::function<bool(const std::string& boot)> is_ours{};
  /// Called when a store has opened that was not available at the start. Gets the last sequence
  /// number of each device; the field numbers samples above these afterwards.
  std::function<void(std::vector<std::uint64_t>)> number_above{};
  /// Called before health is published: the field then sends its counters through the outbox.
  std::function<void()> ask_counters{};
};

/// Uplink thread only. Time is an argument; `utc_ms` returns the current calendar time.
class Publisher final {
 public:
  using UtcClock = std::function<std::int64_t()>;

  /// All references outlive the publisher. `config` is the config with which `payload` and
  /// `commands` were created; it belongs to the uplink, and change() replaces it. `store` is also
  /// the journal of `commands`; null: memory only.
  Publisher(Config& config, PublisherSettings settings, JsonPayload& payload, Outbox& outbox,
            Broker& broker, Commands& commands, UtcClock utc_ms, GuardedStore* store = nullptr);
  Publisher(const Publisher&) = delete;
  Publisher& operator=(const Publisher&) = delete;

  /// Adds a profile with its own session. Call before the first step(). Used until finished().
  void add(Outlet& outlet) {
    outlet.answer_in_stop([this] { return !shutdown_.finished() && !intake_.empty(); });
    outlets_.push_back(&outlet);
  }

  /// Processes all events and does what is due. Returns the time by which it must be called again;
  /// call it sooner if the outbox or the broker has events.
  SteadyTime step(SteadyTime now);
  /// See SampleDelivery::gather_until().
  SteadyTime gather_until() const { return samples_.gather_until(); }

  /// Begins the clean shutdown. Publishes what is waiting for up to 3 s, results first; then sets
  /// the agent's state to offline and closes the connection. step() does the work until finished().
  void stop(SteadyTime now);
  bool finished() const;

  // A config change takes two calls of Outbox::ask().
  /// Rejects commands for everything that ends with the change, from this call on. The field's
  /// end() comes next.
  void begin_change(const ConfigChange& change) {
    is_changing_ = true;
    commands_.begin_change(change);
  }
  /// Puts the config of the change in force. Call after the field's end(), when the outbox has
  /// delivered its last events. Returns the last sequence number of each device that begins, as far
  /// as the store knows it, by index in Config::devices. Pass it to the field's begin() before any
  /// other call here. nullopt: the agent is stopping, and the config stays as it is.
  std::optional<std::vector<std::uint64_t>> change(const ConfigChange& change, SteadyTime now);
  /// Sets the config status that health reports.
  void set_config_status(ConfigStatus status, SteadyTime now);

  /// Takes a command from the page or a profile. Its result is also published on the result topic.
  /// If too many commands or results wait, rejects it: the result then goes only to `reply`, or to
  /// the log if that is empty.
  void take_relayed(RelayedCommand command, SteadyTime now);

  struct Unanswered {
    JournalEntry entry;
    std::string topic;                            ///< of its announcement
    std::function<void(JournalEntry)> published;  ///< called if its result is
  };
  /// Takes a command that the other gateway of a pair left. Its result is published unless this
  /// gateway knows the command. Forgets it if the journal cannot be read now: the other gateway
  /// asks again.
  void take_unanswered(Unanswered command) { unanswered_.push_back(std::move(command)); }

  /// Takes the listener and the reports of remote configs. Valid for the publisher's lifetime.
  OwnTopics& own_topics() { return own_topics_; }

  /// Returns the samples counted by location, as of the last step().
  SampleCounts samples() const { return status_.samples(); }
  /// The board on which the agent's status is published; valid for the publisher's lifetime.
  StatusBoard& board() { return status_.board(); }

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
  /// Returns the reason why commands are not received; nullopt: they are.
  std::optional<std::string> why_no_commands() const;

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
