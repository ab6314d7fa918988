// Commands on their way in, no faster than they can be answered: a few in each step, and while too
// many wait, messages stay in the network. Uplink thread. Time is an argument.
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <string>

#include "agent/commands/commands.h"
#include "agent/config/config.h"
#include "agent/messages.h"
#include "agent/uplink/broker.h"

namespace fxagent {

/// Messages of QoS 1 that have come.
struct Heard {
  std::uint64_t messages = 0;
  std::uint64_t bytes = 0;
};

class CommandIntake final {
 public:
  /// All references outlive it.
  CommandIntake(Commands& commands, Broker& broker, const MqttConfig& mqtt)
      : commands_(commands), broker_(broker), mqtt_(mqtt) {}

  /// Counts a message, on whatever topic.
  void hear(const Message& message);
  /// A command for the device of this name; where there is none when its turn comes it is refused.
  /// What was published with QoS 0 comes as fast as the broker can send;
  /// where there is no room for it, it is lost, as MQTT allows. With QoS 1 the broker waits.
  void add(Message message, std::string device, bool results_are_full);
  /// The library threw away so many messages of QoS 0.
  void count_dropped(std::uint64_t count) { dropped_ += count; }
  /// Hands some of them to Commands.
  void take_some(SteadyTime now, std::int64_t utc_ms);

  /// Why messages may have to stay in the network.
  struct Pressure {
    bool is_on = false;             ///< connected, and the end was not asked for
    bool results_are_full = false;  ///< as many wait for the broker as there is room for
    bool awaits_suback = false;
    bool awaits_pubacks = false;
  };
  /// Holds messages back where that is due. What waits for an acknowledgement needs what comes
  /// behind the messages: some are let in then.
  void hold(const Pressure& pressure, SteadyTime now);

  bool is_holding() const { return holding_; }
  const Heard& heard() const { return heard_; }
  bool empty() const { return incoming_.empty(); }
  SteadyTime next_wake(SteadyTime now) const;

 private:
  struct Incoming {
    Message message;
    std::string device;  ///< its name
  };

  bool is_full() const;

  Commands& commands_;
  Broker& broker_;
  const MqttConfig& mqtt_;
  std::deque<Incoming> incoming_;  ///< not looked at yet
  std::size_t bytes_ = 0;
  Heard heard_;
  bool holding_ = false;
  bool lets_in_ = false;  ///< some all the same, for what comes behind them
  SteadyTime let_in_at_{};
  std::uint64_t dropped_ = 0;  ///< not logged yet
  SteadyTime drop_logged_at_{};
};

}  // namespace fxagent
