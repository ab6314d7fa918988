// Rows of samples that are delivered and still in the store's file. The next commit deletes them.
// The store's thread.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <set>

#include "agent/store/disk/sqlite.h"
#include "agent/store/disk/store_part.h"

namespace fxagent {

class SampleRemovals final : public StorePart {
 public:
  void add(std::uint64_t row_id) { rows_.insert(row_id); }
  bool contains(std::uint64_t row_id) const { return rows_.contains(row_id); }
  std::size_t size() const { return rows_.size(); }

  void load(SQLite::Database& database) override;
  void unload(Rows rows) override;
  bool has_pending() const override { return !rows_.empty(); }
  bool write_pending(std::size_t at_most) override;
  void begin_commit() override { is_written_ = false; }
  void committed() override;

 private:
  std::optional<SQLite::Statement> remove_;
  std::set<std::uint64_t> rows_;
  bool is_written_ = false;  ///< in the open commit
};

}  // namespace fxagent
