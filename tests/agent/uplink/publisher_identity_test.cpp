// Two agents with one id, and other clients' texts on the agent's retained topics.
#include <gtest/gtest.h>

#include "tests/agent/uplink/publisher_bench.h"

namespace fxagent {
namespace {

using nlohmann::json;
using test::kBase;
using Bench = test::PublisherBench;
using namespace std::chrono_literals;

const std::string kState = kBase + "/state";
const std::string kOnline = R"({"state":"online","since":1,"boot":"0ther","version":"0.1.0"})";
const std::string kWill = R"({"state":"offline","since":null,"reason":"lost","boot":"0ther"})";

void hear(Bench& bench, const std::string& topic, const std::string& payload) {
  bench.broker.send(test::message_on(topic, payload, true));
  bench.settle();
}

json conflict_of(const Bench& bench) { return bench.last("/state").value("conflict", json()); }

json result_of(Bench& bench, const std::string& id) {
  bench.write(id);
  bench.settle();
  for (const json& result : bench.results())
    if (result["id"] == id) return result;
  return json();
}

// ---- another agent ------------------------------------------------------------------------------

using PublisherIdentityOnlineTest = test::OnBenchOnline;
using PublisherIdentityTest = test::OnBench;

TEST_F(PublisherIdentityTest, OnlineOfAnotherBootIsAConflictAndCommandsAreRefused) {
  bench.broker.echoes = true;
  bench.online();
  hear(bench, kState, kOnline);
  EXPECT_EQ(conflict_of(bench), "0ther");
  EXPECT_EQ(bench.last("/health")["conflict"], "0ther");
  const json refused = result_of(bench, "a");
  EXPECT_EQ(refused["status"], "REJECTED");
  EXPECT_EQ(refused["reason"], "conflict");
  EXPECT_TRUE(bench.admitted.empty());
  EXPECT_TRUE(bench.outbox.is_in_conflict()) << "the field rejects what waits";
}

TEST_F(PublisherIdentityTest, ConflictEndsWithTheOthersWillAndOurStateIsThereAgain) {
  bench.broker.echoes = true;
  bench.online();
  hear(bench, kState, kOnline);
  hear(bench, kState, kWill);
  EXPECT_EQ(conflict_of(bench), nullptr);
  EXPECT_EQ(bench.last("/state")["boot"], "9f3c21aa");
  EXPECT_EQ(bench.last("/health")["conflict"], nullptr);
  EXPECT_FALSE(bench.outbox.is_in_conflict());
  result_of(bench, "a");
  EXPECT_EQ(bench.admitted.size(), 1U);
}

TEST_F(PublisherIdentityTest, StateOfADeadBootIsNoConflictForLong) {
  bench.broker.echoes = true;
  bench.settle();
  hear(bench, kState, kOnline);  // as found; there is no reply
  EXPECT_EQ(conflict_of(bench), "0ther");
  bench.advance(5s);
  EXPECT_EQ(conflict_of(bench), nullptr);
  result_of(bench, "a");
  EXPECT_EQ(bench.admitted.size(), 1U);
}

TEST_F(PublisherIdentityOnlineTest, ConflictEndsEvenWhereOurStateNeverComesBack) {
  hear(bench, kState, kOnline);
  bench.advance(10s);
  EXPECT_EQ(conflict_of(bench), "0ther");
  bench.advance(21s);
  EXPECT_EQ(conflict_of(bench), nullptr);
}

TEST_F(PublisherIdentityTest, OfflineOfAnEarlierBootIsNoConflict) {
  bench.broker.echoes = true;
  bench.settle();
  hear(bench, kState, kWill);
  EXPECT_EQ(conflict_of(bench), nullptr);
  bench.advance(2s);
  EXPECT_EQ(bench.last("/state")["state"], "online");
}

TEST(PublisherIdentity, TextsThatAreNoStateOfAnAgentAreNoConflict) {
  for (const std::string text :
       {"", "{}", "null", "[1", R"({"state":"online"})", R"({"state":1,"boot":"0ther"})",
        R"({"state":"online","boot":7})"}) {
    Bench bench;
    bench.broker.echoes = true;
    bench.online();
    hear(bench, kState, text);
    EXPECT_EQ(conflict_of(bench), nullptr) << text;
    bench.advance(1s);
    EXPECT_EQ(bench.last("/state")["boot"], "9f3c21aa") << "it is repaired all the same";
  }
}

/// Agents with one id at one broker, each with its own client id.
struct Twins {
  Bench a;
  Bench b;
  std::map<Bench*, std::size_t> passed_on;

