#include "agent/store/samples/history.h"

#include <nlohmann/json.hpp>

#include "agent/text/json_writer.h"

namespace fxagent {

BatchBuilder::Added BatchBuilder::add(std::uint64_t row_id, RowFormat format,
                                      std::string_view content) {
  const bool is_json = format == RowFormat::json_text;
  // A worn-out disk may return something else than was written.
  const bool is_intact = is_json
                             ? json::may_stand_inside(content) && nlohmann::json::accept(content)
                             : format == RowFormat::cbor && decode_sample(content, record_);
  if (!is_intact) return Added::damaged;
  if (!(is_json ? message_.add_json(content) : message_.add(record_))) return Added::no_room;
  row_ids_.push_back(row_id);
  return Added::yes;
}

}  // namespace fxagent
