#include "agent/store/disk/store_parts.h"

#include <algorithm>

namespace fxagent {

void StoreParts::load(SQLite::Database& database) {
  for (StorePart* part : parts_) part->load(database);
}

void StoreParts::unload(Rows rows) {
  for (StorePart* part : parts_) part->unload(rows);
}

void StoreParts::set_aside(const std::string& name) {
  for (StorePart* part : parts_) part->set_aside(name);
}

void StoreParts::replaced() {
  for (StorePart* part : parts_) part->replaced();
}

std::uint64_t StoreParts::rows() const {
  std::uint64_t rows = 0;
  for (const StorePart* part : parts_) rows += part->rows();
  return rows;
}

bool StoreParts::has_pending() const {
  return std::any_of(parts_.begin(), parts_.end(),
                     [](const StorePart* part) { return part->has_pending(); });
}

void StoreParts::begin_commit() {
  for (StorePart* part : parts_) part->begin_commit();
}

bool StoreParts::write_pending(std::size_t at_most) {
  bool is_left = false;
  for (StorePart* part : parts_) is_left = part->write_pending(at_most) || is_left;
  return is_left;
}

void StoreParts::end_commit() {
  for (StorePart* part : parts_) part->end_commit();
}

void StoreParts::committed() {
  for (StorePart* part : parts_) part->committed();
}

}  // namespace fxagent
