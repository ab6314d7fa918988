#include "agent/process/service_reports.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <mutex>
#include <thread>

#include "tests/support/notify_inbox.h"

namespace fxagent {
namespace {

using namespace std::chrono_literals;
using test::Inbox;
using test::Variable;
using Texts = std::vector<std::string>;

constexpr ServiceReports::Time kStart{1h};

/// An agent whose two threads respond while `field` and `uplink` are true.
struct ServiceReportsTest : ::testing::Test {
  ServiceReportsTest() {
    ::unsetenv("WATCHDOG_USEC");  // of the environment of the test run
    ::unsetenv("WATCHDOG_PID");
  }
  void watch() { within_ = std::make_unique<Variable>("WATCHDOG_USEC", "60000000"); }
  void begin() {
    reports_ = std::make_unique<ServiceReports>(
        signs_, ServiceReports::Sources{[this] { ask(); }, [this] { return status; }}, kStart);
  }
  /// Runs everything due until then and returns the messages sent.
  Texts told_until(std::chrono::seconds after_start) {
    Texts told;
    while (reports_->next() <= kStart + after_start) {
      reports_->keep(reports_->next());
      for (const std::string& text : inbox_.all()) told.push_back(text);
    }
    return told;
  }
  const ServiceReports& reports() const { return *reports_; }

  bool field = true;
  bool uplink = true;
  std::string status = "all is well";

 private:
  void ask() {
    if (field) signs_.field_went_on();
    if (uplink) signs_.uplink_went_on();
  }

  Inbox inbox_;
  Variable socket_{"NOTIFY_SOCKET", inbox_.name()};
  std::unique_ptr<Variable> within_;
  Heartbeats signs_;
  std::unique_ptr<ServiceReports> reports_;
};

std::size_t fed(const Texts& told) {
  return static_cast<std::size_t>(std::ranges::count(told, std::string("WATCHDOG=1")));
}

TEST_F(ServiceReportsTest, StatusIsToldAtOnceThenWhereItIsAnotherOneEveryTenSeconds) {
  begin();
  EXPECT_EQ(told_until(9s), Texts{"STATUS=all is well"});
  EXPECT_EQ(told_until(29s), Texts{});
  status = "line1 down";
  EXPECT_EQ(told_until(30s), Texts{"STATUS=line1 down"});
  status = "line2 down";
  EXPECT_EQ(told_until(39s), Texts{});
  EXPECT_EQ(told_until(40s), Texts{"STATUS=line2 down"});
  // A reload has sent its own status in between.
  EXPECT_EQ(told_until(99s), Texts{});
  EXPECT_EQ(told_until(100s), Texts{"STATUS=line2 down"});
  status = "";  // unknown
  EXPECT_EQ(told_until(190s), Texts{});
}

TEST_F(ServiceReportsTest, WatchdogIsFedFourTimesInItsTime) {
  watch();
  begin();
  EXPECT_EQ(fed(told_until(60s)), 4U);
}

TEST_F(ServiceReportsTest, AThreadThatStandsStillFeedsNobodyAndIsNamed) {
  watch();
  for (bool* stuck : {&field, &uplink}) {
    begin();
    EXPECT_EQ(fed(told_until(60s)), 4U);
    *stuck = false;
    // A response from before the thread stopped counts once more.
    EXPECT_LE(fed(told_until(75s)), 1U);
    Texts told = told_until(300s);
    EXPECT_EQ(fed(told), 0U);
    EXPECT_LE(told.size(), 5U) << "once a minute";
    told.erase(std::ranges::unique(told).begin(), told.end());
    EXPECT_EQ(told, Texts{std::string("STATUS=") + (stuck == &field ? "field" : "uplink") +
                          " hangs: systemd must restart the agent"});
    *stuck = true;
    const Texts after = told_until(420s);
    EXPECT_GE(fed(after), 6U) << "it goes on again";
    EXPECT_GE(std::ranges::count(after, "STATUS=all is well"), 1);
  }
}

TEST_F(ServiceReportsTest, AWatchdogWithoutASocketIsFedNowhereAndNobodyIsTold) {
  ::unsetenv("NOTIFY_SOCKET");
  begin();
  EXPECT_EQ(reports().next(), ServiceReports::Time::max());
}

// With real threads: a thread that hangs in a call cannot respond.
TEST(ServiceReports, ARealThreadThatHangsFeedsNobody) {
  Inbox inbox;
  const Variable socket("NOTIFY_SOCKET", inbox.name());
  const Variable within("WATCHDOG_USEC", "60000000");
  Heartbeats signs;
  std::mutex may_go;
  std::atomic<bool> over = false;
  std::atomic<std::uint64_t> rounds = 0;
  const std::jthread uplink([&] {
    while (!over) {
      const std::lock_guard lock(may_go);
      signs.uplink_went_on();
      ++rounds;
    }
  });
  const auto wait_for_a_round = [&] {
    for (const std::uint64_t before = rounds; rounds < before + 2;) std::this_thread::yield();
  };
  ServiceReports reports(signs, {[&] { signs.field_went_on(); }, [] { return std::string(); }},
                         kStart);
  wait_for_a_round();
  reports.keep(kStart + 15s);
  EXPECT_EQ(fed(inbox.all()), 1U);
  {
    const std::lock_guard hanging(may_go);
    reports.keep(kStart + 30s);  // for progress made earlier
    inbox.all();
    reports.keep(kStart + 45s);
    reports.keep(kStart + 60s);
    EXPECT_EQ(fed(inbox.all()), 0U);
  }
  wait_for_a_round();
  reports.keep(kStart + 75s);
  EXPECT_EQ(fed(inbox.all()), 1U);
  over = true;
}

}  // namespace
}  // namespace fxagent
