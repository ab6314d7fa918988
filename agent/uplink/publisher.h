// The uplink loop: what the field made goes to the broker, or waits; the commands that the broker
// brings go to Commands. Its parts do the work: Session has the connection, RetainedState,
// ResultDelivery and SampleDelivery what is published, CommandIntake what comes, Outgoing the
// window that all publications share. Here is their order: results, then states, then live samples,
// then the backlog beside them; and the clean end.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <optional>
#include <set>
#include <stop_token>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "agent/commands/commands.h"
#include "agent/config/config.h"
#include "agent/config/config_difference.h"
#include "agent/messages.h"
#include "agent/outbox.h"
#include "agent/status.h"
#include "agent/status_board.h"
#include "agent/store/guarded_store.h"
#include "agent/uplink/broker.h"
#include "agent/uplink/command_intake.h"
#include "agent/uplink/identity_conflict.h"
#include "agent/uplink/jittered_backoff.h"
#include "agent/uplink/outgoing.h"
#include "agent/uplink/payload.h"
#include "agent/uplink/result_delivery.h"
#include "agent/uplink/retained_state.h"
#include "agent/uplink/sample_delivery.h"
#include "agent/uplink/sample_spool.h"
#include "agent/uplink/session.h"
#include "agent/uplink/status_source.h"

namespace fxagent {

struct PublisherSettings {
  std::string boot;  ///< 8 hex digits, another at every start
  std::string version;
  std::size_t backlog_bytes = std::size_t{64} << 20;
  /// Of results that the broker does not have yet. Above it the agent ends its subscription to
  /// commands, until half of them are out.
  std::size_t result_bytes = std::size_t{16} << 20;
  std::uint32_t jitter_seed =
      1;  ///< of the retry times, so that a plant does not reconnect at once
};

/// Uplink thread only. Time is an argument; `utc_ms` tells the calendar time of "now". More than
/// twenty functions, since each kind of the broker's news has one.
class Publisher final : private Session::Listener, private Outgoing::Sender {
 public:
  using UtcClock = std::function<std::int64_t()>;
  using NumberAbove = std::function<void(std::vector<std::uint64_t>)>;
  using AskCounters = std::function<void()>;

  /// All references outlive the publisher. `config` is the one that `payload` and `commands` were
  /// made with, and the uplink's own: change() makes it the next one. `store` null: memory alone;
  /// else it is the journal of `commands` too. `number_above` is called from step() when a store
  /// that was not there at the start has opened: samples are numbered above these from then on, by
  /// device. `ask_counters` is called before health is published: the field's counters then come
  /// through the outbox.
  Publisher(Config& config, PublisherSettings settings, Payload& payload, Outbox& outbox,
            Broker& broker, Commands& commands, UtcClock utc_ms, GuardedStore* store = nullptr,
            NumberAbove number_above = {}, AskCounters ask_counters = {});
  ~Publisher() override;
  Publisher(const Publisher&) = delete;
  Publisher& operator=(const Publisher&) = delete;

  /// Takes all news and does what is due. Returns when it must be called again at the latest;
  /// sooner where the outbox or the broker has news.
  SteadyTime step(SteadyTime now);
  /// Until when samples may gather before the next step: a hundredth of their interval while they
  /// stream in, and the time of the last step where they do not.
  SteadyTime gather_until() const { return samples_out_.gather_until(); }

  /// Begins the clean end: what waits is published for up to 3 s, results first, then the agent's
  /// state goes to offline and the connection is closed. step() does the work until finished().
  void stop(SteadyTime now);
  bool finished() const { return phase_ == Phase::finished; }

  // A changed config, in two calls of Outbox::ask().
  /// Commands for what ends in the change are refused from now on. Then the field's end().
  void begin_change(const ConfigChange& change) {
    changing_ = true;
    commands_.begin_change(change);
  }
  /// After end(), whose last words the outbox has handed over: from now on the config is that of
  /// the change. Returns the number of the last sample of each device that begins, as far as the
  /// store knows it, by index in Config::devices, for the field's begin(), which is to be called
  /// before anything else is done here. Nothing: the agent is stopping, and there is no new config.
  std::optional<std::vector<std::uint64_t>> change(const ConfigChange& change, SteadyTime now);
  /// What health says of the config.
  void set_config_status(ConfigStatus status, SteadyTime now);

