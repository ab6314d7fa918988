// A config change in the uplink: the messages it causes; nothing is lost or published twice.
#include <gtest/gtest.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "tests/agent/uplink/publisher_bench.h"

namespace fxagent {
namespace {

using nlohmann::json;
using test::kBase;
using test::Seqs;
using namespace std::chrono_literals;

struct PublisherChange : ::testing::Test, test::PublisherBench {
  /// Applies a change as agent/reload.cpp does, with a field that ends at once. The field's last
  /// output is already in the outbox.
  std::vector<std::uint64_t> change_to(Config wanted) {
    const ConfigChange change = change_between(config, std::move(wanted));
    std::vector<std::uint64_t> numbers;
    outbox.post([&](SteadyTime) { made().begin_change(change); });
    step();
    outbox.post([&](SteadyTime at) { numbers = made().change(change, at).value(); });
    step();
    return numbers;
  }
  Config without_press1() const {
    Config wanted = config;
    wanted.devices = {config.devices[1]};
    return wanted;
  }
  void change_broker() {
    Config wanted = config;
    wanted.mqtt.servers = {"mqtt://three:1883"};
    change_to(std::move(wanted));
  }
  bool is_cleared(const std::string& topic) const {
    const auto said = broker.on(topic);
    return !said.empty() && said.back().empty();
  }
};

struct PublisherChangeOnline : PublisherChange {
  PublisherChangeOnline() { online(); }
};

TEST_F(PublisherChangeOnline, TopicsOfADeviceThatIsGoneAreClearedAndTheOthersLeftAlone) {
  outbox.push(test::offline(0, "timeout"));
  settle();
  broker.log.clear();
  change_to(without_press1());
  settle();
  EXPECT_TRUE(is_cleared(kBase + "/press1/state"));
  EXPECT_TRUE(is_cleared(kBase + "/press1/meta"));
  EXPECT_TRUE(broker.on(kBase + "/press2/meta").empty()) << "nothing of it has changed";
  command(R"({"id":"a","op":"read","tag":"temp"})");
  settle();
  EXPECT_EQ(results().at(0)["reason"], "unknown_device");
}

TEST_F(PublisherChangeOnline, DeviceThatComesBackBeforeItsTopicsWereClearedKeepsThem) {
  const Config both = config;
  broker.acknowledges = false;
  broker.receive_maximum = 4;
  lose_connection();
  advance(20s);  // a window of four, all in use
  ASSERT_TRUE(broker.up());
  change_to(without_press1());
  change_to(both);
  outbox.push(test::offline(0, "timeout"));
  broker.acknowledges = true;
  for (int i = 0; i < 100; ++i) {
    broker.acknowledge_all();
    step();
  }
  EXPECT_FALSE(is_cleared(kBase + "/press1/state"));
  EXPECT_FALSE(is_cleared(kBase + "/press1/meta"));
}

TEST_F(PublisherChangeOnline, ChangedDeviceHasItsNewMetaAndNoStateUntilTheFieldTellsOne) {
  outbox.push(test::offline(0, "timeout"));
  settle();
  broker.log.clear();
  Config wanted = config;
  wanted.devices[0].tags[test::temp].point.scale = 0.5;
  change_to(std::move(wanted));
  settle();
  ASSERT_EQ(broker.on(kBase + "/press1/meta").size(), 1U);
  const json meta = json::parse(broker.on(kBase + "/press1/meta")[0]);
  EXPECT_EQ(meta["tags"]["temp"]["scale"], 0.5);
  EXPECT_TRUE(broker.on(kBase + "/press1/state").empty());
  take_samples(5);
  const json sample = json::parse(broker.on(kBase + "/press1/data/fast").at(0));
  EXPECT_EQ(sample["meta"], meta["hash"]);
}

TEST_F(PublisherChangeOnline, SamplesFromBeforeAreThoseOfTheOldDevice) {
  const std::string old_hash = fxagent::json::device_meta(std::as_const(config).devices[0]).hash;
  Config wanted = config;
  wanted.devices[0].tags[test::temp] = test::tag("heat", "D100", DataType::int16);
  outbox.push(test::sample(5));
  outbox.push(test::succeeded("unasked"));
  change_to(std::move(wanted));
  settle();
  const json sample = json::parse(broker.on(kBase + "/press1/data/fast").at(0));
  EXPECT_EQ(sample["meta"], old_hash);
  EXPECT_TRUE(sample["values"].contains("temp"));
  EXPECT_EQ(results().size(), 1U);
}

TEST_F(PublisherChangeOnline, CountersOfWhatHasEndedStayInTheSum) {
  for (std::uint64_t seq = 1; seq <= 4; ++seq) outbox.push(test::sample(seq));
  outbox.push(test::counted(6, 2));
  settle();
  FieldHealth after;
  after.devices.resize(2);
  after.ended_collected = 6;
  after.ended_suppressed = 2;
  outbox.push(after);
  change_to(without_press1());
  settle();
  EXPECT_EQ(made().samples().collected, 6U);
  EXPECT_EQ(made().samples().suppressed, 2U);
  EXPECT_FALSE(made().samples().miscounted);
}

TEST_F(PublisherChangeOnline, WhatWaitsForTheBrokerIsDeliveredThoughItsDeviceIsGone) {
  write("a");
  broker.reachable = false;
  lose_connection();
  outbox.push(test::sample(5));
  outbox.push(succeeded("a"));
  change_to(without_press1());
  settle();
  broker.reachable = true;
  advance(60s);
  EXPECT_EQ(history(), Seqs{5});
  ASSERT_EQ(results().size(), 1U);
  EXPECT_EQ(results()[0]["status"], "SUCCEEDED");
  EXPECT_TRUE(is_cleared(kBase + "/press1/meta")) << "in the connection after it";
}

TEST_F(PublisherChangeOnline, CommandThatCameBeforeIsAnsweredByWhatIsInForceWhenItsTurnComes) {
  for (int i = 0; i < 100; ++i) {
    Message message;
    message.topic = kBase + "/press1/command";
    message.payload =
        R"({"id":")" + std::to_string(i) + R"(","op":"write","tag":"setpoint","value":5})";
    message.received = now;
    message.received_ms = utc();
    broker.send(std::move(message));
  }
  step();
  const std::size_t before = admitted.size();
  EXPECT_LT(before, 100U) << "some still wait";
  for (std::size_t i = 0; i < before; ++i) outbox.push(succeeded(admitted[i].command.id));
  change_to(without_press1());
  settle();
  EXPECT_EQ(results().size(), 100U);
  EXPECT_EQ(
      std::ranges::count_if(results(), [](const json& r) { return r["status"] == "SUCCEEDED"; }),
      static_cast<std::ptrdiff_t>(before));
}

TEST_F(PublisherChangeOnline, OtherBrokerGetsWhatTheOldOneDidNotAcknowledge) {
  broker.acknowledges = false;
  outbox.push(test::sample(5));
  write("a");
  outbox.push(succeeded("a"));
  step();
  change_broker();
  step();
  EXPECT_EQ(last("/state")["state"], "offline")
      << "who watches the old broker must not see us online for ever";
  EXPECT_EQ(broker.disconnects, 0) << "until the broker has that, or a second has passed";
  broker.acknowledges = true;
  const std::size_t connects = broker.connects.size();
  advance(1s);
  ASSERT_EQ(broker.used.size(), 1U);
  EXPECT_EQ(broker.used[0].servers, std::vector<std::string>{"mqtt://three:1883"});
  EXPECT_EQ(broker.disconnects, 1);
  ASSERT_EQ(broker.connects.size(), connects + 1);
  EXPECT_EQ(broker.connects.back(), 0U);
  advance(5s);
  EXPECT_EQ(history(), Seqs{5});
  EXPECT_EQ(results().size(), 2U) << "sent to both";
  EXPECT_EQ(last("/state")["state"], "online");
}

// A broker may deliver the agent's own goodbye before it acknowledges it; it is not another
// agent's.
TEST_F(PublisherChange, GoodbyeToTheOldBrokerIsNotRepaired) {
  broker.echoes = true;
  online();
  broker.acknowledges = false;
  change_broker();
  for (int i = 0; i < 5; ++i) step();
  EXPECT_EQ(last("/state")["state"], "offline");
  broker.acknowledges = true;
  advance(1s);
  EXPECT_EQ(broker.disconnects, 1);
}

TEST_F(PublisherChangeOnline, StopBehindAGoodbyeStillSendsWhatWaits) {
  broker.acknowledges = false;
  change_broker();
  step();
  publisher->stop(now);
  broker.acknowledges = true;
  EXPECT_GT(step(), now) << "it would spin";
}

TEST_F(PublisherChange, OtherBrokerIsTriedAtOnceWhereTheOldOneIsAway) {
  broker.reachable = false;
  settle();
  advance(60s);
  broker.reachable = true;
  change_broker();
  step();
  EXPECT_TRUE(broker.up());
  EXPECT_EQ(broker.connects.back(), 0U);
}

TEST_F(PublisherChangeOnline, HealthSaysWhichConfigIsInForceAndWhyAnotherWasRefused) {
  ConfigStatus status;
  status.hash = "0123456789abcdef";
  status.since_ms = 7;
  status.last_reload = {"rejected", 8, {"agent.json:3: wrong"}, 12};
  status.remote = {"v7", "rolled_back", false};
  made().set_config_status(status, now);
  settle();
  const json config_said = last("/health")["config"];
  EXPECT_EQ(config_said, json::parse(R"({"hash":"0123456789abcdef","since":7,"last_reload":
      {"state":"rejected","ts":8,"errors":["agent.json:3: wrong"],"errors_in_all":12},
      "remote":{"version":"v7","state":"rolled_back","confirmed":false}})"));
}

TEST_F(PublisherChangeOnline, StatusNamesTheConfigThatItsIndicesAreOf) {
  made().board().want_values();
  outbox.push(test::sample(5, 1));
  const auto read = [this] {
    advance(2s);
    return made().board().read(now, 0ms);
  };
  advance(61s);
  const auto before = read();
  change_to(without_press1());
  advance(61s);
  const auto after = read();
  ASSERT_TRUE(before && after);
  EXPECT_EQ(before->config->devices[0].name, "press1");
  EXPECT_TRUE(after->config->devices[0].is_vacant());
  ASSERT_EQ(after->values.size(), 2U);
  EXPECT_TRUE(after->values[1][0]) << "what was known of others is known still";
  const json health = last("/health");
  EXPECT_EQ(health["devices"].size(), 1U);
  EXPECT_TRUE(health["devices"].contains("press2"));
}

struct PublisherChangeWithStore : PublisherChange {
  PublisherChangeWithStore() { config.store.path = directory.path("store"); }
  static void end(PublisherBench& bench) {
    bench.made().stop(bench.now);
    for (int i = 0; i < 200 && !bench.made().finished(); ++i) {
      bench.now += 100ms;
      bench.made().step(bench.now);
    }
    ASSERT_TRUE(bench.made().finished());
  }
  test::Scratch directory;
};

TEST_F(PublisherChangeWithStore, NumbersOfADeviceOfAnEarlierRunGoOn) {
  {
    PublisherBench earlier(directory.path("store"));
    earlier.config.devices.push_back(test::press("oven"));
    earlier.settle();
    earlier.store->numbers().join(std::vector<std::string>{"press1", "press2", "oven"}, 1000);
    earlier.outbox.push(test::sample(5007, 2));
    earlier.settle();
    earlier.write("a");
    end(earlier);
  }
  online();
  store->numbers().join(std::vector<std::string>{"press1", "press2"}, 1000);
  outbox.push(test::sample(static_cast<std::uint64_t>(utc()), 0));
  settle();
  Config wanted = config;
  wanted.devices.push_back(test::press("oven"));
  const auto numbers = change_to(std::move(wanted));
  ASSERT_EQ(numbers.size(), 3U);
  EXPECT_EQ(numbers[0], 0U) << "it goes on by itself";
  EXPECT_EQ(numbers[2], 5007U);
}

TEST_F(PublisherChangeWithStore, IdsOfADeviceOfAnEarlierRunAreKnown) {
  {
    PublisherBench earlier(directory.path("store"));
    earlier.online();
    earlier.write("a");
    earlier.outbox.push(earlier.succeeded("a"));
    earlier.settle();
    end(earlier);
  }
  const Config both = config;
  config = without_press1();
  config.store = both.store;
  online();
  change_to(both);
  write("a");
  settle();
  ASSERT_EQ(results().size(), 1U);
  EXPECT_EQ(results()[0]["status"], "DUPLICATE");
  EXPECT_TRUE(admitted.empty());
}

}  // namespace
}  // namespace fxagent
