// Counts the samples of each stream in the store's file. Tracks which are out (held for a live
// message, or on their way as history), and picks the stream to send next. Kept in memory; the rows
// are in the file. The store's thread.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <unordered_map>

#include "agent/store/samples/history.h"

namespace fxagent {

class SampleStreams final {
 public:
  /// A row of the file.
  struct Row {
    std::uint64_t row_id = 0;
    StreamKey stream;
    std::uint64_t cost = 0;
  };

  /// Adds rows that the file already has; `oldest` is the lowest of their ids.
  void found(const StreamKey& stream, std::uint64_t rows, std::uint64_t cost, std::uint64_t oldest);
  /// Adds a new row, the newest of its stream.
  void added(const Row& row);
  /// Marks the row as out: no other message may take it until release() or remove().
  void take(const Row& row);
  /// Lets a row that is out wait again.
  void release(std::uint64_t row_id);
  /// Removes a row that is out. Returns false if it is not out.
  bool remove(std::uint64_t row_id);
  /// Removes the oldest row of its stream, out or not.
  void remove_oldest(const Row& row);
  /// Records that a history message of the stream, at most one, is on its way, or no longer is.
  void set_on_the_way(const StreamKey& stream, bool is_on_the_way);
  /// Forgets all rows. Returns their number by device.
  std::map<std::string, std::uint64_t> clear();

  /// Returns the stream with the oldest row, among streams that have waiting rows, no message on
  /// its way, and `may_send`.
  std::optional<StreamKey> oldest_waiting(const MaySend& may_send) const;
  bool is_out(std::uint64_t row_id) const { return out_.contains(row_id); }
  bool has_waiting(const std::string& device) const;
  bool has_waiting(const StreamKey& stream) const;
  bool is_on_the_way(const StreamKey& stream) const;
  std::uint64_t rows() const { return rows_; }
  std::uint64_t bytes() const { return bytes_; }

 private:
  struct Stream {
    std::uint64_t rows = 0;  ///< in the file
    std::uint64_t out = 0;   ///< of these, held or on their way
    bool on_the_way = false;
    std::uint64_t oldest = 0;  ///< no row has a lower id
    bool has_waiting() const { return rows > out; }
  };

  std::map<StreamKey, Stream> streams_;
  std::unordered_map<std::uint64_t, Row> out_;  ///< by row id
  std::uint64_t rows_ = 0;
  std::uint64_t bytes_ = 0;
};

}  // namespace fxagent
