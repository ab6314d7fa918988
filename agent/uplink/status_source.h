// Makes the agent's status (agent/status.h) of what the parts of the uplink know, and publishes it
// on the status board: at each tick of health, and when a reader asks. Says in the log where the
// samples do not add up. Uplink thread, but for what the board lets others do.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include "agent/commands/commands.h"
#include "agent/config/config.h"
#include "agent/config/config_difference.h"
#include "agent/messages.h"
#include "agent/outbox.h"
#include "agent/status.h"
#include "agent/status_board.h"
#include "agent/store/guarded_store.h"
#include "agent/uplink/last_samples.h"
#include "agent/uplink/result_delivery.h"
#include "agent/uplink/retained_state.h"
#include "agent/uplink/sample_delivery.h"
#include "agent/uplink/sample_spool.h"
#include "agent/uplink/session.h"

namespace fxagent {

class StatusSource final {
 public:
  /// What it asks; all outlive it.
  struct Parts {
    const Config& config;
    const Commands& commands;
    const Session& session;
    const RetainedState& retained;
    const SampleSpool& spool;
    const ResultDelivery& results;
    SampleDelivery& samples;
    const GuardedStore* store = nullptr;  ///< null: none
  };
  struct Run {
    std::string boot;
    std::string version;
  };

  /// `utc_ms` tells the calendar time of "now"; `wake` as in StatusBoard.
  StatusSource(Parts parts, Run run, std::function<std::int64_t()> utc_ms,
               std::function<void()> wake);

  /// The config is that of the change from now on.
  void change(const ConfigChange& change);
  void set_config_status(ConfigStatus status) {
    config_status_ = std::move(status);
    published_.reset();
  }

  /// The agent's time begins.
  void start(SteadyTime now);
  /// What the field said of values and counters. Takes `batch.health`; the samples stay.
  void take(Outbox::Batch& batch, SteadyTime now);
  /// Boot of another agent with the same id; empty: there is none.
  void set_conflict(std::string other_boot) {
    conflict_ = std::move(other_boot);
    published_.reset();
  }
  /// The time of health: rates begin anew, what is wrong goes to the log, a status is published.
  void tick(SteadyTime now);
  /// Publishes a status where a reader waits for it.
  void answer(SteadyTime now);

  /// The status of this moment; the published one where that is of this very step.
  std::shared_ptr<const AgentStatus> at(SteadyTime now);
  /// Where every sample is.
  SampleCounts samples() const;
  StatusBoard& board() { return board_; }

 private:
  AgentStatus make(SteadyTime now) const;
  BrokerStatus broker(SteadyTime now) const;
  void log_samples();

  const Parts parts_;
  /// Shared with each status made under it.
  std::shared_ptr<const Config> config_;
  ConfigStatus config_status_;
  const Run run_;
  const std::function<std::int64_t()> utc_ms_;
  StatusBoard board_;
  LastSamples last_;

  std::uint64_t pushed_ = 0;  ///< samples that the outbox has handed over
  std::shared_ptr<const FieldHealth> field_ = std::make_shared<const FieldHealth>();
  std::optional<SteadyTime> field_heard_;
  bool miscounted_ = false;  ///< field_ does not agree with what the outbox has handed over
  std::string conflict_;
  std::uint64_t dropped_at_tick_ = 0;
  std::optional<double> bytes_per_hour_;  ///< of the last minute or longer that had samples
  SteadyTime started_{};
  SteadyTime rate_since_{};
  std::shared_ptr<const AgentStatus> published_;
  SteadyTime published_at_{};
};

}  // namespace fxagent
