#include "agent/uplink/commands/command_intake.h"

#include <algorithm>
#include <chrono>
#include <utility>

#include "agent/log/log.h"

namespace fxagent {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

constexpr std::size_t kCommandsAStep = 32;  // samples and results are sent in between
// Limits for messages received and not processed. Above them messages stay in the network.
constexpr std::size_t kMostWaiting = 256;
constexpr std::size_t kMostWaitingBytes = std::size_t{4} << 20;
// Acknowledgements arrive behind the messages held back, so a few of those are let in.
constexpr milliseconds kLetInEvery{2};
constexpr std::size_t kLetIn = 8;  // fewer than the results sent in that time
// Time before checking again if messages must be held back.
constexpr milliseconds kHoldAtMost{1};
constexpr seconds kLogDropsEvery{10};

}  // namespace

void CommandIntake::hear(const Message& message) {
  if (message.qos == 0) return;  // the broker sends these without flow control
  ++heard_.messages;
  heard_.bytes += bytes_of(message);
}

bool CommandIntake::is_full() const {
  return incoming_.size() >= kMostWaiting || bytes_ >= kMostWaitingBytes;
}

void CommandIntake::add(Message message, std::string device, bool results_are_full) {
  if (message.qos == 0 && (is_full() || results_are_full)) {
    ++dropped_;
    return;
  }
  bytes_ += bytes_of(message);
  incoming_.push_back({std::move(message), std::move(device)});
}

void CommandIntake::take_some(SteadyTime now, std::int64_t utc_ms) {
  for (std::size_t i = 0; i < kCommandsAStep && !incoming_.empty(); ++i) {
    auto [message, name] = std::move(incoming_.front());
    incoming_.pop_front();
    bytes_ -= bytes_of(message);
    // An empty retained payload only clears the topic. On 3.1.1 we do not receive its retain flag.
    if (message.payload.empty() && (message.retained || mqtt_.version != 5)) continue;
    MessageProperties& properties = message;
    commands_.receive(name, message.topic, message.payload, std::move(properties), now, utc_ms);
  }
  commands_.hand_over(utc_ms);
}

void CommandIntake::hold(const Pressure& pressure, SteadyTime now) {
  if (dropped_ != 0 && now >= drop_logged_at_ + kLogDropsEvery) {
    log::error(
        "messages_dropped",
        {{"count", std::to_string(std::exchange(dropped_, 0))},
         {"note",
          "more QoS 0 commands arrived than the agent can answer; with QoS 1 the broker waits"}});
    drop_logged_at_ = now;
  }
  holding_ = pressure.is_on && (is_full() || pressure.results_are_full);
  lets_in_ = holding_ && (pressure.awaits_suback || (!is_full() && pressure.awaits_pubacks));
  if (!lets_in_) return broker_.hold_messages(holding_);
  if (now < let_in_at_) return;
  let_in_at_ = now + kLetInEvery;
  broker_.hold_messages(true, kLetIn);
}

SteadyTime CommandIntake::next_wake(SteadyTime now) const {
  if (!incoming_.empty()) return now;
  SteadyTime wake = SteadyTime::max();
  if (lets_in_) wake = std::max(let_in_at_, now + kHoldAtMost);
  if (dropped_ != 0) wake = std::min(wake, drop_logged_at_ + kLogDropsEvery);
  return wake;
}

}  // namespace fxagent
