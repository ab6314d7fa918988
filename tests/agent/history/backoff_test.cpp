// Pauses between attempts, and the report of a silent subscription.
#include <gtest/gtest.h>

#include <chrono>

#include "agent/history/consumer.h"

namespace fxagent::history {
namespace {

using namespace std::chrono_literals;

const std::chrono::steady_clock::time_point kNow{1h};

TEST(HistoryBackoff, PauseDoublesUpToTheLongest) {
  Backoff backoff(100ms, 300ms);
  EXPECT_EQ(backoff.next(), 100ms);
  EXPECT_EQ(backoff.next(), 200ms);
  EXPECT_EQ(backoff.next(), 300ms);
  backoff.reset();
  EXPECT_EQ(backoff.next(), 100ms);
}

TEST(HistoryBackoff, ShortConnectionsPauseLongerEachTime) {
  BrokerBackoff backoff;
  for (const auto pause : {1s, 2s, 4s, 8s, 16s, 32s, 60s, 60s}) {
    backoff.subscribed(kNow);
    EXPECT_TRUE(backoff.is_short(kNow + 9s));
    EXPECT_EQ(backoff.next(kNow + 9s), pause);
  }
  backoff.subscribed(kNow);
  EXPECT_FALSE(backoff.is_short(kNow + 10s));
  EXPECT_EQ(backoff.next(kNow + 10s), 100ms);
  EXPECT_EQ(backoff.next(kNow + 11s), 200ms);  // an attempt without a connection
  backoff.subscribed(kNow);
  EXPECT_EQ(backoff.next(kNow + 1s), 1s);
}

TEST(HistorySilence, IsReportedOnceAMinuteAfterTheFirstSubscription) {
  Silence silence;
  EXPECT_FALSE(silence.is_over(kNow + 1h));
  silence.subscribed(kNow);
  silence.subscribed(kNow + 30s);
  EXPECT_FALSE(silence.is_over(kNow + 59s));
  EXPECT_TRUE(silence.is_over(kNow + 60s));
  EXPECT_FALSE(silence.is_over(kNow + 61s));
}

TEST(HistorySilence, MessageEndsIt) {
  Silence silence;
  silence.subscribed(kNow);
  silence.received();
  silence.subscribed(kNow + 1s);
  EXPECT_FALSE(silence.is_over(kNow + 1h));
}

}  // namespace
}  // namespace fxagent::history
