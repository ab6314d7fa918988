// A publisher with its surroundings, and a clock that the test advances.
#pragma once

#include <gtest/gtest.h>

#include <future>
#include <nlohmann/json.hpp>

#include "agent/commands/commands.h"
#include "agent/commands/recovery.h"
#include "agent/uplink/payload/json_payload.h"
#include "agent/uplink/publisher.h"
#include "tests/agent/uplink/fake_broker.h"
#include "tests/agent/uplink/plant.h"
#include "tests/support/scratch.h"

namespace fxagent::test {

inline const std::string kBase = "fx/plant-a/edge7";
inline constexpr SteadyTime kStart{std::chrono::hours(1)};

using Seqs = std::vector<std::uint64_t>;

/// Returns the sequence numbers of live and history messages, in order.
inline Seqs seqs(const std::vector<std::string>& payloads) {
  Seqs found;
  for (const std::string& payload : payloads) {
    const nlohmann::json parsed = nlohmann::json::parse(payload);
    if (parsed.contains("rows"))
      for (const nlohmann::json& row : parsed["rows"]) found.push_back(row["seq"]);
    else
      found.push_back(parsed["seq"]);
  }
  return found;
}

struct PublisherBench {
  Config config = plant();
  Outbox outbox{1000};
  FakeBroker broker;
  std::vector<AdmittedCommand> admitted;  ///< commands given to the field
  std::vector<Seqs> found_late;
  SteadyTime now = kStart;
  /// The first number of the seed 1 would be 0: a reconnect without a pause.
  PublisherSettings settings{.boot = "9f3c21aa", .version = "0.1.0", .jitter_seed = 1'000'003};
  std::unique_ptr<Store> store;  ///< null: no store
  std::unique_ptr<GuardedStore> guarded;
  std::unique_ptr<JsonPayload> format;
  std::unique_ptr<Commands> commands;
  std::unique_ptr<Publisher> publisher;

