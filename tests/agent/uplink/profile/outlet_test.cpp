// A profile's session, window and backlog, with a broker in memory.
#include "agent/uplink/profile/outlet.h"

#include <gtest/gtest.h>

#include <random>

#include "agent/store/store.h"
#include "agent/uplink/profile/json_profile.h"
#include "agent/uplink/profile/plain_profile.h"
#include "agent/uplink/sparkplug/sparkplug_profile.h"
#include "tests/agent/uplink/fake_broker.h"
#include "tests/agent/uplink/plant.h"
#include "tests/support/says.h"
#include "tests/support/scratch.h"

namespace fxagent {
namespace {

using namespace std::chrono_literals;

constexpr std::int64_t kStartMs = 1790000000000;

struct OutletTest : testing::TestWithParam<ProfileConfig::Kind> {
  OutletTest() {
    config_.store.path = scratch_.path("store");
    ProfileConfig what;
    what.kind = GetParam();
    if (what.kind == ProfileConfig::Kind::json) what.broker = "cloud";
    what.topic = "{root}/{id}/{device}/{tag}";
    what.group = "plant-a";
    what.node = "edge7";
    const auto relay = [this](RelayedCommand command) { relayed_.push_back(std::move(command)); };
    const auto new_id = [this] { return "id-" + std::to_string(++ids_); };
    if (what.kind == ProfileConfig::Kind::sparkplug)
      profile_ =
          std::make_unique<SparkplugProfile>(config_, what, relay, new_id, [] { return kStartMs; });
    else if (what.kind == ProfileConfig::Kind::plain)
      profile_ = std::make_unique<PlainProfile>(config_, what, relay, new_id);
    else
      profile_ = std::make_unique<JsonProfile>(config_, what, "9f3c21aa", "0.1.0", kStartMs, relay);
    store_ = std::make_unique<Store>(config_.store, kStartMs);
    guarded_ = std::make_unique<GuardedStore>(*store_, [] {});
    Outlet::Settings settings;
    settings.name = name_of(what);
    settings.mqtt = config_.mqtt;
    settings.boot = "9f3c21aa";
    if (what.kind == ProfileConfig::Kind::sparkplug) settings.marker_topic = "mark";
    outlet_ = std::make_unique<Outlet>(
        config_, settings, *profile_, broker_, [] { return kStartMs; }, guarded_.get());
  }

  void settle(SteadyTime::duration time = 0ms) {
    now_ += time;
    for (int i = 0; i < 20; ++i) outlet_->step(now_);
  }
  void take(DeviceStatus::State state) {
    Outbox::Batch batch;
    batch.states = {test::status_of(0, state)};
    outlet_->take(batch, now_);
  }
  void take(double value) {
    Outbox::Batch batch;
    batch.telemetry = {test::sample(++seq_)};
    batch.telemetry[0].readings[0].value = Value(value);
    outlet_->take(batch, now_);
  }
  /// Connects, and publishes the value 1.
  void publish_one() {
    settle(1s);
    take(1.0);
    settle();
  }
  void remove_press1() {
    Config wanted = config_;
    wanted.devices = {config_.devices[1]};
    change_to(std::move(wanted));
  }
  void change_to(Config wanted) {
    const ConfigChange change = change_between(config_, std::move(wanted));
    config_ = change.config;
    outlet_->change(change, now_);
  }
  void lose_connection() {
    broker_.log.clear();
    broker_.lose();
    settle();
  }
  /// Stops, and steps when something has happened or is due. Returns the time that the stop took.
  SteadyTime::duration stop() {
    const SteadyTime begin = now_;
    outlet_->stop(now_);
    for (int i = 0; i < 50; ++i) {
      settle();
      const SteadyTime wake = outlet_->step(now_);
      if (outlet_->finished()) break;
      EXPECT_GT(wake, now_) << "it spins";
      now_ = wake;
    }
    EXPECT_TRUE(outlet_->finished());
    return now_ - begin;
  }
  /// Number of SUBSCRIBEs so far.
  std::ptrdiff_t subscribes() const {
    return std::ranges::count_if(broker_.order,
                                 [](const auto& each) { return each.starts_with("subscribe "); });
  }
  /// Removes the markers from the broker's log.
  void forget_marks() {
    std::erase_if(broker_.log, [](const Publication& each) { return each.topic == "mark"; });
  }
  /// Topic of the profile's last message.
  std::string last_topic() const {
    if (GetParam() == ProfileConfig::Kind::sparkplug) return "spBv1.0/plant-a/NDEATH/edge7";
    return config_.base_topic() + (GetParam() == ProfileConfig::Kind::plain ? "/plain" : "/state");
  }
  /// Steps until all samples are delivered.
  SampleCounts drained() {
    for (int i = 0; i < 400; ++i) {
      settle(250ms);
      if (broker_.open() != 0) broker_.acknowledge_all();
      const SampleCounts counts = outlet_->status().samples;
      if (counts.acknowledged + counts.dropped == counts.collected + counts.recovered) break;
    }
    return outlet_->status().samples;
  }

