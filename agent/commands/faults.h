// Which fault of a command decides: the first in the contract's order of checks. Pure, any thread.
#pragma once

#include <optional>
#include <string>
#include <utility>

#include "agent/messages.h"

namespace fxagent {

/// Collects faults and keeps the one that comes first in the order of checks; of several that have
/// the same place in it, the one that was added first.
class Faults final {
 public:
  void add(Refusal fault) {
    if (!first_ || rank(fault.reason) < rank(first_->reason)) first_ = std::move(fault);
  }
  void add(Reason reason, std::string detail) { add(Refusal{reason, std::move(detail)}); }
  /// Nothing where there is none.
  void add(std::optional<Refusal> fault) {
    if (fault) add(std::move(*fault));
  }
  const std::optional<Refusal>& first() const { return first_; }

 private:
  /// Reason's enumerators stand in that order; some share a place.
  static Reason rank(Reason reason) {
    if (reason == Reason::bad_address) return Reason::unknown_tag;
    return reason == Reason::not_allowed ? Reason::not_writable : reason;
  }
  std::optional<Refusal> first_;
};

}  // namespace fxagent
