// Keeps signals on the main thread.
#pragma once

#include <csignal>

namespace fxagent {

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