  // Remote configs.
  /// Who hears of what concerns them, from step(): each document of {base}/config/desired, and each
  /// change of the connection.
  struct ConfigListener {
    std::function<void(std::string payload)> desired;
    std::function<void(bool connected, SteadyTime now)> connection;
  };
  void set_config_listener(ConfigListener listener) { config_listener_ = std::move(listener); }
  /// What {base}/config/reported is from now on, after each connect too; empty: the topic is
  /// cleared, and nothing is published there. `audit`: body of a record; empty: none.
  void report_config(std::string text, std::string audit);

  /// Where every sample is, as of the last step().
  SampleCounts samples() const;
  /// Where the agent's status is published, as long as the publisher is there.
  StatusBoard& board() { return status_.board(); }

 private:
  enum class Phase : std::uint8_t { running, draining, farewell, closing, finished };

  void on(const Disconnected& event, SteadyTime now);
  void on(const Message& event, SteadyTime now);
  void on(const MessagesDropped& event, SteadyTime now);
  void on(const auto& event, SteadyTime now);  ///< all else is the session's or of what went out

  void connection_began(SteadyTime now) override;
  void connection_ended(SteadyTime now) override;
  void attempt_failed(SteadyTime now) override;
  void session_taken_over() override { identity_.taken_over(); }
  void subscription_changed() override;
  // Of the last message.
  void delivered(std::uint64_t id, SteadyTime now) override;
  void failed(const DeliveryFailed& event, SteadyTime now) override;

  void hear_command(const Message& message, std::string_view name);
  void hear_state(const Message& message, SteadyTime now);
  void follow_conflict(SteadyTime now);
  void make_health_due(SteadyTime now);

  void take_found_late(SteadyTime now);
  void recover_joined(SteadyTime now);
  void leave_old_settings(SteadyTime now);
  void take_outbox(SteadyTime now);
  void take_results();
  void keep_session(SteadyTime now);
  void tick(SteadyTime now);
  void pump(SteadyTime now);
  void hold_messages(SteadyTime now);
  void wind_up(SteadyTime now);
  void finish(SteadyTime now);
  bool drained() const;
  bool acknowledgements_matter() const;
  SteadyTime next_wake(SteadyTime now) const;

  Config& config_;
  const PublisherSettings settings_;
  const std::string base_;
  Payload& payload_;
  Outbox& outbox_;
  Broker& broker_;
  Commands& commands_;
  const UtcClock utc_ms_;
  GuardedStore* const store_;
  const NumberAbove number_above_;
  const AskCounters ask_counters_;

  JitteredBackoff backoff_;
  Outgoing outgoing_;
  Session session_;
  RetainedState retained_;
  ResultDelivery results_;
  SampleSpool spool_;
  SampleDelivery samples_out_;
  CommandIntake intake_;
  StatusSource status_;
  IdentityConflict identity_;
  std::optional<std::string> conflict_;  ///< as it was published
  bool samples_first_ = false;  ///< whose turn it is, where the window is too small to share
  /// Devices with results, not handed over yet, of commands that may have written.
  std::set<std::string> written_;

  ConfigListener config_listener_;
  std::optional<std::string> config_report_;  ///< nothing: there was none so far

  std::vector<std::string> joined_;  ///< devices whose earlier runs are to be looked up
  /// The settings of MQTT are others: until then the broker has time to take our last word.
  std::optional<SteadyTime> goodbye_by_;
  bool changing_ = false;  ///< between begin_change() and change()

  /// The field's counters were asked for, and health waits for them until then.
  std::optional<SteadyTime> counters_by_;
  std::optional<SteadyTime> started_;
  std::int64_t started_ms_ = 0;
  SteadyTime next_tick_{};

  Phase phase_ = Phase::running;
  SteadyTime phase_deadline_{};
};

/// The uplink thread: steps the publisher whenever there is news or something is due, until `stop`
/// was asked for and the clean end is done. `stepped` is called after each step.
void run_uplink(Publisher& publisher, Outbox& outbox, std::stop_token stop,
                const std::function<void()>& stepped = {});

}  // namespace fxagent
