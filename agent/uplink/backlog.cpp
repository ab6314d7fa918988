#include "agent/uplink/backlog.h"

namespace fxagent {

void Backlog::append(SampleRow row) {
  bytes_ += row.cost();
  lanes_[{row.device, row.group}].waiting.insert(row.order);
  rows_.emplace(row.order, std::move(row));
  while (bytes_ > max_bytes_ && !rows_.empty()) {
    ++dropped_[rows_.begin()->second.device];
    erase(rows_.begin());
  }
}

std::optional<HistoryBatch> Backlog::next(std::size_t max_payload, const MaySend& may_send) {
  auto oldest = lanes_.end();
  for (auto lane = lanes_.begin(); lane != lanes_.end(); ++lane) {
    if (lane->second.on_the_way || lane->second.waiting.empty() || !may_send(lane->first)) continue;
    if (oldest == lanes_.end() || *lane->second.waiting.begin() < *oldest->second.waiting.begin())
      oldest = lane;
  }
  if (oldest == lanes_.end()) return std::nullopt;

  BatchBuilder builder(max_payload);
  for (const std::uint64_t order : oldest->second.waiting)
    if (!builder.add(order, rows_.at(order).json)) break;
  HistoryBatch batch = builder.take(oldest->first);
  for (const std::uint64_t order : batch.orders) oldest->second.waiting.erase(order);
  oldest->second.on_the_way = true;
  return batch;
}

void Backlog::returned(const HistoryBatch& batch) {
  Lane& lane = lanes_[{batch.device, batch.group}];
  lane.on_the_way = false;
  for (const std::uint64_t order : batch.orders)
    if (rows_.contains(order)) lane.waiting.insert(order);
}

std::vector<SampleRow> Backlog::take_waiting() {
  std::vector<SampleRow> taken;
  for (auto next = rows_.begin(); next != rows_.end();) {
    const auto row = next++;
    if (!lanes_.at({row->second.device, row->second.group}).waiting.contains(row->first)) continue;
    taken.push_back(row->second);
    erase(row);
  }
  return taken;
}

bool Backlog::has_waiting(const std::string& device) const {
  for (auto lane = lanes_.lower_bound({device, {}});
       lane != lanes_.end() && lane->first.first == device; ++lane)
    if (!lane->second.waiting.empty()) return true;
  return false;
}

bool Backlog::is_on_the_way(const LaneKey& lane) const {
  const auto found = lanes_.find(lane);
  return found != lanes_.end() && found->second.on_the_way;
}

std::uint64_t Backlog::remove(const HistoryBatch& batch) {
  lanes_[{batch.device, batch.group}].on_the_way = false;
  std::uint64_t removed = 0;
  for (const std::uint64_t order : batch.orders) {
    const auto row = rows_.find(order);
    if (row == rows_.end()) continue;
    erase(row);
    ++removed;
  }
  return removed;
}

void Backlog::erase(std::map<std::uint64_t, SampleRow>::iterator row) {
  bytes_ -= row->second.cost();
  lanes_[{row->second.device, row->second.group}].waiting.erase(row->first);
  rows_.erase(row);
}

}  // namespace fxagent
