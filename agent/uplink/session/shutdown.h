// Steps in which a session ends, and its last messages. Uplink thread. Time is an argument.
//
// Draining: what is waiting is published. Farewell: the last messages. Closing: the connection is
// closed. Finished: nothing more is sent.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "agent/steady_time.h"
#include "agent/uplink/broker.h"
#include "agent/uplink/outgoing.h"
#include "agent/uplink/session/session.h"

namespace fxagent {

/// The last messages to a broker, in a stop or when it is left for another one.
class Farewell final : private Outgoing::Sender {
 public:
  /// `outgoing` outlives the object. `last_words` returns the messages; there may be none. `what`
  /// names them in the log.
  Farewell(Outgoing& outgoing, std::string what,
           std::function<std::vector<Publication>()> last_words)
      : outgoing_(outgoing), what_(std::move(what)), last_words_(std::move(last_words)) {}

  /// Publishes the messages in place of all that waits for room, with 1 s for the acknowledgement.
  void say(SteadyTime now);
  /// Ends the wait for the acknowledgement.
  void withdraw() { by_.reset(); }
  /// Returns the deadline of the broker's acknowledgement: now or earlier if it has been
  /// acknowledged or refused, or is not needed. nullopt: nothing was said, or it was withdrawn.
  std::optional<SteadyTime> by() const { return by_; }

 private:
  void delivered(std::uint64_t id, SteadyTime now) override;
  void failed(const DeliveryFailed& event, SteadyTime now) override;

  Outgoing& outgoing_;
  const std::string what_;
  const std::function<std::vector<Publication>()> last_words_;
  std::optional<SteadyTime> by_;
};

class Shutdown final {
 public:
  /// All references outlive the object. `drain_for` is the longest time for draining.
  Shutdown(Session& session, Farewell& farewell, std::chrono::seconds drain_for)
      : session_(session), farewell_(farewell), drain_for_(drain_for) {}

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

  Session& session_;
  Farewell& farewell_;
  const std::chrono::seconds drain_for_;
  Phase phase_ = Phase::running;
  SteadyTime deadline_{};  ///< of draining and closing
};

}  // namespace fxagent
