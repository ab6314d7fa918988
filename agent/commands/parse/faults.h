// Selects the fault that decides on a command: the first in the contract's order of checks. Pure,
// any thread.
#pragma once

#include <optional>
#include <string>
#include <utility>

#include "agent/handover/command_message.h"

namespace fxagent {

/// Collects faults and keeps the first in the order of checks. Of several with the same rank, keeps
/// the one added first.
class Faults final {
 public:
  void add(Refusal fault) {
    if (!first_ || rank(fault.reason) < rank(first_->reason)) first_ = std::move(fault);
  }
  void add(Reason reason, std::string detail) { add(Refusal{reason, std::move(detail)}); }
  /// Does nothing for nullopt.
  void add(std::optional<Refusal> fault) {
    if (fault) add(std::move(*fault));
  }
  const std::optional<Refusal>& first() const { return first_; }

 private:
  /// Reason's enumerators are in the order of checks; some share a rank.
  static Reason rank(Reason reason) {
    if (reason == Reason::bad_address) return Reason::unknown_tag;
    return reason == Reason::not_allowed ? Reason::not_writable : reason;
  }
  std::optional<Refusal> first_;
};

}  // namespace fxagent
