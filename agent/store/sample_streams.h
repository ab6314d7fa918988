// How many samples of each stream lie in the store's file, which of them are out (held for a live
// message, or on their way as history), and which stream is next. In memory, the rows themselves
// are in the file. The store's thread.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <unordered_map>

#include "agent/store/history.h"

namespace fxagent {

class SampleStreams final {
 public:
  /// A row of the file.
  struct Row {
    std::uint64_t row_id = 0;
    StreamKey stream;
    std::uint64_t cost = 0;
  };

  /// Rows that the file has from earlier; `oldest` is the lowest of their ids.
  void found(const StreamKey& stream, std::uint64_t rows, std::uint64_t cost, std::uint64_t oldest);
  /// A new row, and the last one.
  void added(const Row& row);
  /// The row goes out: nobody else may take it until release() or remove().
  void take(const Row& row);
  /// A row that is out waits again.
  void release(std::uint64_t row_id);
  /// A row that is out is no more. False: it was not there.
  bool remove(std::uint64_t row_id);
  /// The oldest row of its stream is no more, out or not.
  void remove_oldest(const Row& row);
  /// Whether a history message of the stream is on its way: then no other one may be.
  void set_on_the_way(const StreamKey& stream, bool is_on_the_way);
  /// Forgets all rows. Returns how many there were of each device.
  std::map<std::string, std::uint64_t> clear();

  /// Of those that could send and `may_send` the stream whose oldest row is the oldest.
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
    std::uint64_t out = 0;   ///< of these, held or on the way
    bool on_the_way = false;
    std::uint64_t oldest = 0;  ///< no row of it has a lower id
    bool has_waiting() const { return rows > out; }
  };
  struct Out {
    StreamKey stream;
    std::uint64_t cost = 0;
  };

  std::map<StreamKey, Stream> streams_;
  std::unordered_map<std::uint64_t, Out> out_;
  std::uint64_t rows_ = 0;
  std::uint64_t bytes_ = 0;
};

}  // namespace fxagent
