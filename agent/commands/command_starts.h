// PORT: which commands may have left the agent, so that a restart after a crash can tell those that
// only waited from those that may have been carried out. The store keeps it; the field says it.
#pragma once

#include <cstdint>

namespace fxagent {

class CommandStarts {
 public:
  virtual ~CommandStarts() = default;

  /// The first byte of what the command with this number is to change leaves next: once for each
  /// command, before that byte. What fails here makes the command one that may have left. Field
  /// thread.
  virtual void mark(std::uint64_t number) = 0;
};

}  // namespace fxagent