  Twins() {
    b.settings.boot = "b0b0b0b0";
    a.broker.echoes = b.broker.echoes = true;
  }
  void pass_on(Bench& from, Bench& to) {
    for (std::size_t& i = passed_on[&from]; i < from.broker.log.size(); ++i)
      if (from.broker.log[i].topic == kState)
        to.broker.send(test::message_on(kState, from.broker.log[i].payload));
  }
  void run(SteadyTime::duration time) {
    for (const SteadyTime end = a.now + time; a.now < end; a.now += 20ms) {
      b.now = a.now;
      a.step();
      b.step();
      pass_on(a, b);
      pass_on(b, a);
    }
  }
};

TEST(PublisherIdentity, TwoAgentsSeeEachOtherAsLongAsBothLiveAndNeitherCommands) {
  Twins twins;
  twins.run(60s);
  EXPECT_EQ(conflict_of(twins.a), "b0b0b0b0");
  EXPECT_EQ(conflict_of(twins.b), "9f3c21aa");
  EXPECT_LE(twins.a.broker.on(kState).size(), 65U) << "once a second at the most";
  EXPECT_LE(twins.b.broker.on(kState).size(), 65U);
  EXPECT_EQ(result_of(twins.a, "x")["reason"], "conflict");
  EXPECT_EQ(result_of(twins.b, "x")["reason"], "conflict");
  twins.b.made().stop(twins.b.now);
  twins.run(5s);
  EXPECT_EQ(conflict_of(twins.a), nullptr);
  EXPECT_EQ(twins.a.last("/state")["state"], "online");
  EXPECT_EQ(twins.b.last("/state")["reason"], "stopped") << "the last word of the one that left";
}

TEST_F(PublisherIdentityTest, ThreeAgentsDoNotAnswerEachOtherWithoutEnd) {
  bench.broker.echoes = true;
  bench.online();
  for (int i = 0; i < 100; ++i) {
    hear(bench, kState, R"({"state":"online","boot":"second"})");
    hear(bench, kState, R"({"state":"online","boot":"third"})");
    bench.advance(100ms);
  }
  EXPECT_LE(bench.broker.on(kState).size(), 13U) << "once a second at the most";
  hear(bench, kState, R"({"state":"offline","boot":"third","reason":"stopped"})");
  EXPECT_EQ(result_of(bench, "a")["reason"], "conflict") << "the second one is there still";
  hear(bench, kState, R"({"state":"offline","boot":"second","reason":"stopped"})");
  EXPECT_EQ(conflict_of(bench), nullptr);
}

TEST_F(PublisherIdentityTest, WhatStandsOnAServerWhereOursNeverStoodIsNoSessionTakenOver) {
  bench.config.mqtt.servers = {"mqtt://one:1883", "mqtt://two:1883"};
  bench.broker.echoes = true;
  bench.online();
  bench.lose_connection();
  while (!bench.broker.up()) bench.advance(100ms);
  ASSERT_EQ(bench.broker.connects.back(), 1U);
  hear(bench, kState, R"({"state":"offline","boot":"0lder","reason":"lost"})");
  EXPECT_EQ(conflict_of(bench), nullptr);
}

TEST_F(PublisherIdentityTest, SessionTakenOverIsAConflictUntilAConnectionIsSteady) {
  bench.config.mqtt.servers = {"mqtt://one:1883"};
  bench.broker.echoes = true;
  bench.online();
  bench.broker.lose(kSessionTakenOver);
  bench.settle();
  bench.advance(2s);
  ASSERT_TRUE(bench.broker.up());
  EXPECT_EQ(conflict_of(bench), "unknown");
  hear(bench, kState, kWill);  // of the agent whose session we took over
  EXPECT_EQ(conflict_of(bench), "0ther");
  EXPECT_EQ(result_of(bench, "a")["reason"], "conflict");
  bench.advance(9s);
  EXPECT_EQ(conflict_of(bench), "0ther");
  bench.advance(2s);
  EXPECT_EQ(conflict_of(bench), nullptr);
}

TEST_F(PublisherIdentityTest, OtherThatStoppedCleanlyWhileItHadOurSessionIsGone) {
  bench.config.mqtt.servers = {"mqtt://one:1883"};
  bench.broker.echoes = true;
  bench.online();
  bench.broker.lose(kSessionTakenOver);
  bench.settle();
  bench.advance(2s);
  hear(bench, kState, R"({"state":"offline","since":7,"reason":"stopped","boot":"0ther"})");
  EXPECT_EQ(conflict_of(bench), nullptr);
}

TEST_F(PublisherIdentityTest, WillOfAnotherWhereOurStateWasIsAConflictToo) {
  bench.config.mqtt.servers = {"mqtt://one:1883"};
  bench.broker.echoes = true;
  bench.online();
  bench.broker.lose();  // without a reason code, as on 3.1.1
  bench.settle();
  bench.broker.confirms = false;  // our state waits for the SUBACK
  bench.advance(2s);
  hear(bench, kState, kWill);
  bench.broker.answer_subscription(kBase + "/+/command", "");
  bench.settle();
  EXPECT_EQ(conflict_of(bench), "0ther");
  EXPECT_EQ(result_of(bench, "a")["reason"], "conflict");
  bench.advance(11s);
  EXPECT_EQ(conflict_of(bench), nullptr);
}

TEST(PublisherIdentity, TwoAgentsWithOneClientIdDoNotChaseEachOther) {
  Bench a;
  Bench b;
  b.settings.boot = "b0b0b0b0";
  b.settings.jitter_seed = 7;
  for (Bench* each : {&a, &b}) each->config.mqtt.servers = {"mqtt://one:1883"};
  std::size_t connects_of_a = 0;
  std::size_t connects_of_b = 0;
  for (const SteadyTime end = a.now + 30min; a.now < end; a.now += 100ms) {
    b.now = a.now;
    a.step();
    if (a.broker.connects.size() > connects_of_a && b.broker.up()) b.broker.lose(kSessionTakenOver);
    connects_of_a = a.broker.connects.size();
    b.step();
    if (b.broker.connects.size() > connects_of_b && a.broker.up()) a.broker.lose(kSessionTakenOver);
    connects_of_b = b.broker.connects.size();
  }
  EXPECT_LE(connects_of_a, 6U + 15U) << "1 s, 2 s ... 60 s, then a minute each";
  EXPECT_LE(connects_of_b, 6U + 15U);
  EXPECT_NE(conflict_of(a), nullptr);
  EXPECT_NE(conflict_of(b), nullptr);
}

// ---- texts of other clients --------------------------------------------------------------------

TEST(PublisherIdentity, OverwrittenStateAndMetaAreRepairedOnceASecondAtTheMost) {
  for (const std::string leaf : {"/state", "/press1/state", "/press1/meta"}) {
    Bench bench;
    bench.broker.echoes = true;
    bench.outbox.push(test::offline(0, "timeout"));
    bench.online();
    const std::string topic = kBase + leaf;
    for (int i = 0; i < 50; ++i) {
      hear(bench, topic, "{\"forged\":" + std::to_string(i) + "}");
      bench.advance(100ms);
    }
    EXPECT_GE(bench.broker.on(topic).size(), 4U) << topic;
    EXPECT_LE(bench.broker.on(topic).size(), 6U) << topic;
    bench.advance(1s);
    const std::size_t repairs = bench.broker.on(topic).size();
    EXPECT_FALSE(bench.last(leaf).contains("forged"));
    bench.advance(50s);
    EXPECT_EQ(bench.broker.on(topic).size(), repairs) << "nothing is wrong any more";
  }
}

TEST(PublisherIdentity, StopDoesNotSpinForARepairThatIsDueBehindTheLastState) {
  Bench bench;
  bench.broker.echoes = true;
  bench.online();
  hear(bench, kBase + "/state", R"({"forged":1})");  // repaired at once
  hear(bench, kBase + "/state", R"({"forged":2})");  // a second later
  bench.advance(500ms);
  bench.broker.acknowledges = false;
  bench.stop_without_spinning(100);
}

TEST_F(PublisherIdentityTest, OverwrittenStateIsRepairedEvenIfOursNeverCameBack) {
  bench.outbox.push(test::offline(0, "timeout"));
  bench.online();
  const std::string topic = kBase + "/press1/state";
  hear(bench, topic, R"({"forged":1})");
  bench.advance(5s);
  EXPECT_EQ(bench.broker.on(topic).size(), 1U);
}

TEST_F(PublisherIdentityOnlineTest, OwnOlderTextsThatComeBackLateAreNotRepaired) {
  std::vector<std::string> texts;
  for (const char* reason : {"timeout", "link_down", "timeout", "link_down"}) {
    bench.report(test::offline(0, reason));
    texts.push_back(bench.broker.on(kBase + "/press1/state").back());
    bench.advance(200ms);
  }
  for (const std::string& text : texts) hear(bench, kBase + "/press1/state", text);
  bench.advance(10s);
  EXPECT_EQ(bench.broker.on(kBase + "/press1/state").size(), 4U);
}

TEST_F(PublisherIdentityTest, WhatWasThereBeforeOursNeedsNoRepair) {
  bench.broker.acknowledges = false;
  bench.settle();
  hear(bench, kState, kWill);  // found when subscribing
  bench.broker.echoes = true;
  bench.acknowledge_all();
  bench.advance(10s);
  EXPECT_EQ(bench.broker.on(kState).size(), 1U);
}

TEST_F(PublisherIdentityTest, RefusedSubscriptionToStatesStopsNothing) {
  bench.broker.refuses_states = true;
  bench.online();
  bench.take_samples(1);
  EXPECT_EQ(bench.made().samples().acknowledged, 1U);
  EXPECT_FALSE(bench.last("/state").contains("commands"));
  result_of(bench, "a");
  EXPECT_EQ(bench.admitted.size(), 1U);
  EXPECT_EQ(bench.broker.connects.size(), 1U);
}

// ---- devices that are not configured ------------------------------------------------------------

TEST_F(PublisherIdentityOnlineTest, CommandForAnUnknownDeviceIsAnswered) {
  bench.correlation = {1, 2};
  bench.response_topic = kBase + "/pres1/result/hmi";
  bench.command(R"({"id":"a","op":"write","tag":"setpoint","value":1})", kBase + "/pres1/command");
  bench.settle();
  const json result = bench.last("/pres1/result");
  EXPECT_EQ(result["id"], "a");
  EXPECT_EQ(result["status"], "REJECTED");
  EXPECT_EQ(result["reason"], "unknown_device");
  EXPECT_NE(result["detail"].get<std::string>().find("press1"), std::string::npos) << result;
  EXPECT_EQ(bench.last("/pres1/result/hmi")["id"], "a");
  for (const Publication& each : bench.broker.taken) EXPECT_EQ(each.correlation, (Bytes{1, 2}));
  bench.command(R"({"id":"a","op":"run"})", kBase + "/pres1/command");
  bench.settle();
  EXPECT_EQ(bench.last("/pres1/result")["reason"], "unknown_device") << "its id is not remembered";
}

TEST_F(PublisherIdentityOnlineTest, MessageForAnUnknownDeviceIsCheckedLikeAnyOther) {
  const auto reason = [&](const std::string& payload, bool retained = false) {
    bench.broker.send(test::message_on(kBase + "/nobody/command", payload, retained));
    bench.settle();
    const json result = bench.last("/nobody/result");
    return result.is_object() ? result["reason"] : json();
  };
  EXPECT_EQ(reason("", true), nullptr) << "it only clears the topic";
  EXPECT_EQ(reason("no json"), "bad_json");
  EXPECT_EQ(reason("{}"), "missing_id");
  EXPECT_EQ(reason(R"({"id":"a","op":"run"})", true), "retained");
  EXPECT_EQ(reason(R"({"id":"a","op":"dance"})"), "unknown_device");
  const std::size_t answers = bench.broker.on(kBase + "/nobody/result").size();
  for (const std::string& name :
       {std::string("Nobody"), std::string("no body"), std::string(65, 'x')}) {
    bench.command(R"({"id":"a","op":"run"})", kBase + "/" + name + "/command");
    bench.settle();
    EXPECT_TRUE(bench.broker.on(kBase + "/" + name + "/result").empty()) << name;
  }
  EXPECT_EQ(bench.broker.on(kBase + "/nobody/result").size(), answers);
}

TEST(PublisherIdentity, AnswersForUnknownDevicesAreNotJournaled) {
  const test::Scratch scratch;
  Bench bench(scratch.path("store"));
  bench.online();
  bench.command(R"({"id":"a","op":"run"})", kBase + "/nobody/command");
  bench.settle();
  bench.advance(1s);
  EXPECT_EQ(bench.last("/nobody/result")["id"], "a");
  EXPECT_FALSE(bench.store->journal().find("nobody", "a"));
}

// ---- counters, totals ---------------------------------------------------------------------------

TEST_F(PublisherIdentityTest, HealthWaitsForTheCountersOfThisMoment) {
  int asked = 0;
  bench.settings.ask_counters = [&asked] { ++asked; };
  bench.settle();
  EXPECT_EQ(asked, 1);
  EXPECT_TRUE(bench.broker.on(kBase + "/health").empty());
  FieldHealth field;
  field.links.resize(bench.config.links.size());
  field.devices.resize(bench.config.devices.size());
  field.links.at(0).exchanges = 4;
  bench.report(field);
  const auto health = bench.broker.on(kBase + "/health");
  ASSERT_EQ(health.size(), 1U);
  EXPECT_EQ(json::parse(health[0])["links"].begin().value()["exchanges"], 4);
  bench.advance(60s);
  EXPECT_EQ(asked, 2);
  bench.advance(1s);
  EXPECT_EQ(bench.broker.on(kBase + "/health").size(), 2U) << "a field that does not answer";
}

TEST(PublisherIdentity, FirstOfADuplicateHasTheTotalThatWasPublished) {
  const test::Scratch scratch;
  for (const bool with_store : {false, true}) {
    json first;
    {
      Bench bench(with_store ? scratch.path("store") : std::string());
      bench.online();
      bench.write("a");
      bench.now += 700ms;
      bench.report(bench.succeeded("a"));
      first = bench.results().at(0);
      EXPECT_EQ(first["t"]["total_ms"], 700);
      bench.write("a");
      bench.settle();
      EXPECT_EQ(bench.results().at(1)["first"], first) << with_store;
      bench.advance(1s);
      bench.made().stop(bench.now);
      bench.settle();
    }
    if (!with_store) continue;
    Bench again(scratch.path("store"));
    again.online();
    again.write("a");
    again.settle();
    EXPECT_EQ(again.results().at(0)["first"], first);
  }
}

// ---- failures without an event from the broker -------------------------------------------------

TEST_F(PublisherIdentityOnlineTest, SamplesThatTheLibraryDoesNotTakeAreNotRefused) {
  bench.advance(39900ms);  // just before health is due
  bench.broker.fails = true;
  bench.outbox.push(test::sample(1));
  bench.step();
  bench.broker.fails = false;
  bench.advance(200ms);
  EXPECT_EQ(bench.last("/health")["devices"]["press1"]["refused"], nullptr);
  EXPECT_EQ(bench.made().samples().stored, 1U) << "it waits";
}

}  // namespace
}  // namespace fxagent
