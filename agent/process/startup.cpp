#include "agent/process/startup.h"

#include <sys/mman.h>

#include <cerrno>
#include <cstring>
#include <latch>
#include <system_error>
#include <thread>
#include <vector>

#include "agent/without_signals.h"

namespace fxagent {

namespace {

/// Lets threads end when the scope is left in any way.
struct Release {
  std::latch& latch;
  ~Release() { latch.count_down(); }
};

/// Returns how many of the threads could be started; all of them have ended again.
std::size_t try_threads(std::size_t threads, std::size_t bytes, std::error_code& no_thread,
                        int& no_memory) {
  std::latch may_end(1);
  std::vector<std::jthread> started;
  started.reserve(threads);
  const Release release{may_end};
  try {
    while (started.size() < threads) started.emplace_back([&may_end] { may_end.wait(); });
  } catch (const std::system_error& error) {
    no_thread = error.code();
    return started.size();
  }
  void* room = bytes == 0 ? nullptr
                          : ::mmap(nullptr, bytes, PROT_READ | PROT_WRITE,
                                   MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
  if (room == MAP_FAILED)
    no_memory = errno;
  else if (room != nullptr)
    ::munmap(room, bytes);
  return started.size();
}

}  // namespace

std::string lacks(int threads, std::size_t bytes) {
  const WithoutSignals quiet;
  std::error_code no_thread;
  int no_memory = 0;
  const std::size_t count =
      try_threads(static_cast<std::size_t>(threads), bytes, no_thread, no_memory);
  // Not earlier: while the threads exist, memory for these texts may be missing too.
  if (no_thread)
    return "only " + std::to_string(count) + " of " + std::to_string(threads) +
           " more threads could be started: " + no_thread.message() +
           "; raise the limit of threads (TasksMax of the service, pids_limit of the container, "
           "ulimit -u) or of the address space (ulimit -v)";
  if (no_memory != 0)
    return "no memory for " + std::to_string(bytes >> 20) +
           " MiB more: " + std::strerror(no_memory) +
           "; raise the limit of the address space (LimitAS of the service, ulimit -v)";
  return {};
}

}  // namespace fxagent
