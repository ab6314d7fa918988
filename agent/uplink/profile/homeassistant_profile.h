// The profile `homeassistant`: a retained device discovery message of Home Assistant for each
// device. Home Assistant then reads the values on the topics of docs/interface.md, and sends its
// commands to {base}/{device}/command. So the profile has neither samples nor commands of its own,
// and no last will: the availability of the devices is the state of the session with the values.
// Source: home-assistant.io/integrations/mqtt, "Device discovery payload".
#pragma once

#include <cstdint>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "agent/uplink/profile/profile.h"

namespace fxagent {

enum class HearsCommands : std::uint8_t { no, yes };

class HomeAssistantProfile final : public Profile {
 public:
  /// `config` outlives it. HearsCommands::no: no commands from this broker, every tag is read-only.
  HomeAssistantProfile(const Config& config, const ProfileConfig& profile, std::string version,
                       HearsCommands hears_commands);

  std::vector<Subscription> subscriptions() const override;
  void connection_began(const Connected& connected) override;
  void connection_ended() override { due_.clear(); }
  void hear(const Message& message) override;
  void device_state(const DeviceStatus& status) override;
  void change(const ConfigChange& change) override;
  std::vector<Publication> due(SteadyTime now, std::int64_t utc_ms) override;
  bool wants_samples() const override { return false; }
  std::vector<Publication> sample(const StreamKey&, const SampleRecord&) override { return {}; }
  std::shared_ptr<SampleHistory> begin_history(std::size_t) override { return nullptr; }

 private:
  /// Platform by component key.
  using Components = std::map<std::string, std::string>;

  void add(std::uint32_t device);
  std::string object_id(std::uint32_t device) const;
  std::string topic_of(const std::string& object_id) const;
  Publication discovery(std::uint32_t device, const Components& removed) const;

  const Config& config_;
  const std::string prefix_;
  const std::string version_;
  const bool writes_;
  const std::string own_ids_;                      ///< beginning of the object ids of this agent
  std::map<std::string, std::uint32_t> devices_;   ///< with components, by object id
  std::map<std::string, DeviceConfig> described_;  ///< as published, by object id
  std::map<std::uint32_t, std::string> models_;    ///< as the devices report them
  std::set<std::uint32_t> due_;                    ///< devices to publish
  /// Components that Home Assistant still has, and must remove first.
  std::map<std::uint32_t, Components> removed_;
  std::set<std::string> cleared_;  ///< topics to clear
};

}  // namespace fxagent
