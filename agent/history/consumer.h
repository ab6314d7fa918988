// Carries samples from the broker to the database. One thread.
//
// Exactly once: a batch of messages is committed before the first of them is acknowledged, and a
// sample that arrives again is not stored again. So neither the end of this process, of the broker
// nor of the database loses or doubles a row.
#pragma once

#include <chrono>
#include <cstdint>
#include <string>
#include <vector>

#include "agent/history/backoff.h"
#include "agent/history/database.h"
#include "agent/history/subscriber.h"

namespace fxagent::history {

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
