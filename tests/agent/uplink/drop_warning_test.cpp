// The log names the limit at which samples are lost, once, and the end of the loss.
#include "agent/uplink/drop_warning.h"

#include <gtest/gtest.h>

#include <functional>
#include <sstream>

#include "tests/agent/uplink/publisher_bench.h"
#include "tests/support/says.h"

namespace fxagent {
namespace {

using namespace std::chrono_literals;

struct DropWarningTest : testing::Test {
  DropWarningTest() { bench.broker.reachable = false; }

  /// Takes samples and returns the log's lines about lost ones, without their times.
  std::string log_of_samples(std::uint64_t count) {
    const std::uint64_t first = std::exchange(seq_, seq_ + count) + 1;
    return log_of([&] { bench.take_samples(first, seq_); });
  }
  std::string log_of_time(SteadyTime::duration time) {
    return log_of([&] { bench.advance(time); });
  }

  test::Scratch scratch;
  test::PublisherBench bench;

 private:
  static std::string log_of(const std::function<void()>& act) {
    testing::internal::CaptureStderr();
    act();
    std::istringstream lines(testing::internal::GetCapturedStderr());
    std::string found;
    for (std::string line; std::getline(lines, line);)
      if (line.find(" samples_dropped ") != line.npos)
        found += line.substr(line.find(' ') + 1) + "\n";
    return found;
  }

  std::uint64_t seq_ = 0;
};

TEST_F(DropWarningTest, FullStoreIsNamedWithItsLimitTheBrokerAndTheRemedy) {
  bench.config.store.path = scratch.path("store");
  bench.config.store.max_bytes = 3000;
  EXPECT_EQ(log_of_samples(5), "");
  EXPECT_EQ(log_of_time(1s), "");
  EXPECT_EQ(log_of_samples(20), "") << "gathered for one commit";
  const std::string begun = log_of_time(1s);
  EXPECT_TRUE(begun.starts_with("warning samples_dropped count=")) << begun;
  test::expect_says(begun, "reason=\"the store is full: store.max_bytes is 3000;");
  test::expect_says(begun, "has not been connected since the start");
  test::expect_says(begun, "raise store.max_bytes");
}

TEST_F(DropWarningTest, LossIsReportedOncePerDayAndItsEndWithTheTotal) {
  bench.settings.backlog_bytes = 3000;
  bench.broker.reachable = true;
  bench.online();
  bench.lose_connection();
  bench.broker.reachable = false;
  const std::string begun = log_of_samples(50);
  test::expect_says(begun, "reason=\"the memory for samples that wait is full: 3000 bytes\"");
  test::expect_says(begun, "has not been connected for 0 s");
  test::expect_says(begun, "set store.path");
  EXPECT_EQ(log_of_samples(50), "");
  EXPECT_EQ(log_of_time(24h), "") << "nothing was lost in this time";
  const std::string next_day = log_of_samples(50);
  EXPECT_TRUE(next_day.starts_with("warning samples_dropped count=")) << next_day;
  bench.broker.reachable = true;
  EXPECT_EQ(log_of_time(9min), "");
  const std::string ended = log_of_time(2min);
  EXPECT_TRUE(ended.starts_with("info samples_dropped state=ended count=" +
                                std::to_string(bench.made().samples().dropped) + " "))
      << ended;
  test::expect_says(ended, "is connected");
}

TEST_F(DropWarningTest, StoreThatIsTooOldIsNamedWithItsLimit) {
  bench.config.store.path = scratch.path("store");
  bench.config.store.max_age = 1h;
  EXPECT_EQ(log_of_samples(5), "");
  EXPECT_EQ(log_of_time(1s), "");
  const std::string begun = log_of_time(2h);
  test::expect_says(begun,
                    "count=5 reason=\"samples in the store are older than store.max_age_h\"");
}

}  // namespace
}  // namespace fxagent
