#include "agent/process/restart.h"

#include <linux/close_range.h>
#include <unistd.h>

#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <string_view>
#include <system_error>
#include <vector>

namespace fxagent {
namespace {

constexpr const char* kRestarted = "FXAGENT_RESTARTED";
char restarted[] = "FXAGENT_RESTARTED=1";

}  // namespace

bool was_restarted() {
  // The environment does not change while the agent runs.
  return std::getenv(kRestarted) != nullptr;  // NOLINT(concurrency-mt-unsafe)
}

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
