#include "agent/uplink/paho/idle_sleep.h"

#include <dlfcn.h>
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <unistd.h>

#include <thread>

namespace fxagent {
namespace {

using namespace std::chrono_literals;
using Time = std::chrono::steady_clock::time_point;

constexpr useconds_t kIdle = 100'000;

/// Returns true if this call yields the processor. Finds usleep() as a shared library would.
bool sleeps(useconds_t microseconds) {
  static const auto found = reinterpret_cast<int (*)(useconds_t)>(dlsym(RTLD_DEFAULT, "usleep"));
  const auto switches = [] {
    rusage usage{};
    getrusage(RUSAGE_THREAD, &usage);
    return usage.ru_nvcsw;
  };
  const long before = switches();
  EXPECT_EQ(found(microseconds), 0);
  return switches() > before;
}

TEST(IdleSleeps, LoopThatWaitsElsewhereNeedsNone) {
  IdleSleeps sleeps;
  Time now = Time() + 1h;
  for (int round = 0; round < 10; ++round) EXPECT_TRUE(sleeps.leaves_out(now += 1s)) << round;
}

TEST(IdleSleeps, LoopThatWaitsNowhereElseKeepsAllButTheFirst) {
  IdleSleeps sleeps;
  Time now = Time() + 1h;
  EXPECT_TRUE(sleeps.leaves_out(now));
  for (int round = 0; round < 20; ++round) EXPECT_FALSE(sleeps.leaves_out(now += 101ms)) << round;
}

TEST(IdleSleeps, LoopThatNeverSleptIsStoppedAtTheSecondTurn) {
  IdleSleeps sleeps;
  Time now = Time() + 1h;
  int left_out = 0;
  for (int round = 0; round < 1000; ++round) left_out += sleeps.leaves_out(now += 1us) ? 1 : 0;
  EXPECT_EQ(left_out, 1);
}

TEST(IdleSleeps, LoopThatWaitsNowAndThenKeepsTheSleepBetween) {
  IdleSleeps sleeps;
  Time now = Time() + 1h;
  for (int round = 0; round < 5; ++round) {
    EXPECT_TRUE(sleeps.leaves_out(now += 1s)) << round;
    EXPECT_FALSE(sleeps.leaves_out(now += 10ms)) << round;
  }
}

TEST(IdleSleep, SharedLibrariesFindTheProgramsOwn) {
  Dl_info found{};
  Dl_info program{};
  ASSERT_NE(dladdr(dlsym(RTLD_DEFAULT, "usleep"), &found), 0);
  ASSERT_NE(dladdr(reinterpret_cast<void*>(&leave_out_idle_sleeps), &program), 0);
  EXPECT_EQ(found.dli_fbase, program.dli_fbase) << found.dli_fname;
}

TEST(IdleSleep, IsLeftOutOnceOnTheThreadThatSaidSo) {
  std::thread([] {
    EXPECT_TRUE(sleeps(kIdle));
    leave_out_idle_sleeps();
    EXPECT_TRUE(sleeps(kIdle - 1));
    EXPECT_TRUE(sleeps(kIdle + 1));
    EXPECT_FALSE(sleeps(kIdle));
    EXPECT_TRUE(sleeps(kIdle));
    std::thread([] { EXPECT_TRUE(sleeps(kIdle)); }).join();
  }).join();
}

TEST(IdleSleep, LastsAsLongAsItShould) {
  for (const auto wanted : {1us, 1'000'001us}) {
    const auto began = std::chrono::steady_clock::now();
    EXPECT_TRUE(sleeps(static_cast<useconds_t>(wanted.count())));
    EXPECT_GE(std::chrono::steady_clock::now() - began, wanted);
  }
}

}  // namespace
}  // namespace fxagent
