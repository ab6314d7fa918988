// Delivers the backlog as history messages, in between live samples: at most two at a time, each of
// a different stream, with a pause after each. Uplink thread. Time is an argument.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>

#include "agent/steady_time.h"
#include "agent/uplink/outgoing.h"
#include "agent/uplink/payload/payload.h"
#include "agent/uplink/samples/sample_spool.h"

namespace fxagent {

class HistoryDelivery final : public Outgoing::Sender {
 public:
  /// All references outlive the object.
  HistoryDelivery(SamplePayload& payload, Outgoing& outgoing, RefusedDevices& refused,
                  WaitingSamples& waiting);

  /// Sends messages for which there is room. Call only if no live samples are waiting. `rests`:
  /// history pauses after each message.
  void pump(bool rests, SteadyTime now);
  void connection_began();
  /// What was in flight is sent again with the next connection.
  void connection_ended();

  void delivered(std::uint64_t id, SteadyTime now) override;
  void failed(const DeliveryFailed& event, SteadyTime now) override;

  bool is_on_the_way() const { return !flights_.empty(); }
  /// Number of samples published, repeats included.
  std::uint64_t published() const { return published_; }
  /// Returns the time by which pump() must run, apart from acknowledgements.
  SteadyTime next_wake(SteadyTime now) const;

 private:
  struct Flight {
    OutgoingHistory history;
    std::size_t max_bytes = 0;  ///< its limit when it was made
    SteadyTime since{};
  };

  bool has_room() const;
  /// Takes a message that has ended, delivered or not; begins the pause after it.
  Flight ended(std::uint64_t id, SteadyTime now);

  SamplePayload& payload_;
  Outgoing& outgoing_;
  RefusedDevices& refused_;
  WaitingSamples& waiting_;
  std::map<std::uint64_t, Flight> flights_;  ///< by publication id
  std::uint64_t published_ = 0;
  SteadyTime rests_until_{};  ///< until then live samples have the broker to themselves
  std::size_t max_bytes_;     ///< of one message; reduced if it is too large
};

}  // namespace fxagent
