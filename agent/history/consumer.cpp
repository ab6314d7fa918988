#include "agent/history/consumer.h"

#include <poll.h>

#include <algorithm>
#include <optional>
#include <utility>

#include "agent/failpoint.h"
#include "agent/log/log.h"

namespace fxagent::history {
namespace {

constexpr std::chrono::milliseconds kIdle{1000};
constexpr std::chrono::milliseconds kNone{0};
constexpr std::chrono::hours kMaintenance{1};
constexpr std::chrono::minutes kMaintenanceRetry{1};
constexpr std::chrono::minutes kCounts{1};

void log_refused(const Batch& batch) {
  log::warn("messages_refused", {{"count", std::to_string(batch.refused())},
                                 {"topic", log::excerpt(batch.first_refused_topic())},
                                 {"why", batch.first_refused_reason()},
                                 {"do", "see the table history.refused"}});
}

}  // namespace

Consumer::Consumer(const ConsumerConfig& config, int stop)
    : config_(config),
      stop_(stop),
      database_(config.database, config.commit, stop, [this] { subscriber_.keep_alive(); }),
      subscriber_(config.subscriber, stop) {}

/// Waits for the stop. Keeps the connection to the broker alive, and takes no message from it.
bool Consumer::stopped(std::chrono::milliseconds wait) {
  const Clock::time_point end = Clock::now() + wait;
  while (true) {
    const auto left = std::chrono::ceil<std::chrono::milliseconds>(end - Clock::now());
    pollfd waited{stop_, POLLIN, 0};
    if (poll(&waited, 1, static_cast<int>(std::clamp(left, kNone, kIdle).count())) > 0) return true;
    subscriber_.keep_alive();
    if (left <= kIdle) return false;
  }
}

void Consumer::run() {
  next_counts_ = Clock::now() + kCounts;
  while (!stopped(kNone)) {
    maintain();
    if (!is_connected()) continue;
    const std::vector<Message>& messages = subscriber_.receive(kIdle);
    if (!messages.empty()) {
      silence_.received();
      if (!store(messages)) break;
      failpoint("history.stored");
      subscriber_.acknowledge();
    }
    if (!was_subscribed_ && subscriber_.is_subscribed() && subscriber_.is_connected()) {
      was_subscribed_ = true;
      broker_is_good_ = true;
      broker_backoff_.subscribed(Clock::now());
      silence_.subscribed(Clock::now());
      log_subscription();
    }
    if (silence_.is_over(Clock::now()))
      log::warn("no_message_yet",
                {{"root", config_.subscriber.root},
                 {"do", "check --root, and that the broker lets this user read below it"}});
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
    if (stopped(broker_backoff_.next(Clock::now()))) return false;
  }
  was_subscribed_ = false;
  const std::string why = subscriber_.connect();
  if (why.empty()) return true;
  broker_failed(why);
  stopped(broker_backoff_.next(Clock::now()));
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
      refused.refuse(messages.front(), "the database refuses it: " + result.fault.why);
      if (!put(refused, result)) return false;
      if (result.state == PutState::wrong_data)
        log::error("message_lost", {{"topic", log::excerpt(messages.front().topic)},
                                    {"why", result.fault.why},
                                    {"do", "report this: a message could not even be refused"}});
      else
        log_refused(refused);
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
  if (batch.refused() > 0) log_refused(batch);
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
    database_failed(result.fault);
    if (stopped(database_backoff_.next())) return false;
  }
}

/// Makes and deletes partitions once an hour. A failure keeps no sample waiting: samples without a
/// partition go to samples_other.
void Consumer::maintain() {
  if (Clock::now() < next_maintenance_) return;
  const std::optional<DatabaseFault> fault = database_.maintain(config_.keep_days);
  next_maintenance_ =
      Clock::now() + (fault ? Clock::duration(kMaintenanceRetry) : Clock::duration(kMaintenance));
  if (fault)
    database_failed(*fault);
  else
    database_is_good();
}

void Consumer::log_subscription() {
  const SubscriberConfig& config = config_.subscriber;
  const bool resumed = subscriber_.is_resumed();
  log::info("subscribed",
            {{"host", config.host},
             {"port", std::to_string(config.port)},
             {"root", config.root},
             {"client_id", config.client_id},
             {"group", config.group},
             {"session", resumed ? "resumed" : "new"},
             {"note", resumed ? "messages may have waited in the broker since the last connection"
                              : "the broker has no messages from before. If this client id ran "
                                "before, some may be lost: see history.gaps"}});
}

void Consumer::broker_failed(const std::string& why) {
  if (!std::exchange(broker_is_good_, false)) return;
  log::warn("broker_lost",
            {{"host", config_.subscriber.host},
             {"port", std::to_string(config_.subscriber.port)},
             {"why", why},
             {"do", broker_backoff_.is_short(Clock::now())
                        ? "end any other process with this --client-id; else see the broker's log"
                        : "nothing if it comes back; else check --broker, the user and the "
                          "broker's log"}});
}

/// Logs each cure once per outage.
void Consumer::database_failed(const DatabaseFault& fault) {
  if (std::exchange(database_cure_, fault.cure) == fault.cure) return;
  log::warn("database_lost",
            {{"why", fault.why},
             {"do", fault.cure},
             {"note", "what cannot be stored waits unacknowledged in the broker"}});
}

void Consumer::database_is_good() {
  database_backoff_.reset();
  if (!std::exchange(database_cure_, "").empty()) log::info("database_back");
}

void Consumer::log_counts(const char* event) const {
  log::info(event, {{"messages", std::to_string(messages_)},
                    {"commits", std::to_string(batches_)},
                    {"stored", std::to_string(stored_)},
                    {"repeated", std::to_string(repeated_)},
                    {"refused", std::to_string(refused_)}});
}

}  // namespace fxagent::history
