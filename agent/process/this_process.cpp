#include "agent/process/this_process.h"

#include <linux/close_range.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/timex.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <latch>
#include <stdexcept>
#include <string_view>
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

constexpr const char* kRestarted = "FXAGENT_RESTARTED";
char restarted[] = "FXAGENT_RESTARTED=1";

}  // namespace

std::optional<std::string> process_environment(std::string_view name) {
  // No code changes the environment while the agent runs.
  const char* value = std::getenv(std::string(name).c_str());  // NOLINT(concurrency-mt-unsafe)
  return value == nullptr ? std::nullopt : std::optional<std::string>(value);
}

std::string boot_id() {
  std::string id;
  std::getline(std::ifstream("/proc/sys/kernel/random/boot_id"), id);
  return id;
}

ProcessFacts read_process_facts() {
  ProcessFacts facts;
  timex clock{};
  const int state = adjtimex(&clock);
  facts.clock_synchronised = state >= 0 && state != TIME_ERROR && (clock.status & STA_UNSYNC) == 0;
  std::ifstream statm("/proc/self/statm");
  std::uint64_t total_pages = 0;
  std::uint64_t resident_pages = 0;
  if (statm >> total_pages >> resident_pages)
    facts.rss_bytes = resident_pages * static_cast<std::uint64_t>(sysconf(_SC_PAGESIZE));
  return facts;
}

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

void check_file_limit(std::size_t needed) {
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

bool was_restarted() { return process_environment(kRestarted).has_value(); }

void restart_program() {
  std::ifstream file("/proc/self/cmdline", std::ios::binary);
  std::string text{std::istreambuf_iterator<char>(file), {}};
  std::vector<char*> arguments;
  for (std::size_t at = 0; at < text.size(); at = text.find('\0', at) + 1)
    arguments.push_back(&text[at]);
  arguments.push_back(nullptr);
  std::vector<char*> variables{restarted};
  for (char** each = environ; *each != nullptr; ++each)
    if (std::string_view(*each) != restarted) variables.push_back(*each);
  variables.push_back(nullptr);
  // The new program inherits the mask of this thread: that of the main thread after its start.
  sigset_t blocked;
  sigemptyset(&blocked);
  sigaddset(&blocked, SIGTERM);
  sigaddset(&blocked, SIGINT);
  sigaddset(&blocked, SIGHUP);
  pthread_sigmask(SIG_SETMASK, &blocked, nullptr);
  ::close_range(STDERR_FILENO + 1, ~0U, CLOSE_RANGE_CLOEXEC);
  // By its path, so that the process keeps its name.
  std::error_code missing;
  const auto program = std::filesystem::read_symlink("/proc/self/exe", missing);
  if (!missing) ::execve(program.c_str(), arguments.data(), variables.data());
  ::execve("/proc/self/exe", arguments.data(), variables.data());  // the file has been replaced
  ::_exit(1);
}

}  // namespace fxagent
