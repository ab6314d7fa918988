// Parses commands as they come on a topic, and selects the decisive fault. Pure, any thread.
#pragma once

#include <chrono>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

#include "agent/handover/command_message.h"

namespace fxagent {

/// Parses a command; never throws. `refusal` is the first fault of its form, in the contract's
/// order of checks. Everything that could be read anyway is filled in, above all the id. The caller
/// sets the device and the MessageProperties, of which the texts need `ops` here.
Command parse_command(std::string_view payload, std::string_view ops = kOpNames);

/// A command for a link: `yield` or `resume`.
struct LinkCommand {
  Command command{};              ///< its id may be empty: the id is optional
  std::chrono::minutes time{15};  ///< how long the port is yielded; 0: resume
};
/// Longest yield: a shift and a half.
inline constexpr std::chrono::minutes kLongestYield{720};
/// Parses a command for a link as parse_command().
LinkCommand parse_link_command(std::string_view payload);

/// Collects faults and keeps the first in the contract's order of checks. Of several with the same
/// rank, keeps the one added first.
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
