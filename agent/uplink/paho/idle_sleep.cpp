// Interposes usleep(), by which Paho sleeps. The dynamic linker searches the program before its
// libraries, so this definition replaces libc's. A library that still binds to libc's usleep()
// sleeps as before.
#include "agent/uplink/paho/idle_sleep.h"

#include <time.h>
#include <unistd.h>

#include <optional>
#include <utility>

namespace fxagent {
namespace {

constexpr useconds_t kIdleSleep = 100'000;
// Less than the 1 s of a poll() that waited, more than the 0.1 s between two sleeps of a loop whose
// poll() returns at once.
constexpr std::chrono::milliseconds kWaited{500};

thread_local std::optional<IdleSleeps> idle_sleeps;

}  // namespace

bool IdleSleeps::leaves_out(std::chrono::steady_clock::time_point now) noexcept {
  return now - std::exchange(asked_, now) >= kWaited;
}

void leave_out_idle_sleeps() noexcept { idle_sleeps.emplace(); }

}  // namespace fxagent

extern "C" int usleep(useconds_t microseconds) {
  if (microseconds == fxagent::kIdleSleep && fxagent::idle_sleeps &&
      fxagent::idle_sleeps->leaves_out(std::chrono::steady_clock::now()))
    return 0;
  constexpr useconds_t second = 1'000'000;
  const timespec time{static_cast<time_t>(microseconds / second),
                      static_cast<long>(microseconds % second) * 1000};
  return nanosleep(&time, nullptr);
}
