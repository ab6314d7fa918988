#include "agent/field/link/reconnect_policy.h"

#include <gtest/gtest.h>

#include <algorithm>

namespace fxagent::test {
namespace {

using std::chrono::milliseconds;
using std::chrono::nanoseconds;

constexpr ReconnectRules kRules{milliseconds(500), milliseconds(30000), milliseconds(200)};
constexpr std::uint32_t kLinks = 1000;

/// The largest number of these times within any one `window`.
std::size_t most_within(std::vector<nanoseconds> times, nanoseconds window) {
  std::sort(times.begin(), times.end());
  std::size_t most = 0;
  for (std::size_t first = 0, last = 0; last < times.size(); ++last) {
    while (times[last] - times[first] > window) ++first;
    most = std::max(most, last - first + 1);
  }
  return most;
}

TEST(ReconnectPolicy, PausesDoubleToTheirCapAndASuccessEndsThem) {
  ReconnectPolicy reconnect_policy(kRules, 1);
  for (int round = 0; round < 2; ++round) {
    for (const int plain : {500, 1000, 2000, 4000, 8000, 16000, 30000, 30000}) {
      const nanoseconds pause = reconnect_policy.after_failure();
      EXPECT_GE(pause, milliseconds(plain * 8 / 10));
      EXPECT_LE(pause, milliseconds(plain * 12 / 10));
    }
    reconnect_policy.opened();
  }
}

TEST(ReconnectPolicy, PauseMayHaveALeast) {
  ReconnectPolicy reconnect_policy(kRules, 1);
  EXPECT_GE(reconnect_policy.after_failure(milliseconds(1000)), milliseconds(800));
  EXPECT_GE(reconnect_policy.after_failure(milliseconds(1000)), milliseconds(1600)) << "it doubles";
  EXPECT_LE(reconnect_policy.after_failure(std::chrono::minutes(5)), milliseconds(36000));
}

TEST(ReconnectPolicy, AThousandLinksThatFailTogetherDoNotComeBackTogether) {
  std::vector<nanoseconds> times;
  for (std::uint32_t link = 0; link < kLinks; ++link)
    times.push_back(ReconnectPolicy(kRules, link).after_failure());
  // 400 to 600 ms: 50 links in 10 ms on average.
  EXPECT_LT(most_within(times, milliseconds(10)), 90U);
}

TEST(ReconnectPolicy, AThousandLinksThatAreLostTogetherDoNotComeBackTogether) {
  std::vector<nanoseconds> times;
  for (std::uint32_t link = 0; link < kLinks; ++link)
    times.push_back(ReconnectPolicy(kRules, link).after_loss());
  EXPECT_LE(*std::max_element(times.begin(), times.end()), milliseconds(200));
  EXPECT_LT(most_within(times, milliseconds(10)), 90U);
}

TEST(ReconnectPolicy, SerialPortIsTriedAgainAtOnce) {
  ReconnectPolicy reconnect_policy(ReconnectRules{}, 1);
  EXPECT_EQ(reconnect_policy.after_loss(), nanoseconds(0));
}

TEST(ReconnectPolicy, LinkThatIsAloneBeginsAtOnce) {
  const LinkStart start = ReconnectPolicy(kRules, 1).start(1, milliseconds(1000));
  EXPECT_EQ(start.open_after, nanoseconds(0));
  EXPECT_EQ(start.poll_after, nanoseconds(0));
}

TEST(ReconnectPolicy, StartsAreSpreadOverThePeriodAndNoLinkIsPolledBeforeItOpens) {
  std::vector<nanoseconds> polls;
  std::vector<nanoseconds> opens;
  for (std::uint32_t link = 0; link < kLinks; ++link) {
    const LinkStart start = ReconnectPolicy(kRules, link).start(kLinks, milliseconds(500));
    EXPECT_GE(start.poll_after, start.open_after);
    EXPECT_LE(start.poll_after, milliseconds(500));
    polls.push_back(start.poll_after);
    opens.push_back(start.open_after);
  }
  // 20 links in 10 ms on average.
  EXPECT_LT(most_within(polls, milliseconds(10)), 50U);
  EXPECT_LT(most_within(opens, milliseconds(10)), 50U);
}

}  // namespace
}  // namespace fxagent::test
