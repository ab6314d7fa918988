// Samples that wait for the broker, as rows in memory, bounded in bytes. The oldest leave first, to
// the broker or for lack of room. Uplink thread.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "agent/store/samples/history.h"

namespace fxagent {

class Backlog final {
 public:
  /// Holds at most `max_bytes`, with SampleRow::kOverhead counted for each row.
  explicit Backlog(std::size_t max_bytes) : max_bytes_(max_bytes) {}

  /// Adds a row in the order of `row_id`, and drops the oldest rows until all fit.
  void append(SampleRow row);

  /// Returns the next history message, or nullopt if there is nothing to send. Picks the stream
  /// with the oldest waiting row among those that `may_send`, and takes as many of its rows as fit,
  /// at least one. `message` must be empty. A stream has one batch on its way at a time, so its
  /// rows arrive in order. The rows stay here until remove().
  std::optional<HistoryBatch> next(HistoryMessage& message, const MaySend& may_send);
  /// Call when the batch arrived, or when the broker will never accept it. Returns how many of its
  /// rows were still here; rows that had to make room were counted as dropped already.
  std::uint64_t remove(const HistoryBatch& batch);
  /// Call when the batch did not arrive. Its rows wait again, in their old places.
  void returned(const HistoryBatch& batch);
  /// Removes and returns every row that is not on its way, oldest first.
  std::vector<SampleRow> take_waiting();

  std::uint64_t rows() const { return rows_.size(); }
  std::size_t bytes() const { return bytes_; }
  std::size_t max_bytes() const { return max_bytes_; }
  /// True if a row of this device waits to be sent.
  bool has_waiting(const std::string& device) const;
  bool is_on_the_way(const StreamKey& stream) const;
  /// Rows dropped since the last call, by device: for lack of room, or damaged.
  std::map<std::string, std::uint64_t> take_dropped() { return std::exchange(dropped_, {}); }

 private:
  struct Stream {
    std::set<std::uint64_t> waiting;
    bool on_the_way = false;
    std::optional<std::uint64_t> ready_as;  ///< its key in ready_
  };
  using Streams = std::map<StreamKey, Stream>;

  /// next() of one waiting stream. Returns nullopt if all its rows were damaged; they are dropped.
  std::optional<HistoryBatch> next_of(Streams::value_type& stream, HistoryMessage& message);
  /// Updates the place of a changed stream in ready_.
  void place(Streams::value_type& stream);
  void erase(std::map<std::uint64_t, SampleRow>::iterator row);

  const std::size_t max_bytes_;
  std::size_t bytes_ = 0;
  std::map<std::uint64_t, SampleRow> rows_;  ///< by row id, oldest first
  Streams streams_;
  /// Streams that could send, by their oldest waiting row. There may be thousands of streams, too
  /// many for next() to search.
  std::map<std::uint64_t, Streams::value_type*> ready_;
  std::map<std::string, std::uint64_t> dropped_;
};

}  // namespace fxagent
