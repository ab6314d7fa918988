// Takes in commands no faster than they can be answered: a few in each step; while too many are
// waiting, messages stay in the network. Uplink thread. Time is an argument.
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <string>

#include "agent/commands/commands.h"
#include "agent/config/model.h"
#include "agent/steady_time.h"
#include "agent/uplink/broker.h"

namespace fxagent {

/// Counts the messages with QoS 1 that have arrived.
struct Heard {
  std::uint64_t messages = 0;
  std::uint64_t bytes = 0;
};

class CommandIntake final {
 public:
  /// All references outlive the object.
  CommandIntake(Commands& commands, Broker& broker, const MqttConfig& mqtt)
      : commands_(commands), broker_(broker), mqtt_(mqtt) {}

  /// Counts a message with QoS 1, on any topic; ignores QoS 0.
  void hear(const Message& message);
  /// Queues a command for the device of this name. If there is no such device when its turn comes,
  /// the command is refused. Discards a QoS 0 message if there is no room or `results_are_full`:
  /// such messages come as fast as the broker can send. With QoS 1 the broker waits.
  void add(Message message, std::string device, bool results_are_full);
  /// Counts messages that the broker's inbox discarded; as a rule they have QoS 0.
  void count_dropped(std::uint64_t count) { dropped_ += count; }
  /// Passes some of the queued commands to Commands.
  void take_some(SteadyTime now, std::int64_t utc_ms);

  /// Reasons to leave messages in the network.
  struct Pressure {
    bool is_on = false;             ///< connected, and not shutting down
    bool results_are_full = false;  ///< as many are waiting for the broker as there is room for
    bool awaits_suback = false;
    bool awaits_pubacks = false;
  };
  /// Holds messages back if necessary. Lets some in while we wait for an acknowledgement, which
  /// arrives behind them.
  void hold(const Pressure& pressure, SteadyTime now);

  /// True if no more commands should be added before some are passed on.
  bool is_full() const;
  bool is_holding() const { return holding_; }
  const Heard& heard() const { return heard_; }
  bool empty() const { return incoming_.empty(); }
  SteadyTime next_wake(SteadyTime now) const;

 private:
  struct Incoming {
    Message message;
    std::string device;  ///< name of the device
  };

  Commands& commands_;
  Broker& broker_;
  const MqttConfig& mqtt_;
  std::deque<Incoming> incoming_;  ///< not processed yet
  std::size_t bytes_ = 0;
  Heard heard_;
  bool holding_ = false;
  bool lets_in_ = false;  ///< some, for the acknowledgements behind them
  SteadyTime let_in_at_{};
  std::uint64_t dropped_ = 0;  ///< not logged yet
  SteadyTime drop_logged_at_{};
};

}  // namespace fxagent
