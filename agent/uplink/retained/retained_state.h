// Retained messages: the state of the agent, health, the config report, and each device's state and
// meta. All of them are published again after each connect. A message that the broker refuses for a
// time is repeated with its newest value. States and meta that another client has overwritten are
// restored. Uplink thread. Time is an argument.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <utility>

#include "agent/config/config_difference.h"
#include "agent/config/model.h"
#include "agent/steady_time.h"
#include "agent/uplink/jittered_backoff.h"
#include "agent/uplink/outgoing.h"
#include "agent/uplink/payload/json_payload.h"
#include "agent/uplink/retained/device_states.h"

namespace fxagent {

class RetainedState final : public Outgoing::Sender {
 public:
  /// Lower values are published first.
  enum class Item : std::uint8_t {
    agent_state,
    device_state,
    device_meta,
    health,
    config_report,
    clear
  };
  /// Makes a message anew each time that it is published.
  struct Source {
    std::function<Publication()> agent_state;
    std::function<Publication(SteadyTime)> health;
  };

  /// All references outlive the object. `what` names the session in the log of a refusal.
  RetainedState(const Config& config, const DeviceStates& states, JsonPayload& payload,
                Outgoing& outgoing, JitteredBackoff& backoff, std::string what, Source source);

  /// Everything is due except health, whose counters must be requested first.
  void connection_began();
  void connection_ended();
  /// Makes the agent's state, and states and meta of all devices due again: another agent may have
  /// overwritten them.
  void everything_is_due();
  /// Sets the text of {base}/config/reported. Until then nothing is published there. Empty: the
  /// topic is cleared, until a broker has acknowledged that or refused it for good.
  /// config_report_is_due() publishes it in this connection.
  void set_config_report(std::string text) { config_report_ = std::move(text); }
  // These have an effect only while connected: a connection begins with everything.
  void agent_state_changed() { due_[{Item::agent_state, 0, {}}].not_before = {}; }
  void health_is_due() { due_[{Item::health, 0, {}}]; }
  void config_report_is_due() { due_[{Item::config_report, 0, {}}].not_before = {}; }
  void device_state_changed(std::uint32_t device) {
    due_[{Item::device_state, device, {}}].not_before = {};
  }
  /// Clears a retained topic, in the next connection if there is none or it breaks. Returns false
  /// if that is pending already.
  bool clear(const std::string& topic) { return due_.try_emplace({Item::clear, 0, topic}).second; }

  /// Processes a text received on one of our topics. `item`: agent_state, with `device` 0;
  /// device_state or device_meta. If it is not what we published, ours is published again, at
  /// least 1 s after its last publication. A text that was there before ours does not count: ours
  /// comes back after it.
  void heard(Item item, std::uint32_t device, std::string_view payload, SteadyTime now);

  /// Adapts to a config change, as `config` and `states` have done already. Stops publishing what
  /// ends. Publishes the meta of what begins; its state follows when the field has reported it.
  /// Clears the topics of removed devices.
  void change(const ConfigChange& change);

  void pump(SteadyTime now);
  bool empty() const { return due_.empty(); }
  /// True while a message is repeated because the broker has refused it. A message that only
  /// clears a topic does not count: the config in force does not need it.
  bool is_refused() const;
  /// Returns the time by which pump() must run, apart from acknowledgements.
  SteadyTime next_wake(SteadyTime now) const;

  void delivered(std::uint64_t id, SteadyTime now) override;
  void failed(const DeliveryFailed& event, SteadyTime now) override;

 private:
  struct Key {
    Item item = Item::agent_state;
    std::uint32_t device = 0;
    std::string topic;  ///< clear only
    auto operator<=>(const Key&) const = default;
  };
  struct Due {
    SteadyTime not_before{};
    int failures = 0;
    bool refused = false;  ///< the last failure came from the broker, and not from the library
  };
  struct Flight {
    Key key;
    Due due;
    std::string topic;
    bool clears = false;  ///< it has no text
  };

  /// The last publication on a topic.
  struct Published {
    std::size_t hash = 0;  ///< of the payload
    SteadyTime at{};
    bool came_back = false;  ///< the broker has sent it back to us
  };

  void forget(std::uint32_t device);
  Publication publication_of(const Key& key, SteadyTime now);

  const Config& config_;
  const DeviceStates& states_;
  JsonPayload& payload_;
  Outgoing& outgoing_;
  JitteredBackoff& backoff_;
  const std::string what_;
  const Source source_;
  std::optional<std::string> config_report_;
  std::map<Key, Due> due_;
  std::map<std::uint64_t, Flight> flights_;  ///< by publication id
  std::map<Key, Published> published_;       ///< in this connection
  std::map<Key, SteadyTime> repairs_;        ///< when each is due
  std::set<Key> logged_;                     ///< overwritten in this connection, and logged
};

}  // namespace fxagent
