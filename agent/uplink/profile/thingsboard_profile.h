// The profile `thingsboard`: the agent as a ThingsBoard gateway. Each device of the config is a
// device of ThingsBoard; RPC requests are commands. Section 12 of docs/interface.md has the topics.
// Source: ThingsBoard, MQTT Gateway API reference. All topics are below v1/gateway. ThingsBoard
// closes the session of a gateway whose message it cannot read, so no value is ever null. When
// the connection of a gateway ends, ThingsBoard disconnects the devices: there is no last will.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <unordered_map>
#include <vector>

#include "agent/config/model.h"
#include "agent/handover/telemetry.h"
#include "agent/uplink/profile/profile.h"
#include "agent/uplink/retained/device_states.h"

namespace fxagent {

class ThingsBoardProfile final : public Profile {
 public:
  /// Last published reason of each tag; nullopt: it was good.
  using Reasons = std::map<std::string, std::optional<BadReason>, std::less<>>;

  /// `config` outlives it. `new_id` returns an id for a command, each time another one.
  ThingsBoardProfile(const Config& config, const ProfileConfig& profile, RelayCommand relay,
                     std::function<std::string()> new_id);

  std::vector<Subscription> subscriptions() const override;
  void connection_began(const Connected& connected) override;
  void connection_ended() override;
  void hear(const Message& message) override;
  void device_state(const DeviceStatus& status) override;
  void change(const ConfigChange& change) override;
  std::vector<Publication> due(SteadyTime now, std::int64_t utc_ms) override;

  bool may_send(const std::string& device) const override;
  std::vector<Publication> sample(const StreamKey& stream, const SampleRecord& sample) override;
  void undelivered(const std::string& device) override { reasons_.erase(device); }
  std::shared_ptr<SampleHistory> begin_history(std::size_t max_bytes) override;

 private:
  class History;
  struct Device {
    std::string name;           ///< empty: a vacant place
    bool is_alive = false;      ///< online or degraded
    bool is_connected = false;  ///< to ThingsBoard, in this session
    bool is_described = false;  ///< its units have been published in this session
  };

  void prepare(std::uint32_t index);
  std::vector<Publication> announce(std::uint32_t index);

  const Config& config_;
  const std::string name_;
  const std::chrono::milliseconds deadline_;
  const RelayCommand relay_;
  const std::function<std::string()> new_id_;
  DeviceStates states_;
  std::vector<Device> devices_;  ///< as in the config
  std::unordered_map<std::string, std::uint32_t> index_;
  std::set<std::uint32_t> changed_;  ///< devices whose state is due
  std::vector<std::string> gone_;    ///< devices to disconnect: the config has them no more
  std::deque<Publication> answers_;
  /// Number of the session. An answer is valid only in that of its request.
  std::uint64_t session_ = 0;
  std::unordered_map<std::string, Reasons> reasons_;  ///< by device, of this session
};

}  // namespace fxagent
