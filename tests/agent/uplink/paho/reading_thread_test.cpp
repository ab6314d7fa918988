#include "agent/uplink/paho/reading_thread.h"

#include <dlfcn.h>
#include <fcntl.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <poll.h>
#include <pthread.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <chrono>
#include <future>
#include <thread>

namespace fxagent {
namespace {

using namespace std::chrono_literals;
using Clock = std::chrono::steady_clock;

constexpr int kPatienceMs = 120'000;

/// Runs `what` on a thread with the name of the one that reads for Paho.
template <typename What>
auto as_paho(What what) {
  return std::async(std::launch::async, [what] {
    pthread_setname_np(pthread_self(), "MQTTAsync_rcv");
    return what();
  });
}

struct ConnectNotice : ::testing::Test {
  void SetUp() override {
    listener_ = socket(AF_INET, SOCK_STREAM, 0);
    address_.sin_family = AF_INET;
    address_.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    ASSERT_EQ(bind(listener_, reinterpret_cast<sockaddr*>(&address_), size_), 0);
    ASSERT_EQ(getsockname(listener_, reinterpret_cast<sockaddr*>(&address_), &size_), 0);
    ASSERT_EQ(listen(listener_, 4), 0);
    client_ = socket(AF_INET, SOCK_STREAM | SOCK_NONBLOCK, 0);
    ASSERT_EQ(pipe2(silent_.data(), O_CLOEXEC), 0);
    as_paho([this] { take_wake(); }).get();  // of an earlier test
  }
  void TearDown() override {
    note_connect_outcome(client_);
    for (const int fd : {listener_, client_, silent_[0], silent_[1]}) close(fd);
  }

  void begin_connect() {
    ASSERT_NE(connect(client_, reinterpret_cast<sockaddr*>(&address_), size_), 0);
    ASSERT_EQ(errno, EINPROGRESS);
  }
  /// Ends the early end of a wait that a new socket causes. Another end then has another cause.
  void take_wake() { ends_early(silent_[0], 1); }
  /// Returns true if a poll() for something to read ends before its timeout.
  static bool ends_early(int fd, int timeout_ms) {
    const auto began = Clock::now();
    pollfd asked{.fd = fd, .events = POLLIN, .revents = 0};
    EXPECT_EQ(poll(&asked, 1, timeout_ms), 0);
    EXPECT_EQ(asked.revents, 0);
    return Clock::now() - began < std::chrono::milliseconds(timeout_ms);
  }

  int listener_ = -1;
  int client_ = -1;
  std::array<int, 2> silent_{-1, -1};  ///< a pipe to which nobody writes
  sockaddr_in address_{};
  socklen_t size_ = sizeof address_;
};

TEST_F(ConnectNotice, SharedLibrariesFindTheProgramsOwn) {
  Dl_info program{};
  ASSERT_NE(dladdr(reinterpret_cast<void*>(&is_paho_thread), &program), 0);
  for (const char* name : {"connect", "poll"}) {
    Dl_info found{};
    ASSERT_NE(dladdr(dlsym(RTLD_DEFAULT, name), &found), 0);
    EXPECT_EQ(found.dli_fbase, program.dli_fbase) << name << ": " << found.dli_fname;
  }
}

TEST_F(ConnectNotice, WaitOfPahoEndsWhenItsSocketIsConnected) {
  EXPECT_TRUE(as_paho([this] {
                begin_connect();
                take_wake();
                return ends_early(client_, kPatienceMs);
              }).get());
}

TEST_F(ConnectNotice, WaitOfPahoEndsWhenAnotherOfItsThreadsMakesASocket) {
  auto early = as_paho([this] { return ends_early(silent_[0], kPatienceMs); });
  as_paho([this] { begin_connect(); }).get();
  EXPECT_TRUE(early.get());
}

TEST_F(ConnectNotice, WaitLastsOnceTheOutcomeIsKnown) {
  EXPECT_FALSE(as_paho([this] {
                 begin_connect();
                 take_wake();
                 EXPECT_TRUE(ends_early(client_, kPatienceMs));
                 note_connect_outcome(client_);
                 return ends_early(client_, 20);
               }).get());
}

TEST_F(ConnectNotice, SocketsOfOtherThreadsAreLeftAlone) {
  begin_connect();
  EXPECT_FALSE(ends_early(client_, 20));
  EXPECT_FALSE(as_paho([this] { return ends_early(client_, 20); }).get());
}

TEST_F(ConnectNotice, WhatPollFindsIsPassedOn) {
  as_paho([this] {
    begin_connect();
    take_wake();
    EXPECT_TRUE(ends_early(client_, kPatienceMs));
    EXPECT_EQ(write(silent_[1], "x", 1), 1);
    std::array<pollfd, 2> asked{{{.fd = silent_[0], .events = POLLIN, .revents = 0},
                                 {.fd = client_, .events = POLLOUT, .revents = 0}}};
    EXPECT_EQ(poll(asked.data(), asked.size(), kPatienceMs), 2);
    EXPECT_EQ(asked[0].revents, POLLIN);
    EXPECT_EQ(asked[0].events, POLLIN);
    EXPECT_EQ(asked[1].revents, POLLOUT);
  }).get();
}

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
  Clock::time_point now = Clock::time_point() + 1h;
  for (int round = 0; round < 10; ++round) EXPECT_TRUE(sleeps.leaves_out(now += 1s)) << round;
}

TEST(IdleSleeps, LoopThatWaitsNowhereElseKeepsAllButTheFirst) {
  IdleSleeps sleeps;
  Clock::time_point now = Clock::time_point() + 1h;
  EXPECT_TRUE(sleeps.leaves_out(now));
  for (int round = 0; round < 20; ++round) EXPECT_FALSE(sleeps.leaves_out(now += 101ms)) << round;
}

TEST(IdleSleeps, LoopThatNeverSleptIsStoppedAtTheSecondTurn) {
  IdleSleeps sleeps;
  Clock::time_point now = Clock::time_point() + 1h;
  int left_out = 0;
  for (int round = 0; round < 1000; ++round) left_out += sleeps.leaves_out(now += 1us) ? 1 : 0;
  EXPECT_EQ(left_out, 1);
}

TEST(IdleSleeps, LoopThatWaitsNowAndThenKeepsTheSleepBetween) {
  IdleSleeps sleeps;
  Clock::time_point now = Clock::time_point() + 1h;
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
    const auto began = Clock::now();
    EXPECT_TRUE(sleeps(static_cast<useconds_t>(wanted.count())));
    EXPECT_GE(Clock::now() - began, wanted);
  }
}

}  // namespace
}  // namespace fxagent
