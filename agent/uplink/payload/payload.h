// Interface to a payload format: topic and bytes of what is published about the plant. agent.cpp
// chooses the format. JsonPayload is the format of docs/interface.md.
//
// Results of commands and health are JSON in every format and are not made here. The command topics
// are the same in every format too. The publisher clears retained topics of removed devices only
// where JsonPayload puts them.
//
// Acknowledgement: a sample is released, in memory and on disk, when its publication is Delivered
// (broker.h). With QoS 1 the broker has it then; no format learns if a client reads it. A format
// that prescribes QoS 0 sets it in its publications: Delivered then means handed to the socket, and
// samples in flight when a connection ends may be lost. States and meta are published until they
// are Delivered, and again after each connect.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "agent/store/samples/history.h"
#include "agent/store/samples/sample_record.h"
#include "agent/telemetry.h"
#include "agent/uplink/broker.h"

namespace fxagent {

/// Uplink thread only, except for the constructor. Not const: a format may count its messages, or
/// remember the last values for a birth.
class Payload {
 public:
  virtual ~Payload() = default;

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

  /// A sample just read.
  virtual Publication sample(const StreamKey& stream, const SampleRecord& sample) = 0;
  /// Returns an empty history message of at most `max_bytes`; it becomes HistoryBatch::payload.
  virtual std::unique_ptr<HistoryMessage> begin_history(std::size_t max_bytes) = 0;
  virtual Publication history(const HistoryBatch& batch) = 0;
};

}  // namespace fxagent
