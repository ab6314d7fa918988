// Interface to a payload format: topic and bytes of samples. Implementations: JsonPayload, the
// format of docs/interface.md, and the profiles.
//
// Acknowledgement: a sample is released, in memory and on disk, when its publications are Delivered
// (broker.h). With QoS 1 the broker has it then; no format learns if a client reads it. A format
// that prescribes QoS 0 sets it in its publications: Delivered then means handed to the socket,
// unless its session sends markers (outgoing.h).
#pragma once

#include <cstddef>
#include <memory>
#include <string>
#include <vector>

#include "agent/store/samples/history.h"
#include "agent/store/samples/sample_record.h"
#include "agent/uplink/broker.h"

namespace fxagent {

/// A history message of one format.
class SampleHistory : public HistoryMessage {
 public:
  /// Returns the messages that together deliver the rows of the stream, and ends this one; none if
  /// the format cannot express them any more, as after a change of the config. They are dropped
  /// then, and counted. Uplink thread.
  virtual std::vector<Publication> take(const StreamKey& stream) = 0;
};

/// Topics and bytes of samples. Uplink thread only, except for the constructor. Not const: a format
/// may count its messages, or remember the last values for a birth.
class SamplePayload {
 public:
  virtual ~SamplePayload() = default;

  /// False: samples of the device wait for now, as history.
  virtual bool may_send(const std::string& /*device*/) const { return true; }
  /// Returns the messages that together deliver a sample just read; none if there is nothing new.
  virtual std::vector<Publication> sample(const StreamKey& stream, const SampleRecord& sample) = 0;
  /// Samples of the device were refused. They become history, or are dropped.
  virtual void undelivered(const std::string& /*device*/) {}
  /// Same for samples of its history.
  virtual void history_undelivered(const std::string& device) { undelivered(device); }
  /// Returns an empty history message of at most `max_bytes`. Call its take() only while this
  /// object exists. The store's thread may add rows to it even later.
  virtual std::shared_ptr<SampleHistory> begin_history(std::size_t max_bytes) = 0;
};

}  // namespace fxagent
