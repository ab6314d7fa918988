// failpoint() of the program that dies at one: FXAGENT_CRASH_AT="name" or "name:nth" names it,
// and the kernel ends the process there without another instruction of it. Where
// FXAGENT_STAND_STILL_AT names the point, the thread that comes there goes no further. And
// trial_time(), which FXAGENT_TRIAL_MS makes shorter.
#include <signal.h>
#include <unistd.h>

#include <atomic>
#include <cstdlib>
#include <string>

#include "agent/failpoint.h"
#include "agent/remote/trial_time.h"

namespace fxagent {
namespace {

struct CrashAt {
  std::string name;
  int nth = 1;

  CrashAt() {
    const char* wanted = std::getenv("FXAGENT_CRASH_AT");
    if (wanted == nullptr) return;
    name = wanted;
    const std::size_t colon = name.find(':');
    if (colon == std::string::npos) return;
    nth = std::atoi(name.c_str() + colon + 1);
    name.resize(colon);
  }
};

}  // namespace

void failpoint(std::string_view name) noexcept {
  static const CrashAt wanted;
  static std::atomic<int> passed = 0;
  static const char* const still = std::getenv("FXAGENT_STAND_STILL_AT");
  while (still != nullptr && name == still) ::pause();
  if (name != wanted.name || ++passed != wanted.nth) return;
  ::kill(::getpid(), SIGKILL);
  ::pause();  // another thread may have been given the signal
}

std::chrono::milliseconds trial_time() noexcept {
  const char* wanted = std::getenv("FXAGENT_TRIAL_MS");
  return std::chrono::milliseconds(wanted == nullptr ? 60'000 : std::atoi(wanted));
}

}  // namespace fxagent
