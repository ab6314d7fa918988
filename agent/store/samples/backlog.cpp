#include "agent/store/samples/backlog.h"

#include <algorithm>

namespace fxagent {

void Backlog::append(SampleRow row) {
  bytes_ += row.cost();
  auto& stream = *streams_.try_emplace(row.stream).first;
  stream.second.waiting.insert(row.row_id);
  place(stream);
  rows_.emplace(row.row_id, std::move(row));
  while (bytes_ > max_bytes_ && !rows_.empty()) {
    ++dropped_[rows_.begin()->second.stream.device];
    erase(rows_.begin());
  }
}

std::optional<HistoryBatch> Backlog::next(HistoryMessage& message, const MaySend& may_send) {
  for (;;) {
    const auto ready = std::find_if(ready_.begin(), ready_.end(), [&](const auto& oldest) {
      return may_send(oldest.second->first);
    });
    if (ready == ready_.end()) return std::nullopt;
    // If all its rows were damaged and dropped, try the next stream.
    if (auto batch = next_of(*ready->second, message)) return batch;
  }
}

std::optional<HistoryBatch> Backlog::next_of(Streams::value_type& stream, HistoryMessage& message) {
  BatchBuilder builder(message);
  std::vector<std::uint64_t> damaged;
  for (const std::uint64_t row_id : stream.second.waiting) {
    const SampleRow& row = rows_.at(row_id);
    const auto added = builder.add(row_id, row.content);
    if (added == BatchBuilder::Added::no_room) break;
    if (added == BatchBuilder::Added::damaged) damaged.push_back(row_id);
  }
  for (const std::uint64_t row_id : damaged) {
    ++dropped_[stream.first.device];
    erase(rows_.find(row_id));
  }
  if (builder.empty()) return std::nullopt;
  HistoryBatch batch = builder.take(stream.first);
  for (const std::uint64_t row_id : batch.row_ids) stream.second.waiting.erase(row_id);
  stream.second.on_the_way = true;
  place(stream);
  return batch;
}

void Backlog::returned(const HistoryBatch& batch) {
  auto& stream = *streams_.try_emplace(batch.stream).first;
  stream.second.on_the_way = false;
  for (const std::uint64_t row_id : batch.row_ids)
    if (rows_.contains(row_id)) stream.second.waiting.insert(row_id);
  place(stream);
}

std::vector<SampleRow> Backlog::take_waiting() {
  std::vector<SampleRow> taken;
  for (auto next = rows_.begin(); next != rows_.end();) {
    const auto row = next++;
    if (!streams_.at(row->second.stream).waiting.contains(row->first)) continue;
    taken.push_back(row->second);
    erase(row);
  }
  return taken;
}

bool Backlog::has_waiting(const std::string& device) const {
  for (auto stream = streams_.lower_bound({device, {}});
       stream != streams_.end() && stream->first.device == device; ++stream)
    if (!stream->second.waiting.empty()) return true;
  return false;
}

bool Backlog::is_on_the_way(const StreamKey& stream) const {
  const auto found = streams_.find(stream);
  return found != streams_.end() && found->second.on_the_way;
}

std::uint64_t Backlog::remove(const HistoryBatch& batch) {
  auto& stream = *streams_.try_emplace(batch.stream).first;
  stream.second.on_the_way = false;
  place(stream);
  std::uint64_t removed = 0;
  for (const std::uint64_t row_id : batch.row_ids) {
    const auto row = rows_.find(row_id);
    if (row == rows_.end()) continue;
    erase(row);
    ++removed;
  }
  return removed;
}

void Backlog::erase(std::map<std::uint64_t, SampleRow>::iterator row) {
  bytes_ -= row->second.cost();
  auto& stream = *streams_.try_emplace(row->second.stream).first;
  stream.second.waiting.erase(row->first);
  place(stream);
  rows_.erase(row);
}

void Backlog::place(Streams::value_type& stream) {
  auto& [waiting, on_the_way, ready_as] = stream.second;
  std::optional<std::uint64_t> ready;
  if (!on_the_way && !waiting.empty()) ready = *waiting.begin();
  if (ready == ready_as) return;
  if (ready_as) ready_.erase(*ready_as);
  if (ready) ready_.emplace(*ready, &stream);
  ready_as = ready;
}

}  // namespace fxagent
