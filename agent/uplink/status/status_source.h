// Makes the agent's status (handover/status.h) from the parts of the uplink and publishes it on the
// status board: at each interval of health, and when a reader asks. Logs samples that do not add
// up. Also has the times at which health is published: each minute, after each connect and when
// something has changed, with current counters if the field answers within 1 s. Uplink thread,
// except for what the board lets other threads do. Time is an argument.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "agent/commands/commands.h"
#include "agent/config/config_difference.h"
#include "agent/config/model.h"
#include "agent/handover/field_health.h"
#include "agent/handover/outbox.h"
#include "agent/handover/status.h"
#include "agent/handover/status_board.h"
#include "agent/handover/telemetry.h"
#include "agent/steady_time.h"
#include "agent/store/guarded_store.h"
#include "agent/uplink/commands/result_delivery.h"
#include "agent/uplink/retained/device_states.h"
#include "agent/uplink/retained/retained_state.h"
#include "agent/uplink/samples/sample_delivery.h"
#include "agent/uplink/session/session.h"
#include "agent/uplink/session/subscriptions.h"

namespace fxagent {

class Outlet;

/// Last values of each group, for the status: its last whole sample, and each tag that a command
/// has written since. Each is a row (store/samples/sample_record) of 10 to 25 bytes per tag,
/// including its name. The result of groups() may be read on any thread.
class LastSamples final {
 public:
  /// `config` outlives the object.
  explicit LastSamples(const Config& config) : config_(config) {}

  void add(const Telemetry& message);
  /// Adapts to a config change, which `config` already contains.
  void change(const ConfigChange& change);
  /// Empty until the first add().
  const LastValues& groups() const { return groups_; }

 private:
  const Config& config_;
  LastValues groups_;
};

class StatusSource final {
 public:
  /// The parts from which the status is made; all outlive the object.
  struct Parts {
    const Config& config;
    const CommandResults& command_results;
    const Session& session;
    const Subscriptions& subscriptions;
    const DeviceStates& states;
    RetainedState& retained;
    const ResultDelivery& results;
    SampleDelivery& samples;
    const GuardedStore* store = nullptr;  ///< null: no store
    const std::vector<Outlet*>& outlets;
    std::string boot;
    std::string version;
  };

  /// `utc_ms` returns the current calendar time; `wake` as in StatusBoard. `ask_counters` makes the
  /// field send its counters; empty: health never waits for them.
  StatusSource(Parts parts, std::function<std::int64_t()> utc_ms, std::function<void()> wake,
               std::function<void()> ask_counters);

  /// Adapts to a config change, which `config` already contains.
  void change(const ConfigChange& change);
  void set_config_status(ConfigStatus status) {
    config_status_ = std::move(status);
    published_.reset();
  }

  /// Starts the agent's uptime.
  void start(SteadyTime now);
  /// Takes the field's values and counters. Moves from `batch.health`; leaves the samples.
  void take(Outbox::Batch& batch, SteadyTime now);
  /// Sets the boot of another agent with the same id; empty: none.
  void set_conflict(std::string other_boot) {
    conflict_ = std::move(other_boot);
    published_.reset();
  }
  /// Publishes health as soon as the field's counters have come or are overdue. Call only while
  /// connected.
  void request_health(SteadyTime now);
  void connection_ended() { counters_by_.reset(); }
  /// Publishes the status that is due, to the board and as health.
  void report(SteadyTime now);
  /// Returns the time by which report() must run again.
  SteadyTime next_wake() const;

  /// Returns the current status; the published one if it is of this step.
  std::shared_ptr<const AgentStatus> at(SteadyTime now);
  /// Returns the samples counted by location.
  SampleCounts samples() const;
  StatusBoard& board() { return board_; }

 private:
  AgentStatus make(SteadyTime now) const;
  BrokerStatus broker(SteadyTime now) const;
  /// Restarts rates, logs faults and publishes a status.
  void tick(SteadyTime now);
  void health_is_due();
  void log_unbalanced() const;

  const Parts parts_;
  /// Shared with each status made under it.
  std::shared_ptr<const Config> config_;
  ConfigStatus config_status_;
  const std::function<std::int64_t()> utc_ms_;
  StatusBoard board_;
  const std::function<void()> ask_counters_;
  LastSamples last_;

  std::uint64_t pushed_ = 0;  ///< samples passed on by the outbox
  std::shared_ptr<const FieldHealth> field_ = std::make_shared<const FieldHealth>();
  std::optional<SteadyTime> field_heard_;
  bool miscounted_ = false;  ///< field_ disagrees with the samples passed on by the outbox
  std::string conflict_;
  std::string store_state_;  ///< of the newest status
  std::int64_t store_since_ms_ = 0;
  std::optional<double> bytes_per_hour_;  ///< of the last minute or longer with samples
  SteadyTime started_{};
  SteadyTime next_tick_{};
  /// Set when the field's counters were requested: health waits for them until then.
  std::optional<SteadyTime> counters_by_;
  SteadyTime rate_since_{};
  std::shared_ptr<const AgentStatus> published_;
  SteadyTime published_at_{};
};

}  // namespace fxagent