  test::Scratch scratch_;
  Config config_ = test::plant();
  test::FakeBroker broker_;
  SteadyTime now_ = SteadyTime(1h);
  std::vector<RelayedCommand> relayed_;
  int ids_ = 0;
  std::uint64_t seq_ = 0;
  std::unique_ptr<Profile> profile_;
  std::unique_ptr<Store> store_;
  std::unique_ptr<GuardedStore> guarded_;
  std::unique_ptr<Outlet> outlet_;
};

TEST_P(OutletTest, EverySampleIsInOnePlaceWhateverTheBrokerDoes) {
  std::mt19937 random(11);
  const auto chance = [&random](int of) {
    return std::uniform_int_distribution<int>(0, of - 1)(random) == 0;
  };
  broker_.acknowledges_qos0 = true;
  take(DeviceStatus::State::online);
  for (int i = 0; i < 2000; ++i) {
    broker_.acknowledges = !chance(3);
    broker_.reachable = !chance(4);
    if (chance(2)) take(std::uniform_int_distribution<int>(0, 3)(random));
    if (chance(40)) take(DeviceStatus::State::offline);
    if (chance(20)) take(DeviceStatus::State::online);
    if (chance(30) && broker_.up()) broker_.lose();
    if (chance(50) && broker_.open() != 0) broker_.refuse_next(0x97);
    if (chance(3) && broker_.open() != 0) broker_.acknowledge_next();
    settle(std::chrono::milliseconds(std::uniform_int_distribution<int>(0, 700)(random)));
    const SampleCounts counts = outlet_->status().samples;
    ASSERT_TRUE(counts.balanced())
        << "step " << i << ": collected " << counts.collected << ", queued " << counts.queued
        << ", in flight " << counts.in_flight << ", stored " << counts.stored << ", acknowledged "
        << counts.acknowledged;
  }
  broker_.acknowledges = broker_.reachable = true;
  take(DeviceStatus::State::online);
  const SampleCounts counts = drained();
  EXPECT_EQ(counts.acknowledged, counts.collected);
  EXPECT_EQ(counts.dropped, 0U);
}

TEST_P(OutletTest, LiveSampleOfARemovedDeviceIsDeliveredOrDropped) {
  broker_.acknowledges_qos0 = true;
  take(DeviceStatus::State::online);
  settle();
  drained();
  take(1);
  Config wanted = config_;
  wanted.devices = {test::press("press2")};
  change_to(std::move(wanted));
  const SampleCounts counts = drained();
  // A sample of Sparkplug needs the birth of its device.
  const std::uint64_t dropped = GetParam() == ProfileConfig::Kind::sparkplug ? 1 : 0;
  EXPECT_EQ(counts.dropped, dropped);
  EXPECT_EQ(counts.acknowledged, 1 - dropped);
}

TEST_P(OutletTest, CommandForWhatNoDeviceCanBeIsIgnored) {
  settle();
  broker_.send(test::message_on(config_.base_topic() + "/a b/command", R"({"id":"a","op":"run"})"));
  settle();
  EXPECT_TRUE(relayed_.empty());
}

TEST_P(OutletTest, LostSamplesAreWarnedOfWithTheNameOfTheProfile) {
  settle();
  Outbox::Batch batch;
  batch.dropped = {{0, 3}};
  outlet_->take(batch, now_);
  testing::internal::CaptureStderr();
  settle();
  const std::string log = testing::internal::GetCapturedStderr();
  EXPECT_NE(log.find("warning samples_dropped count=3 reason="), log.npos) << log;
  EXPECT_NE(log.find(" for " + outlet_->status().name), log.npos) << log;
}

TEST_P(OutletTest, SessionThatAnotherClientTakesOverIsOpenedAgain) {
  settle(1s);
  const std::size_t connects = broker_.connects.size();
  broker_.lose(kSessionTakenOver);
  settle(2s);
  EXPECT_EQ(broker_.connects.size(), connects + 1);
  EXPECT_TRUE(outlet_->status().connected);
}

TEST_P(OutletTest, StopEndsWithoutABroker) {
  broker_.reachable = false;
  settle(1s);
  take(1.0);
  EXPECT_EQ(stop(), 0s);
  EXPECT_TRUE(outlet_->status().samples.balanced());
}

TEST_P(OutletTest, StopEndsWithABrokerThatAnswersNothing) {
  settle(1s);
  ASSERT_TRUE(outlet_->status().connected);
  broker_.acknowledges = false;
  take(1.0);
  EXPECT_LE(stop(), 3s) << "one for each step";
  forget_marks();
  EXPECT_EQ(broker_.log.back().topic, last_topic());
}

TEST_P(OutletTest, StopEndsWithAServerThatIsSilent) {
  broker_.reachable = broker_.answers = false;
  settle(1s);
  EXPECT_LE(stop(), 1s);
  EXPECT_TRUE(broker_.log.empty());
}

TEST_P(OutletTest, StopSendsTheLastBatchAndThenTheLastMessageOnce) {
  broker_.acknowledges_qos0 = true;
  take(DeviceStatus::State::online);
  settle(1s);
  outlet_->stop(now_);
  take(1.0);
  EXPECT_EQ(stop(), 0s) << "the broker acknowledges at once";
  const SampleCounts counts = outlet_->status().samples;
  EXPECT_EQ(counts.acknowledged, counts.collected);
  ASSERT_FALSE(broker_.log.empty());
  forget_marks();
  EXPECT_EQ(broker_.log.back().topic, last_topic());
  if (GetParam() == ProfileConfig::Kind::sparkplug)
    EXPECT_EQ(broker_.on(last_topic()).size(), 1U);
  else
    test::expect_says(broker_.log.back().payload, "offline");
  EXPECT_EQ(broker_.left_with_will, GetParam() == ProfileConfig::Kind::sparkplug);
  EXPECT_EQ(broker_.disconnects, 1);
}

TEST_P(OutletTest, LastMessageThatFailsIsLogged) {
  settle(1s);
  broker_.fails = true;
  testing::internal::CaptureStderr();
  EXPECT_EQ(stop(), 0s);
  test::expect_says(testing::internal::GetCapturedStderr(),
                    "publish_failed what=" + outlet_->status().name);
}

TEST_P(OutletTest, SamplesLostInTheLastStepAreWarnedOf) {
  broker_.reachable = false;
  settle(1s);
  outlet_->stop(now_);
  Outbox::Batch batch;
  batch.dropped = {{0, 3}};
  outlet_->take(batch, now_);
  testing::internal::CaptureStderr();
  stop();
  test::expect_says(testing::internal::GetCapturedStderr(), "samples_dropped count=3");
}

TEST_P(OutletTest, IdleSessionDoesNotWakeAtOnceAgain) {
  take(DeviceStatus::State::online);
  settle(1s);
  settle(1s);
  EXPECT_GT(outlet_->step(now_), now_);
}

TEST_P(OutletTest, RefusedSubscriptionIsRepeatedUntilItIsGranted) {
  broker_.refusal = "Not authorized";
  broker_.refuses_states = true;
  testing::internal::CaptureStderr();
  settle(1s);
  const auto each = subscribes();
  ASSERT_GT(each, 0);
  EXPECT_LE(outlet_->step(now_), now_ + 2s);
  settle(2s);
  EXPECT_EQ(subscribes(), 2 * each);
  broker_.refusal.clear();
  broker_.refuses_states = false;
  settle(3s);
  EXPECT_EQ(subscribes(), 3 * each);
  for (int i = 0; i < 10; ++i) settle(20s);
  EXPECT_EQ(subscribes(), 3 * each);
  const std::string log = testing::internal::GetCapturedStderr();
  test::expect_says(log, "subscription_refused");
  test::expect_says(log, "subscription_granted");
}

TEST_P(OutletTest, SubscriptionThatIsNotConfirmedIsRepeatedUntilItIsGranted) {
  broker_.confirms = false;
  testing::internal::CaptureStderr();
  settle(1s);
  const auto each = subscribes();
  EXPECT_LE(outlet_->step(now_), now_ + 1s);
  settle(1s);
  const std::string log = testing::internal::GetCapturedStderr();
  test::expect_says(log, "subscription_refused server=\"" + config_.mqtt.servers[0] + " for " +
                             outlet_->status().name + "\" filter=");
  test::expect_says(log, "the broker does not confirm the subscription");
  for (int i = 0; i < 3; ++i) settle(60s);
  EXPECT_GE(subscribes(), 4 * each);
  EXPECT_LE(outlet_->step(now_), now_ + 75s);
  broker_.confirms = true;
  settle(75s);
  const auto so_far = subscribes();
  for (int i = 0; i < 10; ++i) settle(20s);
  EXPECT_EQ(subscribes(), so_far);
}

TEST_P(OutletTest, SlowBrokerGetsEachSubscriptionOnce) {
  broker_.confirms = false;
  testing::internal::CaptureStderr();
  settle(1s);
  const auto each = subscribes();
  settle(1s);
  settle(3s);
  for (const std::string& filter : broker_.filters) broker_.answer_subscription(filter, "");
  for (int i = 0; i < 10; ++i) settle(20s);
  EXPECT_EQ(subscribes(), each);
  const std::string log = testing::internal::GetCapturedStderr();
  test::expect_says(log, "subscription_granted");
  EXPECT_EQ(log.find("access rules"), log.npos) << log;
}

TEST_P(OutletTest, StopEndsTheSubscriptions) {
  settle(1s);
  EXPECT_FALSE(broker_.filters.empty());
  stop();
  EXPECT_TRUE(broker_.filters.empty()) << "messages would be acknowledged and not answered";
}

TEST_P(OutletTest, ConnectionMadeDuringAStopSubscribesToNothing) {
  broker_.reachable = broker_.answers = false;
  broker_.acknowledges_qos0 = true;
  take(DeviceStatus::State::online);
  settle(1s);
  take(1.0);
  outlet_->stop(now_);
  broker_.reachable = true;
  broker_.connect(0, kReceiveMaximum);  // the attempt succeeds
  EXPECT_EQ(stop(), 0s);
  EXPECT_EQ(subscribes(), 0);
  EXPECT_EQ(outlet_->status().samples.acknowledged, 1U);
  forget_marks();
  EXPECT_EQ(broker_.log.back().topic, last_topic());
}

TEST_P(OutletTest, StopSendsLiveSamplesThoughNoSubscriptionIsConfirmed) {
  broker_.confirms = false;
  broker_.acknowledges_qos0 = true;
  take(DeviceStatus::State::online);
  settle();
  ASSERT_TRUE(outlet_->status().connected);
  take(1.0);
  EXPECT_EQ(stop(), 0s);
  EXPECT_EQ(outlet_->status().samples.acknowledged, 1U);
}

struct PlainOutletTest : OutletTest {};
const std::string kTemp = "fx/plant-a/edge7/press1/temp";

TEST_P(PlainOutletTest, ValueThatIsLostWithTheConnectionIsPublishedInTheNextOne) {
  publish_one();
  broker_.acknowledges = false;
  take(2.0);
  settle();
  ASSERT_EQ(broker_.on(kTemp).back(), "2");
  for (int i = 0; i < 3; ++i) {
    lose_connection();
    settle(10s);
    ASSERT_EQ(broker_.on(kTemp), std::vector<std::string>{"2"});
  }
}

TEST_P(PlainOutletTest, TopicOfARemovedDeviceIsClearedThoughASampleWaits) {
  publish_one();
  take(2.0);
  remove_press1();
  settle();
  EXPECT_EQ(broker_.on(kTemp), (std::vector<std::string>{"1", ""}));
}

TEST_P(PlainOutletTest, TopicOfARemovedTagIsClearedThoughASampleWaits) {
  publish_one();
  take(2.0);
  Config wanted = config_;
  wanted.devices[0].tags[0].name = "other";
  change_to(std::move(wanted));
  settle();
  EXPECT_EQ(broker_.on(kTemp), (std::vector<std::string>{"1", ""}));
}

TEST_P(PlainOutletTest, WaitingSampleOfARemovedTagIsDelivered) {
  settle(1s);
  take(1.0);
  settle();
  take(2.0);
  Config wanted = config_;
  wanted.devices[0].tags[0].name = "other";
  change_to(std::move(wanted));
  EXPECT_EQ(drained().acknowledged, 2U);
  const auto history = broker_.on(kTemp + "/history");
  ASSERT_EQ(history.size(), 1U);
  test::expect_says(history[0], ",2]]");
}

TEST_P(PlainOutletTest, TopicOfADeviceRemovedWhileTheBrokerIsAwayIsClearedLater) {
  publish_one();
  broker_.reachable = false;
  lose_connection();
  remove_press1();
  broker_.reachable = true;
  settle(60s);
  EXPECT_EQ(broker_.on(kTemp), std::vector<std::string>{""});
}

TEST_P(PlainOutletTest, ValueThatBecameHistoryInAConnectionIsPublished) {
  settle(1s);
  broker_.acknowledges = false;
  for (int i = 0; i < 30; ++i) take(i);
  settle();
  settle(2s);
  broker_.acknowledges = true;
  broker_.acknowledge_all();
  settle();
  EXPECT_EQ(broker_.on(kTemp).back(), "29");
}

TEST_P(PlainOutletTest, NewestValueIsPublishedThoughThatOfTheLastConnectionWaited) {
  publish_one();
  broker_.receive_maximum = 1;
  broker_.acknowledges = false;
  lose_connection();
  settle(10s);
  take(2.0);
  settle(2s);
  broker_.acknowledges = true;
  broker_.acknowledge_all();
  settle();
  EXPECT_EQ(broker_.on(kTemp), std::vector<std::string>{"2"});
}

TEST_P(PlainOutletTest, TopicThatWasBeingClearedWhenTheConnectionBrokeIsClearedLater) {
  publish_one();
  broker_.acknowledges = false;
  remove_press1();
  settle();
  ASSERT_EQ(broker_.on(kTemp).back(), "");
  broker_.acknowledges = true;
  for (int i = 0; i < 2; ++i) {
    lose_connection();
    settle(60s);
    EXPECT_EQ(broker_.on(kTemp), std::vector<std::string>(i == 0 ? 1 : 0, ""));
  }
}

TEST_P(PlainOutletTest, ValueThatTheBrokerRefusesForATimeIsRepeated) {
  publish_one();
  broker_.acknowledges = false;
  lose_connection();
  settle(10s);
  while (broker_.open() != 0) broker_.refuse_next(0x97);
  settle();
  EXPECT_EQ(broker_.on(kTemp).size(), 1U) << "after a pause";
  EXPECT_LE(outlet_->step(now_), now_ + 2s);
  settle(2s);
  EXPECT_EQ(broker_.on(kTemp).size(), 2U);
  while (broker_.open() != 0) broker_.refuse_next(kPacketTooLarge);
  for (int i = 0; i < 10; ++i) settle(10s);
  EXPECT_EQ(broker_.on(kTemp).size(), 2U) << "the broker never accepts it";
}

TEST_P(PlainOutletTest, ValueWhoseSampleTheBrokerRefusesForATimeIsRepeated) {
  settle(1s);
  broker_.acknowledges = false;
  take(1.0);
  settle();
  broker_.refuse_next(0x97);
  settle();
  settle(2s);
  EXPECT_EQ(broker_.on(kTemp), (std::vector<std::string>{"1", "1"}));
}

TEST_P(PlainOutletTest, ValuesOfTheLastConnectionLeaveRoomForSamplesAndResults) {
  config_.devices[0].tags.resize(1);
  for (int i = 0; i < 100; ++i)
    config_.devices[0].tags.push_back(
        test::tag("t" + std::to_string(i), "D300", DataType::float32));
  settle(1s);
  Outbox::Batch batch;
  batch.telemetry = {test::sample(++seq_)};
  for (std::uint32_t i = 1; i < 101; ++i)
    batch.telemetry[0].readings.push_back(test::good(i, Value(1.0)));
  outlet_->take(batch, now_);
  settle();
  broker_.acknowledges = false;
  lose_connection();
  settle(10s);
  EXPECT_LE(broker_.open(), 10U);
  take(2.0);
  settle();
  EXPECT_EQ(broker_.on(kTemp).back(), "2");
}

TEST_P(PlainOutletTest, ValueThatChangesOftenIsPublishedThoughAnotherOfItsDeviceIsRefused) {
  settle(1s);
  broker_.refuses_topic = "/setpoint";
  const auto take_both = [this](double value) {
    Outbox::Batch batch;
    batch.telemetry = {test::sample(++seq_)};
    batch.telemetry[0].readings = {test::good(0, Value(value)), test::good(1, Value(value))};
    outlet_->take(batch, now_);
    settle(500ms);
  };
  for (int i = 0; i < 300; ++i) take_both(i);
  broker_.log.clear();
  for (int i = 300; i < 320; ++i) take_both(i);
  ASSERT_FALSE(broker_.on(kTemp).empty());
  EXPECT_GE(std::stod(broker_.on(kTemp).back()), 316);
}

struct OutletResultsTest : OutletTest {
  OutletResultsTest() {
    settle(1s);
    broker_.send(is_plain_ ? test::message_on("fx/plant-a/edge7/press1/setpoint/set", "50")
                           : test::message_on("fx/plant-a/edge7/press1/command", R"({"id":"a"})"));
    settle();
  }
  void answer(const std::string& result) {
    relayed_.at(0).reply(result);
    settle();
  }
  std::vector<std::string> results() const { return broker_.on(topic_); }

