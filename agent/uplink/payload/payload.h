// Interface to a payload format: topic and bytes of what is published about the plant. agent.cpp
// chooses the formats. JsonPayload is the one of docs/interface.md.
//
// Acknowledgement: a sample is released, in memory and on disk, when its publications are Delivered
// (broker.h). With QoS 1 the broker has it then; no format learns if a client reads it. A format
// that prescribes QoS 0 sets it in its publications: Delivered then means handed to the socket,
// unless its session sends markers (outgoing.h).
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "agent/handover/telemetry.h"
#include "agent/store/samples/history.h"
#include "agent/store/samples/sample_record.h"
#include "agent/uplink/broker.h"

namespace fxagent {

/// Topics and bytes of samples. Uplink thread only, except for the constructor. Not const: a format
/// may count its messages, or remember the last values for a birth.
class SamplePayload {
 public:
  virtual ~SamplePayload() = default;

  /// False: samples of the device wait for now, as history.
  virtual bool may_send(const std::string& /*device*/) const { return true; }
  /// Returns the messages of a sample just read, which together deliver it; none if there is
  /// nothing to say.
  virtual std::vector<Publication> sample(const StreamKey& stream, const SampleRecord& sample) = 0;
  /// Samples of the device were refused. They become history, or are dropped.
  virtual void undelivered(const std::string& /*device*/) {}
  /// Returns an empty history message of at most `max_bytes`; it becomes HistoryBatch::payload.
  virtual std::unique_ptr<HistoryMessage> begin_history(std::size_t max_bytes) = 0;
  /// Returns the messages that together deliver the batch; none if the format cannot express it any
  /// more, as after a change of the config. It is dropped then, and counted.
  virtual std::vector<Publication> history(const HistoryBatch& batch) = 0;
};

/// The format of the agent's own session: samples, states and meta.
class Payload : public SamplePayload {
 public:
  /// Returns the message that the broker publishes if the connection ends without a DISCONNECT.
  /// Called before each attempt to connect.
  virtual Will last_will() = 0;
  /// Published before the other states of a connection, and again when `not_heard_why` or
  /// `conflict` changes. `since_ms` is the start of the agent. `not_heard_why` is the reason why
  /// commands are not received, if so. `conflict` is the boot of another agent with our id, if any.
  virtual Publication agent_online(std::int64_t since_ms,
                                   const std::optional<std::string>& not_heard_why,
                                   const std::optional<std::string>& conflict) = 0;
  /// The last message before a clean shutdown, at `since_ms`.
  virtual Publication agent_offline(std::int64_t since_ms) = 0;
  virtual Publication device_state(const DeviceStatus& status) = 0;
  /// Describes the tags of a device: its birth. `device` is the index in Config::devices.
  virtual Publication device_meta(std::uint32_t device) = 0;
};

}  // namespace fxagent
