// Resources that the agent needs before it begins: threads, memory and open files. Without them it
// would hang inside a library and report nothing.
#pragma once

#include <csignal>
#include <cstddef>
#include <string>

namespace fxagent {

/// Checks if `threads` threads can exist at the same time, and `bytes` of address space in addition
/// to their stacks. Returns an empty text, or what is missing and which limit to raise. The threads
/// have ended when it returns.
std::string lacks(int threads, std::size_t bytes);

/// Threads started during its lifetime receive no signals: those are for the main thread.
class WithoutSignals final {
 public:
  WithoutSignals();
  ~WithoutSignals();
  WithoutSignals(const WithoutSignals&) = delete;
  WithoutSignals& operator=(const WithoutSignals&) = delete;

 private:
  sigset_t before_;
};

}  // namespace fxagent
