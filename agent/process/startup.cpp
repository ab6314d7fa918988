#include "agent/process/startup.h"

#include <sys/mman.h>
#include <sys/resource.h>

#include <cerrno>
#include <cstring>
#include <latch>
#include <stdexcept>
#include <system_error>
#include <thread>
#include <vector>

#include "agent/log/log.h"
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

// A socket for each of 1,000 links is more than Debian's soft limit of 1,024 leaves room for.
void raise_file_limit(std::size_t least) {
  rlimit limit{};
  if (getrlimit(RLIMIT_NOFILE, &limit) != 0) return;
  limit.rlim_cur = limit.rlim_max;
  setrlimit(RLIMIT_NOFILE, &limit);
  if (limit.rlim_max > static_cast<rlim_t>(least)) return;
  throw std::runtime_error("cannot start: " + std::to_string(limit.rlim_max) +
                           " open files are allowed, and the agent needs more than " +
                           std::to_string(least) +
                           "; raise the hard limit (LimitNOFILE of the service, ulimit -Hn)");
}

void say_where_files_are_too_few(std::size_t needed) {
  rlimit limit{};
  if (getrlimit(RLIMIT_NOFILE, &limit) != 0 || limit.rlim_max == RLIM_INFINITY ||
      limit.rlim_max >= static_cast<rlim_t>(needed))
    return;
  log::error("agent", {{"open_files_allowed", std::to_string(limit.rlim_max)},
                       {"open_files_needed", std::to_string(needed)},
                       {"note",
                        "too few open files for all links: raise the hard limit (LimitNOFILE of "
                        "the service, ulimits of a container, ulimit -Hn in a shell)"}});
}

}  // namespace fxagent
