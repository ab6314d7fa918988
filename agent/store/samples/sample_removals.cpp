#include "agent/store/samples/sample_removals.h"

namespace fxagent {

void SampleRemovals::load(SQLite::Database& database) {
  rows_.clear();
  remove_.emplace(database, "DELETE FROM samples WHERE id = ?");
}

void SampleRemovals::unload(Rows rows) {
  remove_.reset();
  if (rows != Rows::kept) rows_.clear();
}

bool SampleRemovals::write_pending(std::size_t /*at_most*/) {
  for (const std::uint64_t row_id : rows_) sqlite::run(*remove_, row_id);
  is_written_ = true;
  return false;
}

void SampleRemovals::committed() {
  if (is_written_) rows_.clear();
}

}  // namespace fxagent
