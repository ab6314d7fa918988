// PORT: lets a long command share its bus with polls and other commands, and learn when to stop.
// Field thread.
#pragma once

#include <asio/awaitable.hpp>
#include <chrono>
#include <cstddef>

#include "agent/handover/command_message.h"

namespace fxagent {

class BusSharing {
 public:
  virtual ~BusSharing() = default;

  /// Lets polls and other commands run between two parts of a long command. `used` is the line time
  /// of the part that has just ended.
  virtual asio::awaitable<void> give_way(std::chrono::nanoseconds used) = 0;

  /// Called when a target has its outcome, while others still wait.
  virtual void concluded(std::size_t target, const TargetResult& outcome) = 0;

  /// Returns why nothing more may be written: shutting_down or reloading; none: writes are allowed.
  /// What was written may still be read back.
  virtual Reason why_stopping() const = 0;
  bool is_stopping() const { return why_stopping() != Reason::none; }
  /// True if nothing at all may be sent any more.
  virtual bool is_over() const = 0;
};

}  // namespace fxagent
