#include "agent/store/backlog.h"

#include <algorithm>

namespace fxagent {

void Backlog::append(SampleRow row) {
  bytes_ += row.cost();
  auto& lane = *lanes_.try_emplace({row.device, row.group}).first;
  lane.second.waiting.insert(row.order);
  place(lane);
  rows_.emplace(row.order, std::move(row));
  while (bytes_ > max_bytes_ && !rows_.empty()) {
    ++dropped_[rows_.begin()->second.device];
    erase(rows_.begin());
  }
}

std::optional<HistoryBatch> Backlog::next(std::size_t max_payload, const MaySend& may_send) {
  const auto ready = std::find_if(ready_.begin(), ready_.end(), [&](const auto& oldest) {
    return may_send(oldest.second->first);
  });
  if (ready == ready_.end()) return std::nullopt;

  Lanes::value_type& lane = *ready->second;
  BatchBuilder builder(max_payload);
  for (const std::uint64_t order : lane.second.waiting)
    if (!builder.add(order, rows_.at(order).json)) break;
  HistoryBatch batch = builder.take(lane.first);
  for (const std::uint64_t order : batch.orders) lane.second.waiting.erase(order);
  lane.second.on_the_way = true;
  place(lane);
  return batch;
}

void Backlog::returned(const HistoryBatch& batch) {
  auto& lane = *lanes_.try_emplace({batch.device, batch.group}).first;
  lane.second.on_the_way = false;
  for (const std::uint64_t order : batch.orders)
    if (rows_.contains(order)) lane.second.waiting.insert(order);
  place(lane);
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
  auto& lane = *lanes_.try_emplace({batch.device, batch.group}).first;
  lane.second.on_the_way = false;
  place(lane);
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
  auto& lane = *lanes_.try_emplace({row->second.device, row->second.group}).first;
  lane.second.waiting.erase(row->first);
  place(lane);
  rows_.erase(row);
}

void Backlog::place(Lanes::value_type& lane) {
  auto& [waiting, on_the_way, ready_as] = lane.second;
  std::optional<std::uint64_t> ready;
  if (!on_the_way && !waiting.empty()) ready = *waiting.begin();
  if (ready == ready_as) return;
  if (ready_as) ready_.erase(*ready_as);
  if (ready) ready_.emplace(*ready, &lane);
  ready_as = ready;
}

}  // namespace fxagent
