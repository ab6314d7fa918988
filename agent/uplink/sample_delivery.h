// Samples on their way to the broker: live ones at once, and beside them what had to wait, as
// history. None is forgotten before its acknowledgement; one that waited for a second is on disk
// too. Uplink thread. Time is an argument. More than twenty functions: half of them say one word
// about the state.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "agent/config/config.h"
#include "agent/config/config_difference.h"
#include "agent/messages.h"
#include "agent/store/sample_record.h"
#include "agent/uplink/jittered_backoff.h"
#include "agent/uplink/outgoing.h"
#include "agent/uplink/payload.h"
#include "agent/uplink/sample_spool.h"

namespace fxagent {

class SampleDelivery final : public Outgoing::Sender {
 public:
  struct Counters {
    std::uint64_t acknowledged = 0;
    std::uint64_t published = 0;  ///< sends, repeats included
    std::uint64_t queued = 0;     ///< live ones that are not on disk
    std::uint64_t in_flight = 0;  ///< the same, on their way
  };

  /// All references outlive it. `store` null: there is none.
  SampleDelivery(const Config& config, std::string boot, Payload& payload, Outgoing& outgoing,
                 JitteredBackoff& backoff, SampleSpool& spool, GuardedStore* store);

  /// The config is that of the change from now on.
  void change(const ConfigChange& change);

  /// What the field made. `can_go`: there is a connection, or the first one is being made; else the
  /// samples are history.
  void take(const std::vector<Telemetry>& messages, bool can_go, SteadyTime now);
  /// What waited for a second goes to the disk: what found no room as history, what is on its way
  /// beside.
  void settle(SteadyTime now);
  void pump_live(SteadyTime now);
  /// Samples of these devices that have found no room so far go as history.
  void make_history(const std::set<std::string>& devices);
  /// `rests`: history rests after each message.
  void pump_history(bool rests, SteadyTime now);

  void connection_began();
  void connection_ended();
  /// An attempt to connect has failed: what is live is history.
  void spool_live();

  void delivered(std::uint64_t id, SteadyTime now) override;
  void failed(const DeliveryFailed& event, SteadyTime now) override;

  Counters counters() const;
  /// The MQTT reason code for which the broker does not take the device's samples; nullopt: it
  /// does.
  std::optional<int> refused(const std::string& device) const;
  /// Bytes of the rows made since the last call.
  std::uint64_t take_row_bytes() { return std::exchange(row_bytes_, 0); }
  bool has_live() const { return !live_.empty(); }
  bool has_history_on_the_way() const { return history_flights_ != 0; }
  /// So many wait that the broker takes fewer than are made.
  bool is_backed_up() const;
  /// Until when samples may gather before the next step: a hundredth of their interval while they
  /// stream in, and the time of the last step where they do not.
  SteadyTime gather_until() const { return gather_until_; }
  SteadyTime next_wake(SteadyTime now) const;

 private:
  struct Flight {
    std::optional<LiveRow> live;  ///< else it is history
    OutgoingHistory history;
    SteadyTime since{};
  };
  /// A device whose samples the broker refuses for the time being, or the library does not take
  /// (reason code 0).
  struct Pause {
    SteadyTime since{};  ///< of the last refusal
    SteadyTime until{};
    int failures = 0;
    int reason_code = 0;
  };

  const std::string& meta_hash(std::uint32_t device);
  void overflow(SteadyTime now);
  void hold_on_disk(SteadyTime now);
  void live_failed(LiveRow live, const DeliveryFailed& event, SteadyTime now);
  void history_failed(const OutgoingHistory& history, const DeliveryFailed& event, SteadyTime now);
  bool has_room() const;
  bool has_room_for_history() const;
  bool may_send(const std::string& device, SteadyTime now) const;
  void pause(const std::string& device, const DeliveryFailed& event, SteadyTime now);
  void taken(const std::string& device, SteadyTime since);
  /// A history message is over, in whatever way.
  void rest(SteadyTime since, SteadyTime now);

  const Config& config_;
  const std::string boot_;
  Payload& payload_;
  Outgoing& outgoing_;
  JitteredBackoff& backoff_;
  SampleSpool& spool_;
  GuardedStore* const store_;
  std::vector<std::string> meta_hashes_;  ///< by device; empty: not asked for yet

  std::uint64_t next_row_id_ = 1;
  std::deque<LiveRow> live_;
  SampleRecord record_;                      ///< the live sample that is being sent
  std::map<std::uint64_t, Flight> flights_;  ///< by the id of the publication
  std::size_t history_flights_ = 0;
  std::uint64_t in_flight_ = 0;       ///< live ones that are not on disk
  SteadyTime history_rests_until_{};  ///< live samples have the broker to themselves
  std::size_t history_bytes_;         ///< of one message; shrinks where it is too large
  SteadyTime samples_at_{};           ///< the last step that found some
  SteadyTime gather_until_{};
  std::map<std::string, Pause> pauses_;  ///< by name, as in the store
  std::uint64_t acknowledged_ = 0;
  std::uint64_t published_ = 0;
  std::uint64_t row_bytes_ = 0;
};

}  // namespace fxagent
