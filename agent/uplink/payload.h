// The port to a payload format: topic and bytes of what is published about the plant. agent.cpp
// chooses one. JsonPayload is the format of agent/CONTRACT.md.
//
// JSON in every format, and not made here: the results of commands and health. The command topics
// are the same in every format too, and the publisher clears retained topics of devices that are
// gone only where JsonPayload puts them.
//
// What is acknowledged: a sample is let go, in memory and on disk, when its publication was
// Delivered (broker.h). With QoS 1 the broker has it then; whether anybody reads it no format
// learns. A format that prescribes QoS 0 says so in its publications: Delivered means handed to the
// socket then, and what is under way when a connection ends may be lost. States and meta are
// published again until they were Delivered, and all of them anew after each connect.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "agent/messages.h"
#include "agent/store/history.h"
#include "agent/store/sample_record.h"
#include "agent/uplink/broker.h"

namespace fxagent {

/// Uplink thread only, but for the constructor. Not const: a format may count its messages, or
/// remember the last values for a birth.
class Payload {
 public:
  virtual ~Payload() = default;

  /// What the broker is to publish when the connection ends without a goodbye. Asked for before
  /// each attempt to connect.
  virtual Will last_will() = 0;
  /// Before the other states of a connection, and again when one of the last two changes.
  /// `not_heard_why`: why no command is heard, where that is so. `conflict`: the boot of another
  /// agent with our id, where there is one. `since_ms`: the start of the agent.
  virtual Publication agent_online(std::int64_t since_ms,
                                   const std::optional<std::string>& not_heard_why,
                                   const std::optional<std::string>& conflict) = 0;
  /// The last message before a clean end, at `since_ms`.
  virtual Publication agent_offline(std::int64_t since_ms) = 0;
  virtual Publication device_state(const DeviceStatus& status) = 0;
  /// What the tags of a device are; in other words its birth. `device`: index in Config::devices.
  virtual Publication device_meta(std::uint32_t device) = 0;

  /// A sample that was just read.
  virtual Publication sample(const StreamKey& stream, const SampleRecord& sample) = 0;
  /// An empty history message of at most `max_bytes`; HistoryBatch::payload is what it becomes.
  virtual std::unique_ptr<HistoryMessage> begin_history(std::size_t max_bytes) = 0;
  virtual Publication history(const HistoryBatch& batch) = 0;
};

}  // namespace fxagent
