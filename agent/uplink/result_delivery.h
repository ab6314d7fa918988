// Results of commands on their way to the broker: each goes to the device's topic, and to the
// response topic if its command names one, again and again until it was acknowledged or refused for
// good. None is ever dropped. Uplink thread. Time is an argument.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "agent/commands/commands.h"
#include "agent/config/config.h"
#include "agent/messages.h"
#include "agent/uplink/command_intake.h"
#include "agent/uplink/jittered_backoff.h"
#include "agent/uplink/outgoing.h"

namespace fxagent {

class ResultDelivery final : public Outgoing::Sender {
 public:
  using UtcClock = std::function<std::int64_t()>;

  /// All references outlive it.
  ResultDelivery(const Config& config, Commands& commands, Outgoing& outgoing,
                 JitteredBackoff& backoff, UtcClock utc_ms);

  void add(ResultMessage result);
  /// Hands over what has room. `heard`: the messages that have come, while some are held back.
  /// True: some went, and where the window is too small to share, samples go first the next time.
  bool pump(SteadyTime now, std::optional<Heard> heard);
  /// All that was on its way goes again with the next connection.
  void connection_ended();

  void delivered(std::uint64_t id, SteadyTime now) override;
  void failed(const DeliveryFailed& event, SteadyTime now) override;

  /// Whether more has come since some result went than a broker sends that keeps to the Receive
  /// Maximum.
  bool is_far_behind(const Heard& heard) const;
  /// Of the commands that were carried out: from arrival to the hand-over of the result to MQTT.
  const DurationHistogram& durations() const { return durations_; }
  bool empty() const { return results_.empty(); }
  std::size_t size() const { return results_.size(); }
  std::size_t bytes() const { return bytes_; }  ///< in memory, roughly
  /// As many wait as there is room for: no more commands are to be read.
  bool is_full() const;
  /// When pump() has something to do at the latest that no acknowledgement tells.
  SteadyTime next_wake(SteadyTime now) const;

 private:
  struct Copy {
    std::string topic{};
    bool to_response_topic = false;
    bool in_flight = false;
    bool done = false;
    bool acknowledged = false;
    SteadyTime not_before{};
    int failures = 0;
  };
  struct Pending {
    ResultMessage result;
    bool handed_over = false;  ///< to MQTT, once: total_ms ends there
    std::size_t bytes = 0;     ///< that it takes in memory, roughly
    std::vector<Copy> copies;
  };
  struct Flight {
    std::uint64_t result = 0;
    std::size_t copy = 0;
    std::optional<Heard> heard{};  ///< before it went; none: nothing was held back then
  };
  enum class Ended : std::uint8_t { acknowledged, refused };

  std::size_t window() const;
  void hand_over(std::uint64_t key, std::size_t copy, SteadyTime now, std::optional<Heard> heard);
  void copy_done(const Flight& flight, Ended how);

  const std::string base_;
  Commands& commands_;
  Outgoing& outgoing_;
  JitteredBackoff& backoff_;
  const UtcClock utc_ms_;

  std::uint64_t next_ = 1;
  std::map<std::uint64_t, Pending> results_;  ///< the oldest first
  std::map<std::uint64_t, Flight> flights_;   ///< by the id of the publication
  std::size_t bytes_ = 0;
  DurationHistogram durations_;
  std::set<std::uint64_t> refused_;  ///< that the broker has refused once: they come again
};

}  // namespace fxagent
