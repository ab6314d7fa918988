// Interposes connect(), poll() and usleep(), to end two needless waits of Paho's reading thread.
//
// It waits up to 1 s for something to read before it checks whether a new socket is connected, and
// does not include a socket that is created while it waits (Socket_getReadySocket). A connect could
// take 1 s longer, and with other connections 2 s.
//
// If nothing arrives in that time, it sleeps 100 ms before the next poll (MQTTAsync_cycle, still so
// in 1.3.15). A command that arrives during the sleep is read up to 100 ms late. The sleep keeps
// the loop from spinning when poll() returns at once, so it is skipped only after a poll that has
// waited.
#pragma once

#include <chrono>

namespace fxagent {

bool is_paho_thread() noexcept;

/// Forgets a socket, because Paho has read the outcome of its connect(). Any thread.
void note_connect_outcome(int fd) noexcept;

/// Decides which sleeps of a polling loop to skip. Pure.
class IdleSleeps final {
 public:
  /// True if the loop may skip the sleep that it requests at `now`: at least 500 ms have passed
  /// since its last request, so it has waited elsewhere. Skips at most two sleeps per second.
  bool leaves_out(std::chrono::steady_clock::time_point now) noexcept;

 private:
  std::chrono::steady_clock::time_point asked_{};
};

/// Makes the calling thread skip such sleeps of 100 ms. Its other sleeps, and those of other
/// threads, keep their length.
void leave_out_idle_sleeps() noexcept;

}  // namespace fxagent
