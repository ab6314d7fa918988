// What is retained at the broker: the agent's state, health, and state and meta of each device. All
// of it is published again after each connect, and what the broker refuses for a time comes again
// with its newest value. Uplink thread. Time is an argument.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "agent/config/config.h"
#include "agent/messages.h"
#include "agent/uplink/jittered_backoff.h"
#include "agent/uplink/outgoing.h"
#include "agent/uplink/payload.h"

namespace fxagent {

class RetainedState final : public Outgoing::Sender {
 public:
  /// What is made anew each time that it is published.
  struct Source {
    std::function<Publication()> agent_state;
    std::function<Publication(SteadyTime)> health;
  };

  /// All references outlive it.
  RetainedState(const Config& config, Payload& payload, Outgoing& outgoing,
                JitteredBackoff& backoff, Source source);

  void connection_began();
  void connection_ended() { due_.clear(), flights_.clear(); }
  // These count only while there is a connection: everything is due after the next connect.
  void agent_state_changed() { due_[{Item::agent_state, 0, {}}] = {}; }
  void health_is_due() { due_[{Item::health, 0, {}}]; }
  void device_state_changed(std::uint32_t device) { due_[{Item::device_state, device, {}}] = {}; }
  /// Clears a retained topic. False: it is about to be.
  bool clear(const std::string& topic) { return due_.try_emplace({Item::clear, 0, topic}).second; }

  /// The newest state of a device; published by device_state_changed().
  void set(DeviceStatus status);
  /// By device; null where none was set.
  const std::vector<std::shared_ptr<const DeviceStatus>>& states() const { return states_; }

  void pump(SteadyTime now);
  bool empty() const { return due_.empty(); }
  /// When pump() has something to do at the latest that no acknowledgement tells.
  SteadyTime next_wake(SteadyTime now) const;

  void delivered(std::uint64_t id, SteadyTime now) override;
  void failed(const DeliveryFailed& event, SteadyTime now) override;

 private:
  /// Lower comes first.
  enum class Item : std::uint8_t { agent_state, device_state, device_meta, health, clear };
  struct Key {
    Item item = Item::agent_state;
    std::uint32_t device = 0;
    std::string topic;  ///< clear only
    auto operator<=>(const Key&) const = default;
  };
  struct Due {
    SteadyTime not_before{};
    int failures = 0;
  };
  struct Flight {
    Key key;
    int failures = 0;
  };

  Publication publication_of(const Key& key, SteadyTime now);

  Payload& payload_;
  Outgoing& outgoing_;
  JitteredBackoff& backoff_;
  const Source source_;
  std::vector<std::shared_ptr<const DeviceStatus>> states_;  ///< by device; others read on
  std::map<Key, Due> due_;
  std::map<std::uint64_t, Flight> flights_;  ///< by the id of the publication
};

}  // namespace fxagent
