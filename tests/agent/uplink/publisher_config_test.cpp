// A remote config in the uplink: accepted only if permitted, answered after each connect.
#include <gtest/gtest.h>

#include "tests/agent/uplink/publisher_bench.h"

namespace fxagent {
namespace {

using test::kBase;
using namespace std::chrono_literals;

const std::string kDesired = kBase + "/config/desired";
const std::string kReported = kBase + "/config/reported";

struct PublisherConfig : ::testing::Test, test::PublisherBench {
  void listen() {
    OwnTopics::ConfigListener listener{
        .desired = [this](std::string payload) { heard.push_back(std::move(payload)); },
        .connection = [this](bool is_up, SteadyTime) { connections.push_back(is_up); }};
    made().own_topics().set_config_listener(std::move(listener));
  }
  void answer(const std::string& text) {
    made().own_topics().report_config(text, "");
    settle();
  }
  void desire(const std::string& payload) {
    broker.send(test::message_on(kDesired, payload));
    settle();
  }

  void reload_with(bool remote_enabled) {
    Config wanted = config;
    wanted.remote.enabled = remote_enabled;
    const ConfigChange change = change_between(config, std::move(wanted));
    outbox.post([&](SteadyTime) { made().begin_change(change); });
    step();
    outbox.post([&](SteadyTime at) { made().change(change, at); });
    settle();
  }
  auto asks() const { return std::ranges::count(broker.order, "subscribe " + kDesired); }

  std::vector<std::string> heard;
  std::vector<bool> connections;
};

struct PublisherConfigOn : PublisherConfig {
  PublisherConfigOn() {
    config.remote.enabled = true;
    listen();
  }
};

TEST_F(PublisherConfig, NothingIsHeardUnlessTheFileLetsIt) {
  listen();
  online();
  desire("{}");
  EXPECT_TRUE(heard.empty());
  EXPECT_FALSE(broker.filters.contains(kDesired));
  EXPECT_TRUE(broker.on(kReported).empty());
}

TEST_F(PublisherConfigOn, DocumentsAndTheConnectionAreToldAsTheyCome) {
  online();
  desire("{}");
  desire("");
  EXPECT_EQ(heard, (std::vector<std::string>{"{}", ""}));
  lose_connection();
  EXPECT_EQ(connections, (std::vector<bool>{true, false}));
}

TEST_F(PublisherConfigOn, DocumentsAreHeardAfterAReconnectToo) {
  online();
  lose_connection();
  advance(60s);
  ASSERT_TRUE(broker.up());
  EXPECT_TRUE(broker.filters.contains(kDesired));
  desire("{}");
  EXPECT_EQ(heard, std::vector<std::string>{"{}"});
}

TEST_F(PublisherConfigOn, ARefusedSubscriptionIsRepeatedUntilItIsGranted) {
  broker.refuses_states = true;
  online();
  broker.refuses_states = false;
  advance(61s);
  EXPECT_EQ(asks(), 1);
  advance(1h);
  EXPECT_EQ(asks(), 1);
}

TEST_F(PublisherConfigOn, ARefusedSubscriptionIsNotRepeatedOnceItIsOff) {
  broker.refuses_states = true;
  online();
  reload_with(false);
  advance(61s);
  EXPECT_EQ(asks(), 0);
}

TEST_F(PublisherConfig, AReloadSwitchesItOnAndOff) {
  listen();
  online();
  for (const bool on : {true, false}) {
    reload_with(on);
    EXPECT_EQ(broker.filters.contains(kDesired), on);
  }
}

TEST_F(PublisherConfigOn, TheReportIsRetainedAndComesAfterEachConnect) {
  answer("one");
  EXPECT_EQ(broker.on(kReported), std::vector<std::string>{"one"});
  answer("two");
  EXPECT_EQ(broker.on(kReported).back(), "two");
  lose_connection();
  advance(60s);
  EXPECT_EQ(broker.on(kReported), (std::vector<std::string>{"one", "two", "two"}));
  answer("");
  EXPECT_EQ(broker.on(kReported).back(), "");
  lose_connection();
  advance(60s);
  EXPECT_EQ(broker.on(kReported).size(), 4u);  // no further answer on the old topic
}

TEST_F(PublisherConfigOn, AReportThatIsClearedWhileTheBrokerIsAwayIsClearedLater) {
  answer("one");
  broker.lose();
  step();
  answer("");
  advance(60s);
  EXPECT_EQ(broker.on(kReported), (std::vector<std::string>{"one", ""}));
}

TEST_F(PublisherConfigOn, AReportIsClearedAgainIfTheConnectionBreaksBeforeTheBrokerHasThat) {
  answer("one");
  broker.acknowledges = false;
  answer("");
  ASSERT_EQ(broker.on(kReported), (std::vector<std::string>{"one", ""}));
  broker.acknowledges = true;
  for (int i = 0; i < 2; ++i) {
    lose_connection();
    advance(60s);
    EXPECT_EQ(broker.on(kReported), (std::vector<std::string>{"one", "", ""})) << "not once more";
  }
}

TEST_F(PublisherConfig, AReportThatTheBrokerWillNeverLetBeClearedIsNotClearedAgain) {
  config.remote.enabled = true;
  listen();
  made().own_topics().report_config("one", "");
  settle();
  broker.acknowledges = false;
  made().own_topics().report_config("", "");
  settle();
  ASSERT_EQ(broker.open(), 1U);
  broker.refuse_next(kTopicNameInvalid);
  settle();
  broker.acknowledges = true;
  lose_connection();
  advance(60s);
  EXPECT_EQ(broker.on(kReported), (std::vector<std::string>{"one", ""}));
}

/// Records the sender and the outcome. Publishing the same answer again adds no record.
TEST(PublisherConfigAudit, AnAnswerThatIsNewsIsARecord) {
  test::Scratch scratch;
  test::PublisherBench bench(scratch.path("store"));
  bench.config.remote.enabled = true;
  bench.online();
  const auto before = bench.store->audit().head().records;
  bench.publisher->own_topics().report_config("one", R"({"kind":"config"})");
  bench.advance(1s);
  EXPECT_EQ(bench.store->audit().head().records, before + 1);
  bench.publisher->own_topics().report_config("one", "");
  bench.advance(1s);
  EXPECT_EQ(bench.store->audit().head().records, before + 1);
  EXPECT_EQ(bench.broker.on(kReported), (std::vector<std::string>{"one", "one"}));
}

}  // namespace
}  // namespace fxagent
