// Errors of a document whose sender may mean harm: one may stand in each few bytes of it.
#pragma once

#include <cstddef>
#include <utility>
#include <vector>

#include "agent/config/config.h"
#include "agent/config/findings.h"

namespace fxagent {

/// Keeps as many as a config has findings, and counts the others.
class ErrorList final {
 public:
  void add(ConfigError error) {
    if (list_.size() < Findings::kMost)
      list_.push_back(std::move(error));
    else
      ++unlisted_;
  }
  bool empty() const { return list_.empty(); }

  /// The first says how many are not kept, where that is so.
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
