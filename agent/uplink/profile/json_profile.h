// The profile `json` on another broker: the topics and payloads of docs/interface.md, and the
// commands if that broker may send them.
#pragma once

#include <deque>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "agent/uplink/payload/json_payload.h"
#include "agent/uplink/profile/profile.h"
#include "agent/uplink/retained/device_states.h"

namespace fxagent {

class JsonProfile final : public Profile {
 public:
  /// `config` outlives it. `since_ms` is the start of the agent. `broker` is the name of the
  /// broker, for the audit. `relay` is empty if the broker may not send commands.
  JsonProfile(const Config& config, std::string boot, std::string version, std::int64_t since_ms,
              std::string broker, RelayCommand relay);

  Publication last_will() override { return payload_.last_will(); }
  std::vector<Subscription> subscriptions() const override;
  void connection_began(const Connected& connected) override;
  void connection_ended() override;
  void refused() override { is_refused_ = true; }
  SteadyTime next_wake() const override { return again_at_.value_or(SteadyTime::max()); }
  void hear(const Message& message) override;
  void device_state(const DeviceStatus& status) override;
  void change(const ConfigChange& change) override;
  std::vector<Publication> due(SteadyTime now, std::int64_t utc_ms) override;
  std::vector<Publication> take_results() override { return std::exchange(results_, {}); }
  std::vector<Publication> farewell(std::int64_t utc_ms) override {
    return {payload_.agent_offline(utc_ms)};
  }

  std::vector<Publication> sample(const StreamKey& stream, const SampleRecord& sample) override {
    return payload_.sample(stream, sample);
  }
  std::shared_ptr<SampleHistory> begin_history(std::size_t max_bytes) override {
    return payload_.begin_history(max_bytes);
  }

 private:
  void everything_is_due();

  const Config& config_;
  JsonPayload payload_;
  const std::int64_t since_ms_;
  const std::string broker_;
  const RelayCommand relay_;
  DeviceStates states_;
  bool greets_ = false;  ///< the agent's state is due
  bool is_connected_ = false;
  bool is_refused_ = false;
  std::optional<SteadyTime> again_at_;  ///< all states are due again
  std::set<std::uint32_t> metas_;       ///< devices whose meta is due
  std::set<std::uint32_t> changed_;     ///< devices whose state is due
  std::deque<Publication> cleared_;     ///< topics to clear
  std::vector<Publication> results_;
};

}  // namespace fxagent
