#include "agent/history/consumer.h"

#include <poll.h>

#include <algorithm>
#include <utility>

#include "agent/failpoint.h"
#include "agent/log/log.h"

namespace fxagent::history {
namespace {

constexpr std::chrono::milliseconds kFirstPause{100};
constexpr std::chrono::milliseconds kLongestPause{5000};
constexpr std::chrono::milliseconds kIdle{1000};
constexpr std::chrono::hours kMaintenance{1};
constexpr std::chrono::minutes kMaintenanceRetry{1};
constexpr std::chrono::minutes kCounts{1};

}  // namespace

std::chrono::milliseconds Consumer::Backoff::next() {
  pause_ = std::clamp(pause_ * 2, kFirstPause, kLongestPause);
  return pause_;
}

Consumer::Consumer(const ConsumerConfig& config, int stop)
    : config_(config),
      stop_(stop),
      database_(config.database, config.commit, stop),
      subscriber_(config.subscriber, stop) {}

bool Consumer::stopped(std::chrono::milliseconds wait) const {
  pollfd waited{stop_, POLLIN, 0};
  return poll(&waited, 1, static_cast<int>(wait.count())) > 0;
}

void Consumer::run() {
  next_counts_ = Clock::now() + kCounts;
  while (!stopped(std::chrono::milliseconds(0))) {
    maintain();
    if (!is_connected()) continue;
    const std::vector<Message>& messages = subscriber_.receive(kIdle);
    if (!messages.empty()) {
      if (!store(messages)) break;
      failpoint("history.stored");
      subscriber_.acknowledge();
    }
    if (!was_subscribed_ && subscriber_.is_subscribed()) {
      was_subscribed_ = true;
      broker_health_ = {};
      log::info("subscribed", {{"host", config_.subscriber.host},
                               {"port", std::to_string(config_.subscriber.port)},
                               {"group", config_.subscriber.group}});
    }
    if (Clock::now() >= next_counts_) {
      next_counts_ = Clock::now() + kCounts;
      log_counts("counts");
    }
  }
  subscriber_.disconnect();
  log_counts("stopped");
}

/// Connects if there is no connection. Returns false after a failed attempt and its pause.
bool Consumer::is_connected() {
  if (subscriber_.is_connected()) return true;
  if (!subscriber_.fault().empty()) {
    broker_failed(subscriber_.fault());
    if (stopped(broker_health_.backoff.next())) return false;
  }
  was_subscribed_ = false;
  const std::string why = subscriber_.connect();
  if (why.empty()) return true;
  broker_failed(why);
  stopped(broker_health_.backoff.next());
  return false;
}

/// Commits `messages`, and tries until the database has them. Returns false if the stop came first.
bool Consumer::store(const std::vector<Message>& messages) {
  Batch batch(config_.subscriber.root);
  for (const Message& message : messages) batch.add(message);
  Put result;
  if (!put(batch, result)) return false;
  if (result.state == PutState::wrong_data) {
    if (messages.size() == 1) {
      Batch refused(config_.subscriber.root);
      refused.refuse(messages.front(), "the database refuses it: " + result.why);
      if (!put(refused, result)) return false;
      if (result.state == PutState::wrong_data)
        log::error("message_lost", {{"topic", log::excerpt(messages.front().topic)},
                                    {"why", result.why},
                                    {"do", "report this: a message could not even be refused"}});
      refused_ += refused.refused();
      ++messages_;
      return true;
    }
    // One message is to blame. Each of the others is stored.
    return std::ranges::all_of(messages,
                               [this](const Message& message) { return store({message}); });
  }
  messages_ += messages.size();
  ++batches_;
  stored_ += result.stored;
  repeated_ += result.repeated;
  refused_ += batch.refused();
  if (batch.refused() > 0)
    log::warn("messages_refused", {{"count", std::to_string(batch.refused())},
                                   {"do", "see the table history.refused"}});
  return true;
}

/// Puts a batch until the database is available. Returns false if the stop came first.
bool Consumer::put(const Batch& batch, Put& result) {
  const std::string text = batch.text();
  while (true) {
    result = database_.put(text);
    if (result.state != PutState::unavailable) {
      database_is_good();
      return true;
    }
    database_failed(result.why);
    if (stopped(database_health_.backoff.next())) return false;
  }
}

/// Makes and deletes partitions once an hour. A failure keeps no sample waiting: samples without a
/// partition go to samples_other.
void Consumer::maintain() {
  if (Clock::now() < next_maintenance_) return;
  const std::string why = database_.maintain(config_.keep_days);
  next_maintenance_ = Clock::now() + (why.empty() ? Clock::duration(kMaintenance)
                                                  : Clock::duration(kMaintenanceRetry));
  if (why.empty())
    database_is_good();
  else
    database_failed(why);
}

void Consumer::broker_failed(const std::string& why) {
  if (!std::exchange(broker_health_.is_good, false)) return;
  log::warn("broker_lost",
            {{"host", config_.subscriber.host},
             {"port", std::to_string(config_.subscriber.port)},
             {"why", why},
             {"do",
              "nothing if it comes back; else check --broker, the user and the broker's log. "
              "A second process with this --client-id takes the session over"}});
}

void Consumer::database_failed(const std::string& why) {
  if (!std::exchange(database_health_.is_good, false)) return;
  log::warn("database_lost",
            {{"why", why},
             {"do",
              "start the database, check --database, and run schema.sql; messages wait "
              "unacknowledged in the broker until then"}});
}

void Consumer::database_is_good() {
  database_health_.backoff.reset();
  if (!std::exchange(database_health_.is_good, true)) log::info("database_back");
}

void Consumer::log_counts(const char* event) const {
  log::info(event, {{"messages", std::to_string(messages_)},
                    {"commits", std::to_string(batches_)},
                    {"stored", std::to_string(stored_)},
                    {"repeated", std::to_string(repeated_)},
                    {"refused", std::to_string(refused_)}});
}

}  // namespace fxagent::history