  /// With a store in this directory, opened at the first step.
  explicit PublisherBench(const std::string& directory = {}) { config.store.path = directory; }
  Publisher& made() {
    if (!publisher && !config.store.path.empty()) open_store();
    if (!format) format = std::make_unique<JsonPayload>(config, settings.boot, settings.version);
    if (!publisher) {
      commands = std::make_unique<Commands>(
          config,
          [this](AdmittedCommand a) {
            if (on_admitted) on_admitted(a);
            // The command is sent at once, unless its mark hangs.
            if (a.starts != nullptr && !a.interrupted) {
              const auto marked = std::make_shared<std::promise<void>>();
              a.starts->mark(a.command.number, [marked](bool) { marked->set_value(); });
              marked->get_future().wait_for(a.starts->patience());
            }
            admitted.push_back(std::move(a));
          },
          guarded ? &guarded->journal() : nullptr);
      if (guarded) commands->restore(recover(config, guarded->journal(), utc(), now), now, utc());
      settings.number_above = [this](Seqs numbers) { found_late.push_back(std::move(numbers)); };
      publisher = std::make_unique<Publisher>(
          config, settings, *format, outbox, broker, *commands, [this] { return utc(); },
          guarded.get());
    }
    return *publisher;
  }
  void open_store() {
    store = std::make_unique<Store>(config.store, utc());
    guarded = std::make_unique<GuardedStore>(*store, [this] { outbox.notify(); });
    guarded->set_patience(std::chrono::hours(1));  // a loaded machine is not a hung disk
  }
  std::int64_t utc() const {
    return 1790000000000 + now.time_since_epoch() / std::chrono::milliseconds(1);
  }
  SteadyTime step() {
    const SteadyTime wake = made().step(now);
    EXPECT_TRUE(publisher->samples().balanced());
    return wake;
  }
  /// Runs steps until nothing changes any more at this time.
  void settle() {
    for (int i = 0; i < 200; ++i) step();
  }
  /// The field has something to tell: a sample, a device's state, its counters, a result.
  void report(auto message) {
    outbox.push(std::move(message));
    settle();
  }
  /// The field has made the samples `first` to `last`.
  void take_samples(std::uint64_t first, std::uint64_t last) {
    for (std::uint64_t seq = first; seq <= last; ++seq) outbox.push(sample(seq));
    settle();
  }
  void take_samples(std::uint64_t seq) { take_samples(seq, seq); }
  void acknowledge_all() {
    broker.acknowledge_all();
    settle();
  }
  void lose_connection() {
    broker.lose();
    settle();
  }
  void advance(SteadyTime::duration by) {
    now += by;
    settle();
  }
  /// Stops, and steps when something has happened or is due, at most `most` times. Fails if a step
  /// is due at once again.
  void stop_without_spinning(int most) {
    made().stop(now);
    for (int i = 0; i < most; ++i) {
      settle();
      const SteadyTime wake = step();
      if (made().finished()) break;
      ASSERT_GT(wake, now);
      now = wake;
    }
    EXPECT_TRUE(made().finished());
  }
  /// Connects and stays connected long enough for the server to count as good.
  void online() {
    settle();
    advance(std::chrono::seconds(20));
    ASSERT_TRUE(broker.up());
    broker.log.clear();
    broker.taken.clear();
    broker.order.clear();
  }
  void command(const std::string& payload, const std::string& topic = kBase + "/press1/command") {
    Message message = message_on(topic, payload);
    message.received = now;
    message.received_ms = 1790000000500;
    message.response_topic = response_topic;
    message.correlation = correlation;
    broker.send(std::move(message));
    step();
  }
  /// Delivers a command that is admitted.
  void write(const std::string& id) {
    command(R"({"id":")" + id + R"(","op":"write","tag":"setpoint","value":50})");
  }
  /// Returns the field's result of an admitted command, or a similar one for a command that was not
  /// admitted.
  CommandResult succeeded(const std::string& id) const {
    CommandResult result = test::succeeded(id);
    for (const AdmittedCommand& each : admitted)
      if (each.command.id == id) {
        result.number = each.command.number;
        result.received = each.command.received;
        result.received_ms = each.command.received_ms;
        result.response_topic = each.command.response_topic;
        result.correlation = each.command.correlation;
      }
    return result;
  }
  /// Returns the numbers of the samples of a device's group "fast", as they were published.
  Seqs live(const std::string& device = "press1") const {
    return seqs(broker.on(kBase + "/" + device + "/data/fast"));
  }
  Seqs history(const std::string& device = "press1") const {
    return seqs(broker.on(kBase + "/" + device + "/data/fast/history"));
  }
  /// Returns the last message on a topic below kBase; null: none.
  nlohmann::json last(const std::string& topic) const {
    const auto all = broker.on(kBase + topic);
    return all.empty() ? nlohmann::json() : nlohmann::json::parse(all.back());
  }
  std::vector<nlohmann::json> results() const {
    std::vector<nlohmann::json> found;
    for (const std::string& text : broker.on(kBase + "/press1/result"))
      found.push_back(nlohmann::json::parse(text));
    return found;
  }

  std::function<void(const AdmittedCommand&)> on_admitted;
  std::string response_topic;  ///< for later commands
  Bytes correlation;
};

/// A test on a bench of its own; OnBenchOnline: with the publisher connected.
class OnBench : public ::testing::Test {
 protected:
  PublisherBench bench;
};
class OnBenchOnline : public OnBench {
 protected:
  OnBenchOnline() { bench.online(); }
};

/// The same with a store.
class OnStoredBench : public ::testing::Test {
 protected:
  const Scratch scratch;
  PublisherBench bench{scratch.path("store")};
};
class OnStoredBenchOnline : public OnStoredBench {
 protected:
  OnStoredBenchOnline() { bench.online(); }
};

}  // namespace fxagent::test
