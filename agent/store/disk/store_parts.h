// The parts of the store, in their order. The store's thread.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <utility>
#include <vector>

#include "agent/store/disk/store_part.h"

namespace fxagent {

class StoreParts final {
 public:
  /// Sets the parts, in the order in which they load and write. They outlive every call here.
  void set(std::vector<StorePart*> parts) { parts_ = std::move(parts); }
  /// Calls this function of each part, with the same arguments.
  template <class... Parameters, class... Arguments>
  void each(void (StorePart::*function)(Parameters...), Arguments&&... arguments) {
    for (StorePart* part : parts_) (part->*function)(arguments...);
  }
  /// Samples of all parts.
  std::uint64_t rows() const {
    std::uint64_t rows = 0;
    for (const StorePart* part : parts_) rows += part->rows();
    return rows;
  }
  bool has_pending() const { return std::ranges::any_of(parts_, &StorePart::has_pending); }
  /// Writes at most `at_most` entries of each part. Returns true if more are left.
  bool write_pending(std::size_t at_most = std::numeric_limits<std::size_t>::max()) {
    bool is_left = false;
    for (StorePart* part : parts_) is_left = part->write_pending(at_most) || is_left;
    return is_left;
  }

 private:
  std::vector<StorePart*> parts_;
};

}  // namespace fxagent
