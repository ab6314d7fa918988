// The parts of the store as one part: each call goes to all of them, in their order. The store's
// thread.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "agent/store/disk/store_part.h"

namespace fxagent {

class StoreParts final : public StorePart {
 public:
  /// Sets the parts, in the order in which they load and write. They outlive every call here.
  void set(std::vector<StorePart*> parts) { parts_ = std::move(parts); }

  void load(SQLite::Database& database) override;
  void unload(Rows rows) override;
  void set_aside(const std::string& name) override;
  void replaced() override;
  /// Samples of all parts.
  std::uint64_t rows() const override;
  bool has_pending() const override;
  void begin_commit() override;
  /// Writes at most `at_most` entries of each part.
  bool write_pending(std::size_t at_most = std::numeric_limits<std::size_t>::max()) override;
  void end_commit() override;
  void committed() override;

 private:
  std::vector<StorePart*> parts_;
};

}  // namespace fxagent
