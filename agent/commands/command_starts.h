// PORT: records which commands may have left the agent. After a crash, a restart can distinguish
// commands that only waited from those that may have been carried out. The field reports to it; the
// store keeps it.
#pragma once

#include <cstdint>

namespace fxagent {

class CommandStarts {
 public:
  virtual ~CommandStarts() = default;

  /// Call once for each command, before the first byte that changes anything leaves. If this fails,
  /// the command counts as possibly sent. Field thread.
  virtual void mark(std::uint64_t number) = 0;
};

}  // namespace fxagent
