#include "agent/store/history.h"

#include <nlohmann/json.hpp>

#include "agent/json_writer.h"

namespace fxagent {
bool is_intact(std::string_view row) {
  return json::may_stand_inside(row) && nlohmann::json::accept(row);
}

std::string history_text(std::span<const std::string_view> rows) {
  json::Writer out;
  out.begin_object().key("history").boolean(true).key("rows").begin_array();
  for (const std::string_view row : rows) out.raw(row);
  out.end_array().end_object();
  return out.take();
}

bool BatchBuilder::add(std::uint64_t row_id, std::string_view row) {
  const std::size_t size = empty() ? kHistoryFrameBytes + row.size() : size_ + 1 + row.size();
  if (!empty() && size > max_payload_) return false;
  size_ = size;
  row_ids_.push_back(row_id);
  rows_.emplace_back(row);
  return true;
}

HistoryBatch BatchBuilder::take(const StreamKey& stream) {
  const std::vector<std::string_view> texts(rows_.begin(), rows_.end());
  return {stream.first, stream.second, std::move(row_ids_), history_text(texts)};
}

}  // namespace fxagent
