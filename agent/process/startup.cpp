#include "agent/process/startup.h"

#include <sys/mman.h>

#include <cerrno>
#include <cstring>
#include <latch>
#include <system_error>
#include <thread>
#include <vector>

namespace fxagent {

std::string lacks(int threads, std::size_t bytes) {
  const WithoutSignals quiet;
  std::latch may_end(1);
  std::vector<std::jthread> started;
  std::string answer;
  try {
    for (int i = 0; i < threads; ++i) started.emplace_back([&may_end] { may_end.wait(); });
    void* room = bytes == 0 ? nullptr
                            : ::mmap(nullptr, bytes, PROT_READ | PROT_WRITE,
                                     MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
    if (room == MAP_FAILED)
      answer = "no memory for " + std::to_string(bytes >> 20) +
               " MiB more: " + std::strerror(errno) +
               "; raise the limit of the address space (LimitAS of the service, ulimit -v)";
    else if (room != nullptr)
      ::munmap(room, bytes);
  } catch (const std::system_error& error) {
    answer = "only " + std::to_string(started.size()) + " of " + std::to_string(threads) +
             " threads more: " + error.code().message() +
             "; raise the limit of threads (TasksMax of the service, pids_limit of the container, "
             "ulimit -u) or of the address space (ulimit -v)";
  }
  may_end.count_down();
  return answer;
}

WithoutSignals::WithoutSignals() {
  sigset_t all;
  sigfillset(&all);
  pthread_sigmask(SIG_BLOCK, &all, &before_);
}

WithoutSignals::~WithoutSignals() { pthread_sigmask(SIG_SETMASK, &before_, nullptr); }

}  // namespace fxagent
