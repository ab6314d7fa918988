// Samples that wait for the broker, as rows, in memory and bounded in bytes. Oldest out first: to
// the broker, and over the edge when there is no room. Uplink thread.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "agent/store/history.h"

namespace fxagent {

class Backlog final {
 public:
  /// Holds at most `max_bytes`, what a row costs beside its content included.
  explicit Backlog(std::size_t max_bytes) : max_bytes_(max_bytes) {}

  /// Takes a row in, in its place by `row_id`, and lets the oldest rows go until all fit.
  void append(SampleRow row);

  /// The next history message: from the stream whose waiting row is the oldest among those that
  /// `may_send`, as many rows as fit into `message`, which is empty, at least one. A stream has one
  /// batch on the way at a time, so that its rows arrive in order. Its rows stay here until
  /// remove(). nullopt: nothing to send.
  std::optional<HistoryBatch> next(HistoryMessage& message, const MaySend& may_send);
  /// The batch arrived, or the broker will never take it. Returns how many of its rows were still
  /// here: a row that had to make room meanwhile was counted as dropped already.
  std::uint64_t remove(const HistoryBatch& batch);
  /// The batch did not arrive: its rows wait again, in their old places.
  void returned(const HistoryBatch& batch);
  /// Every row that is not on the way, oldest first; they are no longer here.
  std::vector<SampleRow> take_waiting();

  std::uint64_t rows() const { return rows_.size(); }
  std::size_t bytes() const { return bytes_; }
  std::size_t max_bytes() const { return max_bytes_; }
  /// Whether a row of this device waits to be sent.
  bool has_waiting(const std::string& device) const;
  bool is_on_the_way(const StreamKey& stream) const;
  /// Rows that had to make room since the last call, by device.
  std::map<std::string, std::uint64_t> take_dropped() { return std::exchange(dropped_, {}); }

 private:
  struct Stream {
    std::set<std::uint64_t> waiting;
    bool on_the_way = false;
    std::optional<std::uint64_t> ready_as;  ///< its key in ready_
  };
  using Streams = std::map<StreamKey, Stream>;

  /// next() of a stream that waits. nullopt: its rows were damaged, and are dropped.
  std::optional<HistoryBatch> next_of(Streams::value_type& stream, HistoryMessage& message);
  /// Puts a stream that has changed in its place in ready_.
  void place(Streams::value_type& stream);
  void erase(std::map<std::uint64_t, SampleRow>::iterator row);

  const std::size_t max_bytes_;
  std::size_t bytes_ = 0;
  std::map<std::uint64_t, SampleRow> rows_;  ///< by row id: the first is the oldest
  Streams streams_;
  /// Streams that could send, by their oldest waiting row: with thousands of streams next() must
  /// not look at each.
  std::map<std::uint64_t, Streams::value_type*> ready_;
  std::map<std::string, std::uint64_t> dropped_;
};

}  // namespace fxagent
