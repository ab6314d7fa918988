#include "agent/process/this_process.h"

#include <gtest/gtest.h>

#include <thread>

#include "agent/process/service_reports.h"
#include "agent/without_signals.h"

namespace fxagent {
namespace {

TEST(Startup, WhatIsThereIsNotLacking) {
  EXPECT_EQ(lacks(2, 1 << 20), "");
  EXPECT_EQ(lacks(0, 0), "");
}

TEST(Startup, MemoryThatCannotBeHadIsNamedWithItsLimit) {
  const std::string why = lacks(1, std::numeric_limits<std::size_t>::max() / 4);
  EXPECT_NE(why.find("no memory"), std::string::npos) << why;
  EXPECT_NE(why.find("ulimit -v"), std::string::npos) << why;
}

TEST(WithoutSignals, ThreadsTakeNoneAndTheirMakerDoesAsBefore) {
  sigset_t before;
  pthread_sigmask(SIG_SETMASK, nullptr, &before);
  sigset_t inside;
  {
    const WithoutSignals quiet;
    std::thread([&] { pthread_sigmask(SIG_SETMASK, nullptr, &inside); }).join();
  }
  sigset_t after;
  pthread_sigmask(SIG_SETMASK, nullptr, &after);
  EXPECT_EQ(sigismember(&inside, SIGTERM), 1);
  EXPECT_EQ(sigismember(&after, SIGTERM), sigismember(&before, SIGTERM));
}

TEST(Heartbeats, BothHaveToGoOn) {
  Heartbeats progress;
  EXPECT_EQ(progress.hanging_threads(), "field and uplink");
  progress.field_went_on();
  EXPECT_EQ(progress.hanging_threads(), "uplink");
  EXPECT_EQ(progress.hanging_threads(), "uplink");  // the field's sign is still valid
  progress.uplink_went_on();
  EXPECT_EQ(progress.hanging_threads(), "");
  progress.uplink_went_on();
  EXPECT_EQ(progress.hanging_threads(), "field");
}

TEST(Heartbeats, PairHasToGoOnIfThereIsOne) {
  Heartbeats progress(true);
  progress.field_went_on();
  progress.uplink_went_on();
  EXPECT_EQ(progress.hanging_threads(), "pair");
  progress.pair_went_on();
  EXPECT_EQ(progress.hanging_threads(), "");
  EXPECT_EQ(progress.hanging_threads(), "field and uplink and pair");
}

}  // namespace
}  // namespace fxagent
