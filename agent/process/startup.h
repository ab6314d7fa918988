// What the agent must have before it begins: threads, memory and open files. Without them it would
// stand still somewhere inside a library and say nothing.
#pragma once

#include <csignal>
#include <cstddef>
#include <string>

namespace fxagent {

/// Whether so many threads can be had at this moment, at the same time, and `bytes` of address
/// space beside their stacks. Empty: yes; else what is missing, and which limit to raise. They are
/// gone when it returns.
std::string lacks(int threads, std::size_t bytes);

/// While it lives, threads that are started take no signals: those are for the main thread.
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
