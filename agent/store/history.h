// Samples as rows on their way to a history topic: what the backlog in memory and the store on disk
// have in common. Plain data, and the port to the payload that a history message is made with.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "agent/store/sample_record.h"

namespace fxagent {

/// How the content of a row is to be read. The numbers stand in the file.
enum class RowFormat : std::uint8_t {
  json_text = 0,  ///< as it is published; of files up to version 4 of the schema
  cbor = 1        ///< encode_sample()
};
/// Nothing where the file says what no program has written.
std::optional<RowFormat> row_format(std::int64_t number);

/// One sample as it waits.
struct SampleRow {
  std::uint64_t row_id = 0;  ///< unique where it is kept; a later sample has the higher number
  std::string device;
  std::string group;
  std::uint64_t seq = 0;
  std::string content;
  RowFormat format = RowFormat::cbor;

  /// What a row costs where it is kept, beside its content.
  static constexpr std::size_t kOverhead = 160;
  std::size_t cost() const { return content.size() + kOverhead; }
};

/// Rows of one group of one device that go out in one message.
struct HistoryBatch {
  std::string device;
  std::string group;
  std::vector<std::uint64_t> row_ids;
  std::string payload;
};

/// A history message that is being made. The payload format is behind it.
class HistoryMessage {
 public:
  virtual ~HistoryMessage() = default;

  /// False: it does not fit any more, and was not taken. The first row always fits.
  virtual bool add(const SampleRecord& sample) = 0;
  /// The same for a row of RowFormat::json_text, which is_intact(). A format that is not JSON has
  /// to read it, since files of earlier versions may hold some.
  virtual bool add(std::string_view json_row) = 0;
  /// The bytes; the message is over.
  virtual std::string take() = 0;
};

/// Whether a row is JSON still: what a worn-out disk gives back may not be.
bool is_intact(std::string_view json_row);

/// Device and group: the rows of one stream go out oldest first, one message at a time.
using StreamKey = std::pair<std::string, std::string>;
/// Whether a message of this stream may go out now.
using MaySend = std::function<bool(const StreamKey& stream)>;

/// Gathers rows of one stream until the next one would make the message too large.
class BatchBuilder final {
 public:
  /// `message` outlives it.
  explicit BatchBuilder(HistoryMessage& message) : message_(message) {}

  enum class Added : std::uint8_t { yes, no_room, damaged };
  Added add(std::uint64_t row_id, std::optional<RowFormat> format, std::string_view content);
  bool empty() const { return row_ids_.empty(); }
  HistoryBatch take(const StreamKey& stream);

 private:
  HistoryMessage& message_;
  std::vector<std::uint64_t> row_ids_;
  SampleRecord record_;  ///< the row that is being added
};

}  // namespace fxagent
