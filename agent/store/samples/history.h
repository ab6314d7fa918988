// Samples as rows on their way to a history topic, shared by the backlog in memory and the store on
// disk. Plain data, and the port to the payload format of a history message.
#pragma once

#include <compare>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "agent/store/samples/sample_record.h"

namespace fxagent {

/// The rows of one stream leave oldest first, one message at a time.
struct StreamKey {
  std::string device;
  std::string group;
  auto operator<=>(const StreamKey&) const = default;
};
/// True if a message of this stream may leave now.
using MaySend = std::function<bool(const StreamKey& stream)>;

/// One waiting sample.
struct SampleRow {
  std::uint64_t row_id = 0;  ///< unique in its backlog or file; rises with time
  StreamKey stream;
  std::uint64_t seq = 0;
  std::string content;  ///< of encode_sample(); a damaged disk may return something else

  /// Bytes that a row costs besides its content.
  static constexpr std::size_t kOverhead = 160;
  std::size_t cost() const { return content.size() + kOverhead; }
};

/// Rows of one stream that leave in one message.
struct HistoryBatch {
  StreamKey stream;
  std::vector<std::uint64_t> row_ids;
};

/// A history message under construction. Hides the payload format.
class HistoryMessage {
 public:
  virtual ~HistoryMessage() = default;

  /// Adds a sample. Returns false, and adds nothing, if it does not fit. The first row always fits.
  virtual bool add(const SampleRecord& sample) = 0;
};

/// Gathers rows of one stream until the next one would make the message too large.
class BatchBuilder final {
 public:
  /// `message` outlives it.
  explicit BatchBuilder(HistoryMessage& message) : message_(message) {}

  enum class Added : std::uint8_t { yes, no_room, damaged };
  Added add(std::uint64_t row_id, std::string_view content) {
    if (!decode_sample(content, record_)) return Added::damaged;
    if (!message_.add(record_)) return Added::no_room;
    row_ids_.push_back(row_id);
    return Added::yes;
  }
  bool empty() const { return row_ids_.empty(); }
  HistoryBatch take(const StreamKey& stream) { return {stream, std::move(row_ids_)}; }

 private:
  HistoryMessage& message_;
  std::vector<std::uint64_t> row_ids_;
  SampleRecord record_;  ///< the row being added
};

}  // namespace fxagent
