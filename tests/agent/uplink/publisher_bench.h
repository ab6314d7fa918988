// A publisher with everything around it, and a clock that the test moves.
#pragma once

#include <gtest/gtest.h>

#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

#include "agent/uplink/publisher.h"
#include "tests/agent/store/scratch.h"
#include "tests/agent/uplink/fake_broker.h"
#include "tests/agent/uplink/plant.h"

namespace fxagent::test {

inline const std::string kBase = "fx/plant-a/edge7";
inline constexpr SteadyTime kStart{std::chrono::hours(1)};

struct PublisherBench {
  Config config = plant();
  Outbox outbox{1000};
  FakeBroker broker;
  std::vector<Command> commands;
  std::vector<std::string> go_aheads;
  std::vector<RestoredState> found_late;
  SteadyTime now = kStart;
  PublisherSettings settings{.boot = "9f3c21aa", .version = "0.1.0"};
  std::unique_ptr<Store> store;  ///< null: none
  std::unique_ptr<Publisher> publisher;

  /// With a store in this directory, opened at the first step.
  explicit PublisherBench(const std::string& directory = {}) { config.store.path = directory; }
  Publisher& made() {
    if (!publisher && !config.store.path.empty())
      store = std::make_unique<Store>(config.store, utc());
    if (!publisher)
      publisher = std::make_unique<Publisher>(
          config, settings, outbox, broker, [this](Command c) { commands.push_back(std::move(c)); },
          [this] { return utc(); }, store.get(),
          [this](std::uint32_t device, std::string id) {
            go_aheads.push_back(std::to_string(device) + id);
          },
          [this](RestoredState found) { found_late.push_back(std::move(found)); });
    return *publisher;
  }
  std::int64_t utc() const {
    return 1790000000000 + now.time_since_epoch() / std::chrono::milliseconds(1);
  }
  SteadyTime step() {
    const SteadyTime wake = made().step(now);
    EXPECT_TRUE(publisher->samples().balanced());
    return wake;
  }
  /// Steps until nothing moves any more at this time.
  void settle() {
    for (int i = 0; i < 200; ++i) step();
  }
  void advance(SteadyTime::duration by) {
    now += by;
    settle();
  }
  /// Connected for so long that the server counts as a good one.
  void online() {
    settle();
    advance(std::chrono::seconds(20));
    ASSERT_TRUE(broker.up());
    broker.log.clear();
    broker.taken.clear();
    broker.order.clear();
  }
  void command(const std::string& payload, const std::string& topic = kBase + "/press1/command") {
    Message message;
    message.topic = topic;
    message.payload = payload;
    message.received = now;
    message.received_ms = 1790000000500;
    broker.send(std::move(message));
    step();
  }
};

/// The numbers of live and history messages, in their order.
inline std::vector<std::uint64_t> seqs(const std::vector<std::string>& payloads) {
  std::vector<std::uint64_t> found;
  for (const std::string& payload : payloads) {
    const nlohmann::json parsed = nlohmann::json::parse(payload);
    if (parsed.contains("rows"))
      for (const nlohmann::json& row : parsed["rows"]) found.push_back(row["seq"]);
    else
      found.push_back(parsed["seq"]);
  }
  return found;
}

}  // namespace fxagent::test
