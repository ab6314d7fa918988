// PORT: records which commands may have left the agent. After a crash, a restart can distinguish
// commands that only waited from those that may have been carried out. The field reports to it; the
// store keeps it.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>

namespace fxagent {

class CommandStarts {
 public:
  virtual ~CommandStarts() = default;

  /// Receives true if the command may be sent: it is marked, or counts as possibly sent because its
  /// mark could not be written. False: the disk does not answer, so nothing may be sent.
  using Done = std::function<void(bool may_be_sent)>;

  /// Call once for each command, before the first byte that changes anything leaves. Never waits
  /// for the disk: calls `done` at most once, on any thread, perhaps before it returns. If that
  /// takes longer than patience(), the command must not be sent. Field thread.
  virtual void mark(std::uint64_t number, Done done) = 0;
  /// Returns how long to wait for `done`.
  virtual std::chrono::milliseconds patience() const { return std::chrono::seconds(2); }
};

}  // namespace fxagent
