// The profile `sparkplug`: a Sparkplug B 3.0 edge node. Each device of the config is a Sparkplug
// device, each tag a metric of the same name.
//
// Everything is published with QoS 0, as the specification demands; the outlet's markers prove the
// delivery. A sample has only the metrics that changed since the last message of the session.
// Samples that were not delivered, and those of a device that was not born yet, follow as
// historical metrics. docs/sparkplug-rules.md has the rules of the specification and their tests.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "agent/uplink/sparkplug/edge_node.h"

namespace fxagent {

namespace sparkplug {
class Metric;
class Packet;
}  // namespace sparkplug

class SparkplugProfile final : public sparkplug::EdgeNode {
 public:
  /// `config` outlives it. With an empty `relay`, rebirths may be asked for all the same. `new_id`
  /// returns an id for a command, each time another one; `utc_ms` the current calendar time.
  SparkplugProfile(const Config& config, const ProfileConfig& profile, RelayCommand relay,
                   std::function<std::string()> new_id, std::function<std::int64_t()> utc_ms);

  std::vector<Subscription> subscriptions() const override;
  void hear(const Message& message) override;
  void change(const ConfigChange& change) override;
  bool wants_will_at_disconnect() const override { return true; }

  std::vector<Publication> sample(const StreamKey& stream, const SampleRecord& sample) override;
  void saw(const Telemetry& sample, SteadyTime now) override;
  /// A message that was refused is missing in the order of `seq`.
  void undelivered(const std::string&) override { request_rebirth(); }
  std::shared_ptr<SampleHistory> begin_history(std::size_t max_bytes) override;

 private:
  class History;

  /// The last value of a tag that the field has reported.
  struct Last {
    Value value;
    std::optional<BadReason> bad;
    std::int64_t ts_ms = 0;  ///< when it was read; 0: never
    // As the last message of the session had it.
    std::size_t sent = 0;  ///< hash of the value
    std::optional<BadReason> sent_bad;
  };
  struct Device {
    std::int64_t born_ms = 0;  ///< newest value of its birth
    std::uint64_t first_alias = 0;
    std::vector<Last> last;  ///< by tag
  };

  std::vector<Publication> data(const std::string& device, sparkplug::Packet packet);
  std::uint64_t next_seq();
  Publication node_birth(SteadyTime now, std::int64_t utc_ms) override;
  std::optional<Publication> device_birth(std::uint32_t index, std::int64_t utc_ms) override;
  Publication device_death(const std::string& name, std::int64_t utc_ms) override;
  Publication node_death(std::int64_t utc_ms) const override;
  sparkplug::Packet session_packet(std::int64_t utc_ms) const;
  void prepare(std::uint32_t index);

  void hear_node_command(const Message& message);
  void hear_device_command(const Message& message, const std::string& device);
  void relay_write(const Message& message, std::uint32_t device, std::size_t tag,
                   const sparkplug::Metric& metric);

  const std::function<std::string()> new_id_;
  std::vector<Device> devices_;  ///< as Config::devices
  std::uint64_t next_alias_ = 1;
  std::uint64_t seq_ = 0;  ///< of the next message
};

}  // namespace fxagent
