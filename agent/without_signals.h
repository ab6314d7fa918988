// Blocks signals.
#pragma once

#include <csignal>

namespace fxagent {

/// Blocks SIGINT and SIGTERM in this thread and in those that it starts. Returns a descriptor that
/// is readable while one is pending, or -1.
int stop_descriptor();

/// Threads started during its lifetime receive no signals: those are for the main thread.
class WithoutSignals final {
 public:
  WithoutSignals();
  ~WithoutSignals();
  WithoutSignals(const WithoutSignals&) = delete;
  WithoutSignals& operator=(const WithoutSignals&) = delete;

 private:
  sigset_t before_{};
};

}  // namespace fxagent
