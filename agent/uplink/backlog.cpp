#include "agent/uplink/backlog.h"

#include <string_view>

#include "agent/uplink/json.h"

namespace fxagent {

void Backlog::append(Row row) {
  bytes_ += row.json.size() + kRowOverhead;
  lanes_[{row.device, row.group}].waiting.insert(row.order);
  rows_.emplace(row.order, std::move(row));
  while (bytes_ > max_bytes_ && !rows_.empty()) {
    ++dropped_[rows_.begin()->second.device];
    erase(rows_.begin());
  }
}

std::optional<Backlog::Batch> Backlog::next(
    std::size_t max_payload, const std::function<bool(std::uint32_t device)>& may_send) {
  auto oldest = lanes_.end();
  for (auto lane = lanes_.begin(); lane != lanes_.end(); ++lane) {
    if (lane->second.on_the_way || lane->second.waiting.empty() || !may_send(lane->first.first))
      continue;
    if (oldest == lanes_.end() || *lane->second.waiting.begin() < *oldest->second.waiting.begin())
      oldest = lane;
  }
  if (oldest == lanes_.end()) return std::nullopt;

  Batch batch;
  batch.device = oldest->first.first;
  batch.group = oldest->first.second;
  std::vector<std::string_view> texts;
  std::size_t size = json::kHistoryFrameBytes;
  for (const std::uint64_t order : oldest->second.waiting) {
    const std::string& text = rows_.at(order).json;
    size += text.size() + (texts.empty() ? 0 : 1);
    if (!texts.empty() && size > max_payload) break;
    texts.push_back(text);
    batch.orders.push_back(order);
  }
  for (const std::uint64_t order : batch.orders) oldest->second.waiting.erase(order);
  oldest->second.on_the_way = true;
  batch.payload = json::history(texts);
  return batch;
}

void Backlog::returned(const Batch& batch) {
  Lane& lane = lanes_[{batch.device, batch.group}];
  lane.on_the_way = false;
  for (const std::uint64_t order : batch.orders)
    if (rows_.contains(order)) lane.waiting.insert(order);
}

bool Backlog::has_waiting(std::uint32_t device) const {
  for (auto lane = lanes_.lower_bound({device, 0});
       lane != lanes_.end() && lane->first.first == device; ++lane)
    if (!lane->second.waiting.empty()) return true;
  return false;
}

std::uint64_t Backlog::remove(const Batch& batch) {
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

void Backlog::erase(std::map<std::uint64_t, Row>::iterator row) {
  bytes_ -= row->second.json.size() + kRowOverhead;
  lanes_[{row->second.device, row->second.group}].waiting.erase(row->first);
  rows_.erase(row);
}

}  // namespace fxagent
