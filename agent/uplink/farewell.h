// The agent's last word to a broker: its retained state becomes offline. Uplink thread. Time is an
// argument.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <optional>

#include "agent/steady_time.h"
#include "agent/uplink/outgoing.h"
#include "agent/uplink/payload/json_payload.h"

namespace fxagent {

class Farewell final : private Outgoing::Sender {
 public:
  /// Time that the broker has to acknowledge it.
  static constexpr std::chrono::seconds kWithin{1};

  /// All references outlive the object. `utc_ms` returns the current calendar time.
  Farewell(JsonPayload& payload, Outgoing& outgoing, std::function<std::int64_t()> utc_ms);

  /// Publishes the offline state.
  void say(SteadyTime now);
  /// Ends the wait for the acknowledgement.
  void withdraw() { by_.reset(); }
  /// Returns the deadline of the broker's acknowledgement: now or earlier if it has been
  /// acknowledged or refused. nullopt: nothing was said, or it was withdrawn.
  std::optional<SteadyTime> by() const { return by_; }

 private:
  void delivered(std::uint64_t id, SteadyTime now) override;
  void failed(const DeliveryFailed& event, SteadyTime now) override;

  JsonPayload& payload_;
  Outgoing& outgoing_;
  const std::function<std::int64_t()> utc_ms_;
  std::optional<SteadyTime> by_;
};

}  // namespace fxagent