  const bool is_plain_ = GetParam() == ProfileConfig::Kind::plain;
  const std::string topic_ =
      is_plain_ ? "fx/plant-a/edge7/press1/setpoint/result" : "fx/plant-a/edge7/press1/result";
};

TEST_P(OutletResultsTest, ResultIsSentUntilTheBrokerHasIt) {
  broker_.acknowledges = false;
  answer("one");
  broker_.refuse_next(0x97);
  settle();
  EXPECT_EQ(results().size(), 1U) << "after a pause";
  settle(2s);
  EXPECT_EQ(results().size(), 2U);
  broker_.acknowledges = true;
  lose_connection();
  for (int i = 0; i < 2; ++i) {
    settle(60s);
    EXPECT_EQ(results(), std::vector<std::string>(i == 0 ? 1 : 0, "one"));
    lose_connection();
  }
}

TEST_P(OutletResultsTest, EmptyMessageIsACommandUnlessItMayOnlyClearTheTopic) {
  const std::string topic =
      is_plain_ ? "fx/plant-a/edge7/press1/setpoint/set" : "fx/plant-a/edge7/press1/command";
  const auto hears = [&](bool retained) {
    relayed_.clear();
    broker_.send(test::message_on(topic, "", retained));
    settle();
    return !relayed_.empty();
  };
  EXPECT_TRUE(hears(false));
  EXPECT_EQ(relayed_.at(0).payload, "") << "not a text for a tag";
  EXPECT_FALSE(hears(true));
  config_.mqtt.version = 4;
  EXPECT_FALSE(hears(false)) << "MQTT 3.1.1 has no retain flag here";
}

TEST_P(OutletResultsTest, StopWaitsForAResultThatTheBrokerRefusedForATime) {
  broker_.acknowledges = false;
  answer("one");
  broker_.refuse_next(0x97);
  settle();
  settle(900ms);
  broker_.acknowledges = true;
  EXPECT_LE(stop(), 1s);
  EXPECT_EQ(results().size(), 2U);
}

TEST_P(OutletResultsTest, ResultThatTheBrokerWillNeverAcceptIsNotRepeated) {
  broker_.acknowledges = false;
  answer("one");
  broker_.refuse_next(kPacketTooLarge);
  settle(60s);
  EXPECT_EQ(results().size(), 1U);
}

TEST_P(OutletResultsTest, OldestResultsAreDroppedIfTheBrokerIsAway) {
  broker_.reachable = false;
  lose_connection();
  testing::internal::CaptureStderr();
  for (int i = 100; i < 200; ++i)
    answer(std::to_string(i) + std::string((std::size_t{1} << 16) - 3, ' '));
  broker_.reachable = true;
  settle(60s);
  settle();
  const std::string log = testing::internal::GetCapturedStderr();
  ASSERT_EQ(results().size(), 64U);
  EXPECT_EQ(results().front().substr(0, 3), "136");
  EXPECT_EQ(results().back().substr(0, 3), "199");
  test::expect_says(log, "error results_dropped");
  test::expect_says(log, "state=over count=36");
}

TEST_P(OutletResultsTest, AllOfManyResultsAreSent) {
  for (int i = 0; i < 1000; ++i) relayed_.at(0).reply(std::to_string(i));
  for (int i = 0; i < 10; ++i) settle();
  EXPECT_EQ(results().size(), 1000U);
}

TEST_P(OutletResultsTest, ResultIsSentThoughSamplesNeverStop) {
  broker_.receive_maximum = 1;
  lose_connection();
  settle(60s);
  broker_.acknowledges = false;
  for (int i = 0; i < 20; ++i) {
    take(i);
    if (i == 10) answer("one");
    settle(10ms);
    broker_.acknowledge_all();
  }
  EXPECT_EQ(results().size(), 1U);
}

TEST_P(OutletResultsTest, ResultDoesNotOvertakeSamplesReadBefore) {
  broker_.acknowledges = false;
  for (int i = 0; i < 20; ++i) take(i);
  answer("one");
  EXPECT_EQ(broker_.open(), 18U) << "two places are free";
  broker_.acknowledges = true;
  broker_.acknowledge_all();
  settle();
  EXPECT_EQ(results().size(), 1U);
  EXPECT_EQ(broker_.log.back().topic, topic_) << "after the samples";
}

TEST_P(OutletResultsTest, ResultWaitsAtMostASecondForSamples) {
  broker_.acknowledges = false;
  for (int i = 0; i < 20; ++i) take(i);
  answer("one");
  EXPECT_TRUE(results().empty());
  settle(1s);
  EXPECT_EQ(results().size(), 1U);
}

struct JsonOutletTest : OutletTest {
  JsonOutletTest() {
    settle(1s);
    broker_.acknowledges = false;
    broker_.log.clear();
  }
  std::vector<std::string> states() const { return broker_.on("fx/plant-a/edge7/press1/state"); }
  std::vector<std::string> metas() const { return broker_.on("fx/plant-a/edge7/press1/meta"); }
};
const std::vector<std::string> kCleared{""};

TEST_P(JsonOutletTest, StateOfTheAgentShowsThatCommandsAreNotReceived) {
  broker_.acknowledges = true;
  broker_.refusal = "Not authorized";
  lose_connection();
  settle(10s);
  const auto state = [this] { return broker_.on("fx/plant-a/edge7/state").back(); };
  test::expect_says(state(), R"("commands":false)");
  test::expect_says(state(), "Not authorized");
  broker_.refusal.clear();
  settle(60s);
  EXPECT_EQ(state().find("commands"), std::string::npos) << state();
}

TEST_P(JsonOutletTest, StateOfTheAgentWaitsAtMostASecondForTheAnswerToTheSubscription) {
  broker_.acknowledges = true;
  broker_.confirms = false;
  lose_connection();
  const auto states = [this] { return broker_.on("fx/plant-a/edge7/state"); };
  for (int i = 0; i < 20 && !broker_.up(); ++i) settle(100ms);
  ASSERT_TRUE(broker_.up());
  EXPECT_TRUE(states().empty()) << "the answer may still come";
  EXPECT_LE(outlet_->step(now_), now_ + 1s);
  settle(1s);
  ASSERT_EQ(states().size(), 1U);
  test::expect_says(states().back(), R"("commands":false,"reason":"the broker does not confirm)");
  broker_.answer_subscription("fx/plant-a/edge7/+/command", "");
  settle();
  ASSERT_EQ(states().size(), 2U);
  EXPECT_EQ(states().back().find("commands"), std::string::npos) << states().back();
}

TEST_P(JsonOutletTest, StateOfTheAgentShowsThatARepeatedSubscriptionIsGranted) {
  broker_.acknowledges = true;
  broker_.confirms = false;
  lose_connection();
  settle(10s);
  settle(1s);
  const auto state = [this] { return broker_.on("fx/plant-a/edge7/state").back(); };
  test::expect_says(state(), R"("commands":false)");
  broker_.confirms = true;
  settle(60s);
  EXPECT_EQ(state().find("commands"), std::string::npos) << state();
}

TEST_P(JsonOutletTest, StateThatTheBrokerWillNeverAcceptIsNotRepeated) {
  take(DeviceStatus::State::online);
  settle();
  broker_.refuse_next(kPacketTooLarge);
  for (int i = 0; i < 10; ++i) settle(10s);
  EXPECT_EQ(broker_.log.size(), 1U);
}

TEST_P(JsonOutletTest, StateThatTheBrokerRefusesForATimeIsRepeatedAlone) {
  take(DeviceStatus::State::online);
  settle();
  broker_.refuse_next(0x97);
  settle();
  const SteadyTime wake = outlet_->step(now_);
  EXPECT_GT(wake, now_);
  EXPECT_LE(wake, now_ + 2s);
  settle(2s);
  EXPECT_EQ(states().size(), 2U);
  EXPECT_EQ(broker_.log.size(), 2U);
}

TEST_P(JsonOutletTest, RefusalOfAStateIsLoggedWithTheNameOfTheProfile) {
  take(DeviceStatus::State::online);
  settle();
  broker_.refuse_next(0x97);
  testing::internal::CaptureStderr();
  settle();
  test::expect_says(testing::internal::GetCapturedStderr(),
                    "publish_refused what=" + outlet_->status().name +
                        " topic=" + broker_.log.back().topic + " code=0x97");
}

TEST_P(JsonOutletTest, TopicRefusedToBeClearedIsClearedAtOnceInTheNextConnection) {
  broker_.acknowledges = true;
  broker_.refuses_topic = "/press1/";
  remove_press1();
  for (int i = 0; i < 10; ++i) settle(30s);  // the pauses have grown
  settle(1s);
  const auto refused = states().size();
  ASSERT_GT(refused, 1U);
  broker_.refuses_topic.clear();
  lose_connection();
  settle(2s);
  EXPECT_EQ(states(), kCleared);
}

TEST_P(JsonOutletTest, TopicsOfADeviceRemovedWhileTheBrokerIsAwayAreClearedLater) {
  broker_.reachable = false;
  lose_connection();
  remove_press1();
  broker_.reachable = broker_.acknowledges = true;
  for (int i = 0; i < 2; ++i) {
    settle(60s);
    EXPECT_EQ(states(), i == 0 ? kCleared : std::vector<std::string>{});
    EXPECT_EQ(metas(), states());
    lose_connection();
  }
}

TEST_P(JsonOutletTest, TopicsThatWereBeingClearedWhenTheConnectionBrokeAreClearedLater) {
  remove_press1();
  settle();
  EXPECT_EQ(states(), kCleared);
  broker_.acknowledges = true;
  lose_connection();
  settle(60s);
  EXPECT_EQ(states(), kCleared);
  EXPECT_EQ(metas(), kCleared);
}

INSTANTIATE_TEST_SUITE_P(Json, JsonOutletTest, testing::Values(ProfileConfig::Kind::json));
INSTANTIATE_TEST_SUITE_P(Results, OutletResultsTest,
                         testing::Values(ProfileConfig::Kind::json, ProfileConfig::Kind::plain));
INSTANTIATE_TEST_SUITE_P(Plain, PlainOutletTest, testing::Values(ProfileConfig::Kind::plain));
INSTANTIATE_TEST_SUITE_P(Profiles, OutletTest,
                         testing::Values(ProfileConfig::Kind::json, ProfileConfig::Kind::plain,
                                         ProfileConfig::Kind::sparkplug),
                         [](const auto& each) {
                           return std::string(
                               config_keys::kProfiles.at(static_cast<std::size_t>(each.param)));
                         });

}  // namespace
}  // namespace fxagent
