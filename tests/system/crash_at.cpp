// A failpoint() for tests. FXAGENT_CRASH_AT="name" or "name:nth" selects a failpoint at which the
// kernel kills the process, without one further instruction. FXAGENT_STAND_STILL_AT selects a
// failpoint at which the calling thread stops for ever. Also defines trial_time(), which
// FXAGENT_TRIAL_MS shortens.
#include <signal.h>
#include <unistd.h>

#include <atomic>
#include <cstdlib>
#include <string>

#include "agent/failpoint.h"
#include "agent/remote/remote_config.h"

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
  ::pause();  // another thread may receive the signal
}

std::chrono::milliseconds trial_time() noexcept {
  const char* wanted = std::getenv("FXAGENT_TRIAL_MS");
  return std::chrono::milliseconds(wanted == nullptr ? 60'000 : std::atoi(wanted));
}

}  // namespace fxagent
