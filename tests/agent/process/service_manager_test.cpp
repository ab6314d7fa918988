#include "agent/process/service_manager.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <chrono>
#include <cstdlib>
#include <ctime>
#include <future>

#include "tests/support/notify_inbox.h"

namespace fxagent {
namespace {

using test::Inbox;
using test::Variable;

TEST(ServiceManager, IsToldOnItsSocket) {
  Inbox inbox;
  const Variable socket("NOTIFY_SOCKET", inbox.name());
  service_manager::notify_ready();
  service_manager::notify_alive();
  service_manager::notify_stopping();
  EXPECT_EQ(inbox.next(), "READY=1");
  EXPECT_EQ(inbox.next(), "WATCHDOG=1");
  EXPECT_EQ(inbox.next(), "STOPPING=1");
  EXPECT_EQ(inbox.next(), "");
}

TEST(ServiceManager, IsToldByPathAndByAbstractNameOfUpTo107Bytes) {
  const std::string directory = "/tmp/fxagent-" + std::to_string(::getpid()) + "-";
  for (const std::string& begin : {directory, "@" + directory}) {
    for (const std::size_t length : {std::size_t{60}, std::size_t{107}}) {
      Inbox inbox(begin + std::string(length - begin.size(), 'n'));
      const Variable socket("NOTIFY_SOCKET", inbox.name());
      EXPECT_TRUE(service_manager::is_there());
      service_manager::notify_ready();
      EXPECT_EQ(inbox.next(), "READY=1") << inbox.name().size() << " bytes";
    }
    // The kernel would accept it; systemd's own library does not.
    Inbox inbox(begin + std::string(108 - begin.size(), 'n'));
    const Variable socket("NOTIFY_SOCKET", inbox.name());
    service_manager::notify_ready();
    EXPECT_EQ(inbox.next(), "");
  }
}

TEST(ServiceManager, AReloadIsToldWithTheTime) {
  Inbox inbox;
  const Variable socket("NOTIFY_SOCKET", inbox.name());
  const auto monotonic_us = [] {
    timespec now{};
    ::clock_gettime(CLOCK_MONOTONIC, &now);
    return now.tv_sec * 1'000'000 + now.tv_nsec / 1000;
  };
  const auto before = monotonic_us();
  service_manager::notify_reloading();
  const auto after = monotonic_us();
  const std::string told = inbox.next();
  const std::string begin = "RELOADING=1\nMONOTONIC_USEC=";
  ASSERT_TRUE(told.starts_with(begin)) << told;
  const auto at = std::stoll(told.substr(begin.size()));
  EXPECT_LE(before, at);
  EXPECT_GE(after, at);
}

TEST(ServiceManager, AStatusIsOneLineOfWholeCharacters) {
  Inbox inbox;
  const Variable socket("NOTIFY_SOCKET", inbox.name());
  service_manager::notify_status("2 of 3 links up; 21 °C");
  EXPECT_EQ(inbox.next(), "STATUS=2 of 3 links up; 21 °C");
  service_manager::notify_status("up\nREADY=1\r\t\x7F.");
  EXPECT_EQ(inbox.next(), "STATUS=up READY=1   .");
  const std::string most(service_manager::kMostStatusBytes, 'x');
  service_manager::notify_status(most);
  EXPECT_EQ(inbox.next(), "STATUS=" + most);
  service_manager::notify_status(most + "y");
  EXPECT_EQ(inbox.next(), "STATUS=" + most);
  service_manager::notify_status(most.substr(1) + "°C");
  EXPECT_EQ(inbox.next(), "STATUS=" + most.substr(1));
}

/// A manager that does not read must block neither the stop nor the thread that feeds the watchdog.
TEST(ServiceManager, AFullSocketHoldsNobody) {
  Inbox inbox;
  const Variable socket("NOTIFY_SOCKET", inbox.name());
  std::size_t filled = 0;
  for (; filled < 100'000 && inbox.put("STATUS=x"); ++filled) {
  }
  ASSERT_GT(filled, 0u);
  ASSERT_LT(filled, 100'000u);
  auto told = std::async(std::launch::async, [] {
    service_manager::notify_status("up");
    service_manager::notify_alive();
    service_manager::notify_stopping();
    service_manager::notify_status("stopped");
  });
  const bool came_back = told.wait_for(std::chrono::seconds(30)) == std::future_status::ready;
  EXPECT_EQ(inbox.all().size(), filled);
  EXPECT_TRUE(came_back);
}

TEST(ServiceManager, WithoutASocketNothingHappens) {
  ::unsetenv("NOTIFY_SOCKET");  // of the environment of the test run
  EXPECT_FALSE(service_manager::is_there());

  for (const std::string& name : {std::string(), std::string("relative"), std::string("/no/such"),
                                  std::string("@"), "/" + std::string(300, 'x')}) {
    const Variable socket("NOTIFY_SOCKET", name);
    service_manager::notify_ready();
  }
}

TEST(ServiceManager, WatchdogIsFedFourTimesInItsTime) {
  ::unsetenv("WATCHDOG_USEC");  // of the environment of the test run
  ::unsetenv("WATCHDOG_PID");
  EXPECT_EQ(service_manager::watchdog_interval(), std::nullopt);
  const Variable within("WATCHDOG_USEC", "1200000");
  EXPECT_EQ(service_manager::watchdog_interval(), std::chrono::milliseconds(300));
  const Variable ours("WATCHDOG_PID", std::to_string(::getpid()));
  EXPECT_EQ(service_manager::watchdog_interval(), std::chrono::milliseconds(300));
}

TEST(ServiceManager, WatchdogOfAnotherProcessOrWithoutATimeIsNone) {
  for (const std::string within : {"0", "", "-1", "12s", "18446744073709551615"}) {
    const Variable time("WATCHDOG_USEC", within);
    EXPECT_EQ(service_manager::watchdog_interval(), std::nullopt) << within;
  }
  const Variable within("WATCHDOG_USEC", "1200000");
  const Variable other("WATCHDOG_PID", "1");
  EXPECT_EQ(service_manager::watchdog_interval(), std::nullopt);
}

}  // namespace
}  // namespace fxagent
