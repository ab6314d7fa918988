// What the two profiles of Sparkplug have in common: topics, births, and the death of the node.
// Uplink thread.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include "agent/uplink/profile/profile.h"
#include "agent/uplink/sparkplug/birth_schedule.h"

namespace fxagent::sparkplug {

/// The part of a profile that is the same for both payloads.
class EdgeNode : public Profile {
 public:
  Will last_will() override;
  void connection_began(const Connected& connected) override {
    births_.connection_began(connected);
  }
  void connection_ended() override { births_.connection_ended(); }
  void device_state(const DeviceStatus& status) override { births_.device_state(status); }
  void change(const ConfigChange& change) override { births_.change(change); }
  std::vector<Publication> farewell(std::int64_t utc_ms) override;
  bool take_leave() override { return births_.take_leave(); }
  void refused() override { births_.request_rebirth(); }

 protected:
  /// `config` outlives it. `version` is the first level of its topics; `utc_ms` returns the current
  /// calendar time.
  EdgeNode(const Config& config, const ProfileConfig& profile, const std::string& version,
           PrimaryHost host, TakeOrder take_order, std::function<std::int64_t()> utc_ms);

  /// Returns the message of this type; `device` is empty for those of the node.
  Publication message(std::string_view type, const std::string& device, std::string payload) const;
  /// Returns the death of the node in this session, which is also its last will.
  virtual Publication node_death(std::int64_t utc_ms) const = 0;

  const Config& config_;
  const std::string name_;
  const std::string prefix_;  ///< "{version}/{group}/"
  const std::string node_;
  const TakeOrder take_order_;
  const std::function<std::int64_t()> utc_ms_;
  BirthSchedule births_;
};

}  // namespace fxagent::sparkplug
