#include "agent/store/samples/sample_streams.h"

#include <algorithm>

namespace fxagent {

void SampleStreams::found(const StreamKey& key, std::uint64_t rows, std::uint64_t cost,
                          std::uint64_t oldest) {
  Stream& stream = streams_[key];
  stream.rows = rows;
  stream.oldest = oldest;
  rows_ += rows;
  bytes_ += cost;
}

void SampleStreams::added(const Row& row) {
  Stream& stream = streams_[row.stream];
  if (stream.rows == 0) stream.oldest = row.row_id;
  ++stream.rows;
  ++rows_;
  bytes_ += row.cost;
}

void SampleStreams::take(const Row& row) {
  ++streams_[row.stream].out;
  out_[row.row_id] = row;
}

void SampleStreams::release(std::uint64_t row_id) {
  const auto found = out_.extract(row_id);
  if (!found.empty()) --streams_[found.mapped().stream].out;
}

bool SampleStreams::remove(std::uint64_t row_id) {
  const auto found = out_.extract(row_id);
  if (found.empty()) return false;
  Stream& stream = streams_[found.mapped().stream];
  --stream.out;
  --stream.rows;
  stream.oldest = std::max(stream.oldest, stream.out == 0 ? row_id + 1 : stream.oldest);
  --rows_;
  bytes_ -= found.mapped().cost;
  return true;
}

void SampleStreams::remove_oldest(const Row& row) {
  Stream& stream = streams_[row.stream];
  if (out_.erase(row.row_id) > 0) --stream.out;
  --stream.rows;
  stream.oldest = row.row_id + 1;
  --rows_;
  bytes_ -= row.cost;
}

void SampleStreams::set_on_the_way(const StreamKey& stream, bool is_on_the_way) {
  streams_[stream].on_the_way = is_on_the_way;
}

std::map<std::string, std::uint64_t> SampleStreams::clear() {
  std::map<std::string, std::uint64_t> gone;
  for (const auto& [key, stream] : streams_)
    if (stream.rows > 0) gone[key.device] += stream.rows;
  streams_.clear();
  out_.clear();
  rows_ = 0;
  bytes_ = 0;
  return gone;
}

std::optional<StreamKey> SampleStreams::oldest_waiting(const MaySend& may_send) const {
  auto oldest = streams_.end();
  for (auto stream = streams_.begin(); stream != streams_.end(); ++stream) {
    if (stream->second.on_the_way || !stream->second.has_waiting() || !may_send(stream->first))
      continue;
    if (oldest == streams_.end() || stream->second.oldest < oldest->second.oldest) oldest = stream;
  }
  if (oldest == streams_.end()) return std::nullopt;
  return oldest->first;
}

bool SampleStreams::has_waiting(const std::string& device) const {
  for (auto stream = streams_.lower_bound({device, {}});
       stream != streams_.end() && stream->first.device == device; ++stream)
    if (stream->second.has_waiting()) return true;
  return false;
}

bool SampleStreams::has_waiting(const StreamKey& stream) const {
  const auto found = streams_.find(stream);
  return found != streams_.end() && found->second.has_waiting();
}

bool SampleStreams::is_on_the_way(const StreamKey& stream) const {
  const auto found = streams_.find(stream);
  return found != streams_.end() && found->second.on_the_way;
}

}  // namespace fxagent
