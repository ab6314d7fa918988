#include "agent/uplink/history.h"

#include "agent/uplink/json.h"

namespace fxagent {

bool BatchBuilder::add(std::uint64_t order, std::string_view row) {
  const std::size_t size = empty() ? json::kHistoryFrameBytes + row.size() : size_ + 1 + row.size();
  if (!empty() && size > max_payload_) return false;
  size_ = size;
  orders_.push_back(order);
  rows_.emplace_back(row);
  return true;
}

HistoryBatch BatchBuilder::take(const LaneKey& lane) {
  const std::vector<std::string_view> texts(rows_.begin(), rows_.end());
  return {lane.first, lane.second, std::move(orders_), json::history(texts)};
}

}  // namespace fxagent
