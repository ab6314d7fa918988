// Carries samples from the broker to the database. One thread.
//
// Exactly once: a batch of messages is committed before the first of them is acknowledged, and a
// sample that arrives again is not stored again. So an end of this process, of the broker or of the
// database neither loses nor doubles a row. Two exceptions: with SynchronousCommit::off a crash of
// the database's server may lose rows, and a broker that does not keep its sessions on disk loses
// what waits in them.
#pragma once

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "agent/history/database.h"
#include "agent/history/subscriber.h"
#include "agent/steady_time.h"

namespace fxagent::history {

/// A pause between attempts that doubles from `first` to `most`. Pure.
class Backoff final {
 public:
  Backoff(std::chrono::milliseconds first, std::chrono::milliseconds most)
      : first_(first), most_(most) {}

  std::chrono::milliseconds next() { return pause_ = std::clamp(pause_ * 2, first_, most_); }
  void reset() { pause_ = {}; }

 private:
  std::chrono::milliseconds first_;
  std::chrono::milliseconds most_;
  std::chrono::milliseconds pause_{0};
};

/// Pauses between connections to the broker. After a subscription of less than 10 s they grow from
/// 1 s to 60 s: two processes with one client id end each other's connection at once.
class BrokerBackoff final {
 public:
  void subscribed(SteadyTime now) {
    subscribed_at_ = now;
    attempts_.reset();
  }
  /// True if the last connection was subscribed, and for less than 10 s.
  bool is_short(SteadyTime now) const {
    return subscribed_at_ && now - *subscribed_at_ < std::chrono::seconds(10);
  }
  /// Returns the pause after a lost connection or a failed attempt.
  std::chrono::milliseconds next(SteadyTime now) {
    if (!subscribed_at_) return attempts_.next();
    const bool was_short = is_short(now);
    subscribed_at_.reset();
    if (was_short) return short_ones_.next();
    short_ones_.reset();
    return attempts_.next();
  }

 private:
  std::optional<SteadyTime> subscribed_at_;
  Backoff attempts_{std::chrono::milliseconds(100), std::chrono::seconds(5)};
  Backoff short_ones_{std::chrono::seconds(1), std::chrono::seconds(60)};
};

/// Detects that no message arrives within a minute of the first subscription. Pure.
class Silence final {
 public:
  void subscribed(SteadyTime now) {
    if (!end_) end_ = now + std::chrono::minutes(1);
  }
  void received() { end_ = SteadyTime::max(); }
  /// Returns true once.
  bool is_over(SteadyTime now) {
    if (!end_ || now < *end_) return false;
    end_ = SteadyTime::max();
    return true;
  }

 private:
  std::optional<SteadyTime> end_;  ///< max(): no longer of interest
};

struct ConsumerConfig {
  SubscriberConfig subscriber;
  std::string database;  ///< conninfo string or URI of libpq
  SynchronousCommit commit = SynchronousCommit::on;
  int keep_days = 0;  ///< older samples are deleted; 0: none
};

class Consumer final {
 public:
  /// Ends when `stop` is readable. Throws std::runtime_error as Subscriber does.
  Consumer(const ConsumerConfig& config, int stop);

  /// Runs until the stop. Stores what has arrived by then, if the database is there.
  void run();

 private:
  using Clock = std::chrono::steady_clock;

  bool stopped(std::chrono::milliseconds wait);
  bool is_connected();
  void log_subscription();
  bool store(const std::vector<Message>& messages);
  bool put(const Batch& batch, Put& result);
  void maintain();
  void broker_failed(const std::string& why);
  void database_failed(const DatabaseFault& fault);
  void database_is_good();
  void log_counts(const char* event) const;

  const ConsumerConfig config_;
  const int stop_;
  Database database_;
  Subscriber subscriber_;
  bool broker_is_good_ = true;
  BrokerBackoff broker_backoff_;
  Silence silence_;
  /// Cure of the last failure that was logged. Empty if the database is good.
  std::string database_cure_;
  Backoff database_backoff_{std::chrono::milliseconds(100), std::chrono::seconds(5)};
  bool was_subscribed_ = false;
  Clock::time_point next_maintenance_{};
  Clock::time_point next_counts_{};
  std::uint64_t messages_ = 0;
  std::uint64_t batches_ = 0;
  std::uint64_t stored_ = 0;
  std::uint64_t repeated_ = 0;
  std::uint64_t refused_ = 0;
};

}  // namespace fxagent::history
