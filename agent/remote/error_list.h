// Errors of a document from a possibly hostile sender, which may have one in every few bytes.
#pragma once

#include <cstddef>
#include <utility>
#include <vector>

#include "agent/config/config_error.h"
#include "agent/config/model.h"
#include "agent/config/read/findings.h"

namespace fxagent {

/// Keeps the first Findings::kMost errors and counts the others.
class ErrorList final {
 public:
  void add(ConfigError error) {
    if (list_.size() < Findings::kMost)
      list_.push_back(std::move(error));
    else
      ++unlisted_;
  }
  bool empty() const { return list_.empty(); }

  /// Returns the errors and clears the list. If some were not kept, the first entry is their
  /// number.
  std::vector<ConfigError> take() {
    if (unlisted_ > 0) list_.insert(list_.begin(), {"", 0, unlisted_text(unlisted_)});
    unlisted_ = 0;
    return std::exchange(list_, {});
  }

 private:
  std::vector<ConfigError> list_;
  std::size_t unlisted_ = 0;
};

}  // namespace fxagent
