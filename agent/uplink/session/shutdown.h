// The steps of a clean stop, and the agent's last word to a broker. Uplink thread. Time is an
// argument.
//
// Draining: what is waiting is published for up to 3 s. Farewell: the agent's state becomes
// offline. Closing: the connection is closed. Finished: nothing more is sent.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>

#include "agent/steady_time.h"
#include "agent/uplink/broker.h"
#include "agent/uplink/outgoing.h"
#include "agent/uplink/payload/json_payload.h"
#include "agent/uplink/session/session.h"

namespace fxagent {

/// The agent's last word to a broker, in a stop or when it is left for another one: the agent's
/// retained state becomes offline.
class Farewell final : private Outgoing::Sender {
 public:
  /// All references outlive the object. `utc_ms` returns the current calendar time.
  Farewell(JsonPayload& payload, Outgoing& outgoing, std::function<std::int64_t()> utc_ms);

  /// Publishes the offline state. The broker has 1 s to acknowledge it.
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

class Shutdown final {
 public:
  /// All references outlive the object.
  Shutdown(Broker& broker, Session& session, Farewell& farewell)
      : broker_(broker), session_(session), farewell_(farewell) {}

  /// Begins. Call once.
  void begin(SteadyTime now);
  /// Takes the next step if it is due. Call at the end of each step of the uplink. `drained`:
  /// nothing waits any more.
  void step(bool drained, SteadyTime now);
  /// The broker has received our DISCONNECT.
  void disconnected(SteadyTime now);

  bool has_begun() const { return phase_ != Phase::running; }
  /// True until the farewell: publications still go out.
  bool may_publish() const { return phase_ <= Phase::draining; }
  bool finished() const { return phase_ == Phase::finished; }
  /// Returns the time by which step() must run, after begin().
  SteadyTime next_wake() const;

 private:
  enum class Phase : std::uint8_t { running, draining, farewell, closing, finished };

  Broker& broker_;
  Session& session_;
  Farewell& farewell_;
  Phase phase_ = Phase::running;
  SteadyTime deadline_{};  ///< of draining and closing
};

}  // namespace fxagent
