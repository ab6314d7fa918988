// The profile `sparkplug-commands`: typed commands with correlated answers, as a Sparkplug C edge
// node in a session of its own. The values stay with the profile `sparkplug`.
//
// Each writable tag is a command `Write/{tag}` of its device with the argument `value`; `Run` and
// `Stop` are commands where the config allows them. A request becomes one command of the agent; its
// correlation id, after the name of the host, becomes the id. The answer has the result.
// Source: Sparkplug specification proposal 615 (NRESP, DRESP, commands) and the draft of payload C
// (64-bit numbers of sessions and messages, times in ns, rebirth as a verb).
#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "agent/uplink/sparkplug/edge_node.h"
#include "agent/uplink/sparkplug/typed_value.h"

namespace fxagent {

namespace sparkplug_c {
class Metric;
class Packet;
}  // namespace sparkplug_c

class TypedCommandsProfile final : public sparkplug::EdgeNode {
 public:
  /// `config` outlives it. `utc_ms` returns the current calendar time.
  TypedCommandsProfile(const Config& config, const ProfileConfig& profile, RelayCommand relay,
                       std::function<std::int64_t()> utc_ms);

  std::vector<Subscription> subscriptions() const override;
  void hear(const Message& message) override;
  std::vector<Publication> due(SteadyTime now, std::int64_t utc_ms) override;
  SteadyTime next_wake() const override;
  bool wants_samples() const override { return false; }
  std::vector<Publication> sample(const StreamKey&, const SampleRecord&) override { return {}; }
  std::shared_ptr<SampleHistory> begin_history(std::size_t) override { return nullptr; }

 private:
  struct Request {
    std::string device;  ///< empty: the node
    std::string name;    ///< of the command
    std::string correlation_id;
    std::optional<sparkplug::Type> type;  ///< of the value that the command writes
  };

  Publication message(std::string_view verb, const std::string& device, sparkplug_c::Packet packet,
                      std::optional<std::uint64_t> seq = {}) const;
  Publication node_death(std::int64_t utc_ms) const override;
  Publication node_birth(SteadyTime now, std::int64_t utc_ms) override;
  std::optional<Publication> device_birth(std::uint32_t index, std::int64_t utc_ms) override;
  Publication device_death(const std::string& name, std::int64_t utc_ms) override;
  sparkplug_c::Packet node_packet(std::int64_t utc_ms) const;
  sparkplug_c::Packet device_packet(std::uint32_t index, std::int64_t utc_ms) const;
  std::vector<Publication> repeated_births(std::int64_t utc_ms);
  /// True if births may be repeated and answers sent.
  bool is_open() const;
  void carry_out(const Message& message, const std::string& device, const std::string& source,
                 const sparkplug_c::Metric& metric);
  /// Answers a request with the agent's result, which is JSON.
  void answer(const Request& request, const std::string& result);
  void reject(const Message& message, const Request& request, const std::string& why);

  std::uint64_t seq_ = 0;        ///< of the next message
  bool is_asked_ = false;        ///< a host has asked for the births again
  SteadyTime last_births_at_{};  ///< the last births, also repeated ones
  std::deque<Publication> answers_;
};

}  // namespace fxagent
