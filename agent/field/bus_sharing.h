// PORT: what a long command owes its line, and what its line tells it of the end. Field thread.
#pragma once

#include <asio/awaitable.hpp>
#include <chrono>
#include <cstddef>
#include <string_view>

#include "agent/messages.h"

namespace fxagent {

class BusSharing {
 public:
  virtual ~BusSharing() = default;

  /// Between two parts of a command that takes long: polls and other commands have their turns.
  /// `used` is the line time of the part that has just ended.
  virtual asio::awaitable<void> give_way(std::chrono::nanoseconds used) = 0;

  /// A target has its outcome, while others still wait.
  virtual void concluded(std::size_t target, const TargetResult& outcome) = 0;

  /// Why nothing more is to be written, as "the agent is stopping"; what was written may still be
  /// read back. Empty: it may.
  virtual std::string_view why_stopping() const = 0;
  bool is_stopping() const { return !why_stopping().empty(); }
  /// Nothing at all goes out any more.
  virtual bool is_over() const = 0;
};

}  // namespace fxagent
