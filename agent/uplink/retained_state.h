// What is retained at the broker: the agent's state, health, what became of a remote config, and
// state and meta of each device. All of it is published again after each connect, and what the
// broker refuses for a time comes again with its newest value. States and meta that somebody else
// has overwritten are repaired. Uplink thread. Time is an argument. More than twenty functions:
// most say one word about one topic.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "agent/config/config.h"
#include "agent/config/config_difference.h"
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
    /// Of {base}/config/reported.
    std::function<Publication()> config_report;
  };

  /// All references outlive it.
  RetainedState(const Config& config, Payload& payload, Outgoing& outgoing,
                JitteredBackoff& backoff, Source source);

  /// All but health, whose counters are to be asked for first, and the report of a config.
  void connection_began();
  void connection_ended();
  /// The same in a connection that stands: another agent may have written there.
  void everything_is_due();
  // These count only while there is a connection: everything is due after the next connect.
  void agent_state_changed() { due_[{Item::agent_state, 0, {}}] = {}; }
  void health_is_due() { due_[{Item::health, 0, {}}]; }
  void config_report_is_due() { due_[{Item::config_report, 0, {}}] = {}; }
  void device_state_changed(std::uint32_t device) { due_[{Item::device_state, device, {}}] = {}; }
  /// Clears a retained topic. False: it is about to be.
  bool clear(const std::string& topic) { return due_.try_emplace({Item::clear, 0, topic}).second; }

  // What was heard on topics of ours. Where it is not what was published there, that is published
  // again, a second after it was published last at the soonest. What was there before ours came is
  // no such text: ours comes back behind it.
  void heard_agent_state(std::string_view payload, SteadyTime now) {
    heard({Item::agent_state, 0, {}}, payload, now);
  }
  void heard_device_state(std::uint32_t device, std::string_view payload, SteadyTime now) {
    heard({Item::device_state, device, {}}, payload, now);
  }
  void heard_device_meta(std::uint32_t device, std::string_view payload, SteadyTime now) {
    heard({Item::device_meta, device, {}}, payload, now);
  }

  /// The config is that of the change from now on. Of what ends in it nothing more is published;
  /// what begins in it has its meta published, where there is a connection, and its state once the
  /// field has told it. `gone`: names of devices that are no more, whose topics are cleared.
  void change(const ConfigChange& change, const std::vector<std::string>& gone, bool is_connected);

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
  enum class Item : std::uint8_t {
    agent_state,
    device_state,
    device_meta,
    health,
    config_report,
    clear
  };
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

  /// What was handed over last on a topic.
  struct Published {
    std::size_t hash = 0;  ///< of the payload
    SteadyTime at{};
    bool came_back = false;  ///< the broker has sent it to us, too
  };

  void forget(std::uint32_t device);
  bool is_of(const Key& key, const std::string& topic) const {
    return key.item == Item::clear && key.topic == topic;
  }
  Publication publication_of(const Key& key, SteadyTime now);
  void heard(const Key& key, std::string_view payload, SteadyTime now);

  const Config& config_;
  Payload& payload_;
  Outgoing& outgoing_;
  JitteredBackoff& backoff_;
  const Source source_;
  std::vector<std::shared_ptr<const DeviceStatus>> states_;  ///< by device; others read on
  std::map<Key, Due> due_;
  std::map<std::uint64_t, Flight> flights_;  ///< by the id of the publication
  std::map<Key, Published> published_;       ///< in this connection
  std::map<Key, SteadyTime> repairs_;        ///< when each is due
  std::set<Key> logged_;                     ///< that were overwritten; once in a connection
};

}  // namespace fxagent
