// Delivers the samples of one session to its broker. Keeps each live sample until it is
// acknowledged; a sample that has waited for 1 s is also on disk. Samples that find no room become
// history. Uplink thread. Time is an argument.
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <map>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "agent/config/config_difference.h"
#include "agent/config/model.h"
#include "agent/handover/outbox.h"
#include "agent/handover/status.h"
#include "agent/steady_time.h"
#include "agent/store/guarded_store.h"
#include "agent/store/samples/sample_record.h"
#include "agent/uplink/jittered_backoff.h"
#include "agent/uplink/outgoing.h"
#include "agent/uplink/payload/payload.h"
#include "agent/uplink/samples/history_delivery.h"
#include "agent/uplink/samples/sample_spool.h"

namespace fxagent {

class SampleDelivery final : public Outgoing::Sender {
 public:
  /// All references outlive the object. `store` and `backlog_bytes` are those of WaitingSamples;
  /// `store` is null without a store.
  SampleDelivery(const Config& config, std::string boot, SamplePayload& payload, Outgoing& outgoing,
                 JitteredBackoff& backoff, GuardedStore* store, std::size_t backlog_bytes);

  /// Adapts to a config change, which `config` already contains.
  void change(const ConfigChange& change);

  /// Takes samples from the field, and counts those that the outbox has dropped. `can_go`: there is
  /// a connection, or the first one is being made; otherwise the samples become history.
  void take(const Outbox::Batch& batch, bool can_go, SteadyTime now);
  /// Spools samples that have waited for 1 s to disk. Those without room become history; those in
  /// flight stay in flight. Ends with SampleSpool::commit().
  void settle(SteadyTime now, bool can_wait);
  void pump_live(SteadyTime now);
  /// HistoryDelivery::pump(), unless live samples are waiting.
  void pump_history(bool rests, SteadyTime now);
  /// Moves live samples of these devices that have found no room so far to history.
  void make_history(const std::set<std::string>& devices);

  /// Ends the pauses after refusals. Messages of history have their full size again.
  void connection_began();
  /// Moves everything to history, samples in flight included.
  void connection_ended();
  /// Moves live samples to history, after a failed attempt to connect.
  void spool_live();

  void delivered(std::uint64_t id, SteadyTime now) override;
  void failed(const DeliveryFailed& event, SteadyTime now) override;

  /// Adds the samples by location, each once: a live one on disk counts as stored. Also adds those
  /// recovered, and the sends.
  void add_to(SampleCounts& counts) const;
  /// Returns the bytes of the rows made since the last call.
  std::uint64_t take_row_bytes() { return std::exchange(row_bytes_, 0); }
  bool has_live() const { return !live_.empty(); }
  /// True if a live sample from `time` or earlier has found no room so far.
  bool has_live_from(SteadyTime time) const { return has_live() && live_.front().since <= time; }
  /// True if so many samples are waiting that the broker accepts fewer than are produced.
  bool is_backed_up() const;
  /// Returns the time until which samples may gather before the next step. While they stream in,
  /// that is 1/100 of their shortest interval after the last samples, at most 5 ms; otherwise the
  /// time of the last samples.
  SteadyTime gather_until() const { return gather_until_; }
  /// Returns the time by which settle(), or upkeep() for rows at the disk, must run. history() has
  /// its own.
  SteadyTime next_wake(SteadyTime now) const;

  SampleSpool& spool() { return spool_; }
  const HistoryDelivery& history() const { return history_; }
  const RefusedDevices& refused() const { return refused_; }

 private:
  struct Flight {
    LiveRow live;
    SteadyTime since{};
  };

  void hold_on_disk(SteadyTime now);
  bool may_send(const std::string& device, SteadyTime now) const;

  const Config& config_;
  const std::string boot_;
  SamplePayload& payload_;
  Outgoing& outgoing_;
  RefusedDevices refused_;
  SampleSpool spool_;
  std::uint64_t published_ = 0;  ///< repeats included, history not
  HistoryDelivery history_;
  std::vector<std::string> meta_hashes_;  ///< by device; empty: not computed yet

  std::uint64_t next_row_id_ = 1;
  std::deque<LiveRow> live_;
  SampleRecord record_;                      ///< the live sample being sent
  std::map<std::uint64_t, Flight> flights_;  ///< by publication id
  SteadyTime samples_at_{};                  ///< last step with samples
  SteadyTime gather_until_{};
  std::uint64_t row_bytes_ = 0;
};

}  // namespace fxagent
