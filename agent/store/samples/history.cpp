#include "agent/store/samples/history.h"

namespace fxagent {

BatchBuilder::Added BatchBuilder::add(std::uint64_t row_id, std::string_view content) {
  if (!decode_sample(content, record_)) return Added::damaged;
  if (!message_.add(record_)) return Added::no_room;
  row_ids_.push_back(row_id);
  return Added::yes;
}

}  // namespace fxagent
