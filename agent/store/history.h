// Samples as rows of JSON on their way to a history topic: what the backlog in memory and the store
// on disk have in common. Plain data.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace fxagent {

/// One sample as it is published, live or in a history message.
struct SampleRow {
  std::uint64_t row_id = 0;  ///< unique where it is kept; a later sample has the higher number
  std::string device;
  std::string group;
  std::uint64_t seq = 0;
  std::string json;

  /// What a row costs where it is kept, beside its text.
  static constexpr std::size_t kOverhead = 160;
  std::size_t cost() const { return json.size() + kOverhead; }
};

/// Rows of one group of one device that go out in one message.
struct HistoryBatch {
  std::string device;
  std::string group;
  std::vector<std::uint64_t> row_ids;
  std::string payload;
};

/// Whether a row is JSON still: what a worn-out disk gives back may not be.
bool is_intact(std::string_view row);
/// {"history":true,"rows":[…]} of rows as they were published.
std::string history_text(std::span<const std::string_view> rows);
/// What history_text() adds to its rows and the commas between them.
inline constexpr std::size_t kHistoryFrameBytes = 26;

/// Device and group: the rows of one stream go out oldest first, one message at a time.
using StreamKey = std::pair<std::string, std::string>;
/// Whether a message of this stream may go out now.
using MaySend = std::function<bool(const StreamKey& stream)>;

/// Gathers rows of one stream until the next one would make the message too large.
class BatchBuilder final {
 public:
  explicit BatchBuilder(std::size_t max_payload) : max_payload_(max_payload) {}

  /// False: it does not fit any more. The first row always does.
  bool add(std::uint64_t row_id, std::string_view row);
  bool empty() const { return row_ids_.empty(); }
  HistoryBatch take(const StreamKey& stream);

 private:
  const std::size_t max_payload_;
  std::size_t size_ = 0;
  std::vector<std::uint64_t> row_ids_;
  std::vector<std::string> rows_;
};

}  // namespace fxagent
