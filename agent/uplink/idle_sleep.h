// Stands where Paho sleeps. Its thread that reads the connection polls for 1 s; where that brought
// nothing it sleeps 100 ms before the next poll (MQTTAsync_cycle, still so in 1.3.15), and a
// command that arrives meanwhile is read that much later. The sleep keeps its loop from spinning
// where poll() returns at once. After a poll that has waited it is left out.
#pragma once

#include <chrono>

namespace fxagent {

/// Which of the sleeps of a polling loop can be left out. Pure.
class IdleSleeps final {
 public:
  /// Whether the loop may go on without the sleep that it asks for now: since it asked last it has
  /// waited elsewhere. So it goes on without one twice a second at the most.
  bool leaves_out(std::chrono::steady_clock::time_point now) noexcept;

 private:
  std::chrono::steady_clock::time_point asked_{};
};

/// From now on this thread leaves out such sleeps of 100 ms. Its other sleeps, and those of other
/// threads, last as long as they say.
void leave_out_idle_sleeps() noexcept;

}  // namespace fxagent
