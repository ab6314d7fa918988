// The profile `json` on another broker: the topics and payloads of docs/interface.md, and the
// commands if that broker may send them.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "agent/uplink/payload/json_payload.h"
#include "agent/uplink/profile/profile.h"
#include "agent/uplink/retained/device_states.h"
#include "agent/uplink/retained/retained_state.h"

namespace fxagent {

class JsonProfile final : public Profile {
 public:
  /// `config` outlives it. `since_ms` is the start of the agent.
  JsonProfile(const Config& config, const ProfileConfig& profile, std::string boot,
              std::string version, std::int64_t since_ms, RelayCommand relay);

  void begin(Outgoing& outgoing, JitteredBackoff& backoff) override;
  Publication last_will() override { return payload_.last_will(); }
  std::vector<Subscription> subscriptions() const override;
  void connection_began(const Connected&) override;
  void connection_ended() override;
  SteadyTime next_wake() const override { return wake_; }
  void subscribed(const Subscribed& event) override;
  bool is_ready() const override { return !awaits_suback_; }
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
  const Config& config_;
  JsonPayload payload_;
  const std::int64_t since_ms_;
  const std::string name_;
  const std::string broker_;
  const RelayCommand relay_;
  DeviceStates states_;
  std::optional<std::string> not_heard_why_;  ///< reason why no commands are received
  bool awaits_suback_ = false;             ///< subscribed() has not been called in this connection
  std::optional<RetainedState> retained_;  ///< from begin() on
  SteadyTime wake_ = SteadyTime::max();    ///< after due()
  std::vector<Publication> results_;
};

}  // namespace fxagent
