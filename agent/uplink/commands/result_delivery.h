// Delivers results of commands. Each goes to the device's topic, and to the response topic if its
// command names one, repeatedly until it is acknowledged or finally refused. No result is dropped.
// Uplink thread. Time is an argument.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "agent/commands/command_results.h"
#include "agent/config/model.h"
#include "agent/steady_time.h"
#include "agent/uplink/commands/command_intake.h"
#include "agent/uplink/jittered_backoff.h"
#include "agent/uplink/outgoing.h"

namespace fxagent {

class ResultDelivery final : public Outgoing::Sender {
 public:
  using UtcClock = std::function<std::int64_t()>;

  /// All references outlive the object.
  ResultDelivery(const Config& config, CommandResults& results, Outgoing& outgoing,
                 JitteredBackoff& backoff, UtcClock utc_ms);

  /// Calls the result's `reply`, if it has one, and queues the result for the broker unless no
  /// device can have the name.
  void add(ResultMessage result, SteadyTime now);
  /// Sends results for which there is room. `heard` is the count of messages received so far, if
  /// some are held back. True: some were sent, and the window is too small to share, so samples go
  /// first next time.
  bool pump(SteadyTime now, std::optional<Heard> heard);
  /// Everything in flight is sent again with the next connection.
  void connection_ended();

  void delivered(std::uint64_t id, SteadyTime now) override;
  void failed(const DeliveryFailed& event, SteadyTime now) override;

  /// True if more messages have arrived since some result was sent than a broker sends that
  /// respects the Receive Maximum, and it was no burst that the agent can take whole.
  bool is_far_behind(const Heard& heard) const;
  /// Durations of executed commands, from arrival to the hand-over of the result to MQTT.
  const DurationHistogram& durations() const { return durations_; }
  bool empty() const { return results_.empty(); }
  std::size_t size() const { return results_.size(); }
  std::size_t bytes() const { return bytes_; }  ///< in memory, approximately
  /// True while a result is repeated because the broker has refused it. The result of a command
  /// for a name that is not in the config does not count.
  bool is_refused() const;
  /// True if as many results are waiting as there is room for. Do not read more commands then.
  bool is_full() const;
  /// Returns the time by which pump() must run, apart from acknowledgements.
  SteadyTime next_wake(SteadyTime now) const;

 private:
  /// In this order: from acknowledged on, a copy is done.
  enum class State : std::uint8_t { waiting, in_flight, acknowledged, refused };
  struct Copy {
    std::string topic{};
    State state = State::waiting;
    SteadyTime not_before{};
    int failures = 0;
    bool refused = false;  ///< the last failure came from the broker, and not from the library
  };
  struct Pending {
    ResultMessage result;      ///< its `total` ends when it is first handed over to MQTT
    std::size_t bytes = 0;     ///< memory use, approximately
    std::vector<Copy> copies;  ///< for the device's topic; for the response topic, if there is one
  };
  struct Flight {
    std::uint64_t result = 0;
    std::size_t copy = 0;
    std::optional<Heard> heard{};  ///< before it was sent; nullopt: nothing was held back
  };

  std::size_t window() const;
  void hand_over(std::uint64_t key, std::size_t copy, SteadyTime now, std::optional<Heard> heard);
  void copy_done(const Flight& flight, State how);

  const Config& config_;
  CommandResults& source_;
  Outgoing& outgoing_;
  JitteredBackoff& backoff_;
  const UtcClock utc_ms_;

  std::uint64_t next_ = 1;
  std::map<std::uint64_t, Pending> results_;  ///< oldest first
  std::map<std::uint64_t, Flight> flights_;   ///< by publication id
  std::size_t bytes_ = 0;
  DurationHistogram durations_;
};

}  // namespace fxagent
