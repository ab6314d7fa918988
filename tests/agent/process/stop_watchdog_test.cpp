#include "agent/process/stop_watchdog.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <csignal>

namespace fxagent {
namespace {

using Time = std::chrono::steady_clock::time_point;

/// Returns 0 if the watchdog receives `signal`, and a program that takes the place of this one
/// would receive it too.
int stop_by(int signal) {
  StopWatchdog watchdog;
  watchdog.begin("a test");
  ::kill(::getpid(), signal);
  if (watchdog.await_signal(Time::max()) != signal) return 1;
  sigset_t pending;
  sigpending(&pending);
  return sigismember(&pending, signal) == 1 ? 0 : 2;
}

// Each in a process of its own: the signal would end another thread of the tests.

TEST(StopWatchdog, SignalStaysPendingForAProgramThatTakesThePlaceOfThisOne) {
  EXPECT_EXIT(_exit(stop_by(SIGTERM)), testing::ExitedWithCode(0), "");
  EXPECT_EXIT(_exit(stop_by(SIGINT)), testing::ExitedWithCode(0), "");
}

TEST(StopWatchdog, SignalThatWasPendingBeforeItBeganEndsTheProcess) {
  const auto begin = [] {
    sigset_t stop;
    sigemptyset(&stop);
    sigaddset(&stop, SIGTERM);
    sigprocmask(SIG_BLOCK, &stop, nullptr);
    ::kill(::getpid(), SIGTERM);
    StopWatchdog watchdog;
    watchdog.await_signal(Time::max());
    _exit(1);
  };
  EXPECT_EXIT(begin(), testing::ExitedWithCode(0), "");
}

}  // namespace
}  // namespace fxagent
