// JSON texts of all that is published except results: samples, states, meta and health. Also the
// payload format made of them, described in docs/interface.md. The functions are pure; any thread.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "agent/config/model.h"
#include "agent/handover/status.h"
#include "agent/handover/telemetry.h"
#include "agent/uplink/payload/payload.h"

namespace fxagent::json {

/// Returns one message of one group: the payload of …/data/{group}, and a row of its history.
std::string sample(const SampleRecord& sample);

/// Returns the value alone, as a sample has it; "null" if it is bad or JSON cannot represent it.
std::string bare_value(const RecordedReading& reading);

struct Meta {
  std::string hash;  ///< first 16 hex digits of the SHA-256 of the tags' text
  std::string text;
};
Meta device_meta(const DeviceConfig& device);

/// Returns the payload of …/health: all numbers and words of AgentStatus.
std::string health(const AgentStatus& status, const Config& config);

}  // namespace fxagent::json

namespace fxagent {

/// The format of docs/interface.md: topics below Config::base_topic(), everything as JSON, states
/// and meta retained.
class JsonPayload final : public SamplePayload {
 public:
  /// `config` outlives the object. Samples have the QoS of `broker`; empty: of `mqtt`.
  JsonPayload(const Config& config, std::string boot, std::string version, std::string broker = {});

  /// Returns the message that the broker publishes if the connection ends without a DISCONNECT. Its
  /// "since" is null, because it is written before the time is known. Called before each attempt to
  /// connect.
  Publication last_will() const;
  /// Published before the other states of a connection, and again when `not_heard_why` or
  /// `conflict` changes: the reason why commands are not received, if so, and the boot of another
  /// agent with our id, if any. `since_ms` is the start of the agent.
  Publication agent_online(std::int64_t since_ms, const std::optional<std::string>& not_heard_why,
                           const std::optional<std::string>& conflict) const;
  /// The last message before a clean shutdown, at `since_ms`.
  Publication agent_offline(std::int64_t since_ms) const;
  Publication device_state(const DeviceStatus& status) const;
  /// Describes the tags of a device: its birth. `device` is the index in Config::devices.
  Publication device_meta(std::uint32_t device) const;
  std::vector<Publication> sample(const StreamKey& stream, const SampleRecord& sample) override;
  std::shared_ptr<SampleHistory> begin_history(std::size_t max_bytes) override;

 private:
  class History;

  std::vector<Publication> data(std::string topic, std::string payload) const;
  std::string device_topic(std::uint32_t device) const;
  std::string data_topic(const StreamKey& stream) const;

  const Config& config_;
  const std::string base_;
  const std::string boot_;
  const std::string version_;
  const std::string broker_;
};

}  // namespace fxagent
