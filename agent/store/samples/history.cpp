#include "agent/store/samples/history.h"

#include <nlohmann/json.hpp>

#include "agent/text/json_writer.h"

namespace fxagent {

std::optional<RowFormat> row_format(std::int64_t number) {
  if (number < 0 || number > static_cast<std::int64_t>(RowFormat::cbor)) return std::nullopt;
  return static_cast<RowFormat>(number);
}

bool is_intact(std::string_view json_row) {
  return json::may_stand_inside(json_row) && nlohmann::json::accept(json_row);
}

BatchBuilder::Added BatchBuilder::add(std::uint64_t row_id, std::optional<RowFormat> format,
                                      std::string_view content) {
  const bool is_json = format == RowFormat::json_text;
  if (!format || !(is_json ? is_intact(content) : decode_sample(content, record_)))
    return Added::damaged;
  if (!(is_json ? message_.add(content) : message_.add(record_))) return Added::no_room;
  row_ids_.push_back(row_id);
  return Added::yes;
}

HistoryBatch BatchBuilder::take(const StreamKey& stream) {
  return {stream.first, stream.second, std::move(row_ids_), message_.take()};
}

}  // namespace fxagent
