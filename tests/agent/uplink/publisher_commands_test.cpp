// Commands and results in the publisher: the journal, the audit, and how long a result is
// published.
#include <gtest/gtest.h>

#include <fstream>

#include "agent/cli/audit/audit_report.h"
#include "agent/commands/recovery.h"
#include "agent/store/journal/unrecorded_file.h"
#include "agent/uplink/profile/json_profile.h"
#include "agent/uplink/profile/outlet.h"
#include "tests/agent/uplink/publisher_bench.h"

namespace fxagent {
namespace {

using nlohmann::json;
using test::kBase;
using test::kStart;
using Bench = test::PublisherBench;
using namespace std::chrono_literals;

using PublisherOnlineTest = test::OnBenchOnline;
using PublisherTest = test::OnBench;
using PublisherFloodOnlineTest = test::OnBenchOnline;
using PublisherFloodTest = test::OnBench;

using PublisherAuditStoredOnlineTest = test::OnStoredBenchOnline;
using PublisherStoreOnlineTest = test::OnStoredBenchOnline;

TEST_F(PublisherStoreOnlineTest, FieldGetsACommandWhenItIsInTheJournal) {
  int in_the_journal = 0;
  bench.on_admitted = [&](const AdmittedCommand& each) {
    const auto known = bench.store->journal().find("press1", each.command.id);
    in_the_journal += known && known->result.empty();
  };
  bench.write("a");
  bench.write("b");
  ASSERT_EQ(bench.admitted.size(), 2U);
  EXPECT_EQ(in_the_journal, 2);
  const auto known = bench.store->journal().unacknowledged();
  ASSERT_EQ(known.size(), 2U);
  EXPECT_EQ(known[0].device, "press1");
  EXPECT_EQ(known[0].result, "");
}

TEST(PublisherStore, FieldGetsACommandAtOnceWhereTheDiskRefuses) {
  const test::Scratch scratch;
  std::ofstream(scratch.path("store")) << "a file in its place";
  Bench bench(scratch.path("store"));
  bench.write("a");
  ASSERT_EQ(bench.admitted.size(), 1U);
  EXPECT_EQ(bench.admitted[0].command.id, "a");
}

TEST_F(PublisherStoreOnlineTest, KnownIdDuringTheEndIsADuplicate) {
  bench.write("done");
  bench.report(bench.succeeded("done"));
  bench.broker.log.clear();
  bench.broker.acknowledges = false;
  bench.made().stop(bench.now);
  bench.outbox.push(test::sample(1));
  bench.step();
  bench.command(R"({"id":"done","op":"run"})");
  const auto results = bench.results();
  ASSERT_EQ(results.size(), 1U);
  EXPECT_EQ(results[0]["status"], "DUPLICATE");
  EXPECT_EQ(results[0]["first"]["status"], "SUCCEEDED");
  EXPECT_NE(bench.store->journal().find("press1", "done")->result.find("SUCCEEDED"),
            std::string::npos);
}

TEST_F(PublisherStoreOnlineTest, DuplicateBringsItsFirstResultFromTheJournal) {
  bench.write("a");
  bench.write("a");
  bench.outbox.push(bench.succeeded("a"));
  bench.step();
  bench.write("a");
  bench.settle();
  const auto results = bench.results();
  ASSERT_EQ(results.size(), 3U);
  EXPECT_EQ(results[0]["first"], nullptr) << "it is still running";
  EXPECT_EQ(results[0]["plc"], nullptr);
  EXPECT_EQ(results[2]["first"], results[1]) << "as it was published";
  EXPECT_EQ(results[2]["plc"], "ACK");
}

TEST(PublisherStore, StoreThatOpensLateTellsWhatItKnows) {
  const test::Scratch scratch;
  const std::string path = scratch.path("store");
  JournalEntry refused;  // by a full disk
  refused.device = "press1";
  refused.id = "refused";
  refused.number = 100;
  refused.acknowledged = true;
  {
    Bench before(path);
    before.online();
    before.broker.acknowledges = false;
    before.write("done");
    before.outbox.push(before.succeeded("done"));
    before.write("left");
    before.step();
    refused.received_ms = refused.deadline_ms = before.utc();
  }
  {
    UnrecordedFile file(path);
    file.open();
    file.keep(refused);
  }
  std::filesystem::rename(path, path + "-away");  // like a disk that is mounted late
  std::ofstream(path) << "a file in its place";
  Bench bench(path);
  bench.online();
  EXPECT_TRUE(bench.found_late.empty());
  std::filesystem::remove(path);
  std::filesystem::rename(path + "-away", path);
  bench.write("own");
  bench.advance(11s);
  bench.advance(11s);
  ASSERT_EQ(bench.found_late.size(), 1U);
  // Publishes the unpublished result of the earlier run, and none for this run's command.
  ASSERT_EQ(bench.results().size(), 1U);
  EXPECT_EQ(bench.results()[0]["id"], "done");
  ASSERT_EQ(bench.admitted.size(), 2U);
  EXPECT_EQ(bench.admitted[1].command.id, "left");
  EXPECT_TRUE(bench.admitted[1].interrupted) << "it is read and not sent";
  ASSERT_TRUE(bench.store->journal().find("press1", "own"));
  EXPECT_EQ(bench.store->journal().find("press1", "own")->result, "");
  bench.write("done");
  bench.write("left");
  bench.write("refused");
  for (const std::size_t duplicate : {1U, 2U, 3U})
    EXPECT_EQ(bench.results().at(duplicate)["status"], "DUPLICATE");
}

TEST(PublisherStore, RestartKnowsTheResultsAndPublishesWhatWasNotAcknowledged) {
  const test::Scratch scratch;
  std::string first;
  {
    Bench bench(scratch.path("store"));
    bench.config.devices[0].tags[test::running].writable = true;
    bench.response_topic = kBase + "/press1/result/hmi";
    bench.correlation = {1, 2};
    bench.online();
    bench.write("told");
    bench.write("untold");
    const std::string left = R"({"id":"left","op":"force_on","tag":"running"})";
    bench.command(left);  // a bit, which recovery does not read back
    bench.command(R"({"id":"read","op":"read","tag":"temp"})");
    bench.outbox.push(bench.succeeded("told"));
    bench.step();
    bench.command(R"({"id":"rejected","op":"write","tag":"setpoint","value":5000})");
    bench.command(R"({"id":"dry","op":"write","tag":"setpoint","value":5,"dry_run":true})");
    bench.command(left);
    bench.settle();
    bench.broker.acknowledges = false;
    bench.outbox.push(bench.succeeded("untold"));
    bench.advance(1s);
    first = bench.broker.on(kBase + "/press1/result").at(0);
  }  // no goodbye
  Config config = test::plant();
  config.store.path = scratch.path("store");
  Store store(config.store, 1790000001000);
  const Recovered known = recover(config, store.journal(), 1790000001000, kStart);
  std::set<std::string> ids;
  for (const KnownId& each : known.ids) ids.insert(each.id);
  EXPECT_EQ(ids, (std::set<std::string>{"told", "untold", "left", "read", "rejected"}));
  json then = json::parse(first);
  json now = json::parse(store.journal().find("press1", "told")->result);
  then["t"].erase("total_ms");
  now["t"].erase("total_ms");
  EXPECT_EQ(now, then);
  std::map<std::string, std::string> unacknowledged;
  for (const CommandResult& each : known.unacknowledged) {
    unacknowledged[each.id] = to_string(each.status);
    EXPECT_EQ(each.response_topic, kBase + "/press1/result/hmi");
    EXPECT_EQ(each.correlation, (Bytes{1, 2}));
  }
  EXPECT_EQ(unacknowledged,
            (std::map<std::string, std::string>{
                {"untold", "SUCCEEDED"}, {"left", "UNKNOWN_OUTCOME"}, {"read", "FAILED"}}));
  // A second start finds the same, as long as the results are not acknowledged.
  EXPECT_EQ(recover(config, store.journal(), 1790000001000, kStart).unacknowledged.size(), 3U);
}

TEST(PublisherStore, ResultOfAnEarlierRunIsPublishedAsItWas) {
  const test::Scratch scratch;
  {
    Bench bench(scratch.path("store"));
    bench.response_topic = kBase + "/press1/result/hmi";
    bench.settle();
    bench.command(R"({"id":"left","op":"read","tag":"temp"})");
  }
  Bench bench(scratch.path("store"));
  bench.settle();
  const auto results = bench.broker.on(kBase + "/press1/result");
  ASSERT_EQ(results.size(), 1U);
  EXPECT_EQ(json::parse(results[0])["id"], "left");
  EXPECT_EQ(json::parse(results[0])["status"], "FAILED");
  EXPECT_EQ(bench.broker.on(kBase + "/press1/result/hmi"), results);
  bench.advance(1s);
  EXPECT_TRUE(
      recover(bench.config, bench.store->journal(), bench.utc(), bench.now).unacknowledged.empty());
  bench.write("left");
  bench.settle();
  EXPECT_EQ(bench.results().back()["first"], json::parse(results[0]));
}

/// Returns the audit of the store in this directory, one line per command. Expects an intact chain.
std::vector<json> audit_lines(const std::string& directory) {
  audit::Report report;
  audit::Verifier verifier;
  audit::Head head;
  EXPECT_FALSE(AuditTrail::read(
      store_file_path(directory),
      [&](const audit::Record& record) {
        report.add(record);
        verifier.add(record);
      },
      head));
  EXPECT_TRUE(verifier.finish(head).empty());
  std::vector<json> lines;
  for (const audit::Line& line : report.take()) lines.push_back(json::parse(line.json));
  return lines;
}

TEST_F(PublisherAuditStoredOnlineTest,
       CommandIsWrittenDownBeforeItIsSentAndThenItsFramesAndItsAcknowledgement) {
  std::vector<json> lines;
  bench.on_admitted = [&](const AdmittedCommand&) { lines = audit_lines(scratch.path("store")); };
  bench.command(R"({"id":"a","op":"write","tag":"setpoint","value":50,"by":"anna"})");
  ASSERT_EQ(bench.admitted.size(), 1U);
  ASSERT_EQ(lines.size(), 1U);
  EXPECT_EQ(lines[0]["id"], "a");
  EXPECT_EQ(lines[0]["by"], "anna");
  EXPECT_EQ(lines[0]["topic"], kBase + "/press1/command");
  EXPECT_EQ(lines[0]["received"], 1790000000500);
  EXPECT_EQ(lines[0]["status"], nullptr);

  CommandResult result = bench.succeeded("a");
  result.frames.add(WireFrame::Way::out, Bytes{5});
  result.frames.add(WireFrame::Way::in, Bytes{6});
  bench.broker.acknowledges = false;
  bench.outbox.push(result);
  bench.step();
  lines = audit_lines(scratch.path("store"));
  EXPECT_EQ(lines.at(0)["status"], "SUCCEEDED");
  EXPECT_EQ(lines[0]["plc"], "ACK");
  EXPECT_EQ(lines[0]["frames"], json::parse(R"([{"out":"05"},{"in":"06"}])"));
  EXPECT_EQ(lines[0]["acknowledged"], nullptr);

  bench.broker.acknowledge_all();
  bench.step();
  bench.advance(200ms);
  lines = audit_lines(scratch.path("store"));
  EXPECT_EQ(lines.at(0)["acknowledged"], bench.utc() - 200);
  EXPECT_EQ(lines[0]["records"], json::parse("[1,2,3]"));
}

TEST_F(PublisherAuditStoredOnlineTest, EveryCommandThatWasNeverAdmittedHasItsLineToo) {
  const std::string payloads[] = {R"({"id":"a","op":"write"})", R"({"id":"a","op":"write"})",
                                  "{\xFF no json", std::string(70000, 'x')};
  for (const std::string& payload : payloads) bench.command(payload);
  bench.advance(1s);
  const auto lines = audit_lines(scratch.path("store"));
  ASSERT_EQ(lines.size(), 4U);
  EXPECT_EQ(lines[0]["status"], "REJECTED");
  EXPECT_EQ(lines[1]["status"], "DUPLICATE");
  EXPECT_FALSE(lines[1].contains("first"));
  EXPECT_EQ(lines[2]["payload"], "{\\xff no json");
  EXPECT_EQ(lines[2]["id"], nullptr);
  EXPECT_EQ(lines[3]["payload_bytes"], 70000);
  EXPECT_EQ(lines[3]["payload"].get<std::string>().size(), audit::kPayloadKept);
  for (const json& line : lines) EXPECT_NE(line["acknowledged"], nullptr);
}

TEST_F(PublisherAuditStoredOnlineTest, ResultThatTheBrokerRefusesForGoodIsNotAcknowledged) {
  bench.broker.acknowledges = false;
  bench.command("{}");
  bench.settle();
  bench.broker.refuse_next(0x90);
  bench.settle();
  bench.advance(200ms);
  const auto lines = audit_lines(scratch.path("store"));
  EXPECT_EQ(lines.at(0)["acknowledged"], nullptr);
  EXPECT_EQ(lines[0]["refused_by_broker"], true);
}

// The response topic is a courtesy to the sender: the device's own topic is what the audit is
// about.
TEST(PublisherAudit, DeliveryIsJudgedByTheDevicesOwnTopic) {
  for (const bool own_is_taken : {true, false}) {
    const test::Scratch scratch;
    Bench bench(scratch.path("store"));
    bench.response_topic = kBase + "/press1/result/hmi";
    bench.online();
    bench.broker.acknowledges = false;
    bench.command("{}");
    bench.settle();
    ASSERT_EQ(bench.broker.open(), 2U);
    for (const bool taken : {own_is_taken, !own_is_taken})
      taken ? bench.broker.acknowledge_next() : bench.broker.refuse_next(0x90);
    bench.settle();
    bench.advance(200ms);
    const auto lines = audit_lines(scratch.path("store"));
    EXPECT_EQ(lines.at(0)["acknowledged"].is_null(), !own_is_taken);
    EXPECT_EQ(lines[0].value("refused_by_broker", false), !own_is_taken);
  }
}

TEST(PublisherAudit, CommandThatACrashInterruptedGetsItsOutcomeAndItsAcknowledgement) {
  const test::Scratch scratch;
  {
    Bench bench(scratch.path("store"));
    bench.response_topic = kBase + "/press1/result/hmi";
    bench.online();
    bench.write("left");
  }  // no goodbye
  Bench again(scratch.path("store"));
  again.made();
  // A write: the field reads the target back and reports the outcome.
  ASSERT_EQ(again.admitted.size(), 1U);
  EXPECT_TRUE(again.admitted[0].interrupted);
  const Command& command = again.admitted[0].command;
  EXPECT_EQ(command.id, "left");
  EXPECT_EQ(command.targets.at(0).value, Value(std::int64_t{50}));
  EXPECT_EQ(command.received_ms, 1790000000500);
  EXPECT_EQ(command.response_topic, kBase + "/press1/result/hmi");
  CommandResult result = again.succeeded("left");
  result.status = CommandStatus::unknown_outcome;
  again.report(result);
  again.advance(1s);
  ASSERT_EQ(again.results().size(), 1U);
  EXPECT_TRUE(again.results()[0]["t"]["total_ms"].is_null()) << "it came to an earlier run";
  const auto lines = audit_lines(scratch.path("store"));
  ASSERT_EQ(lines.size(), 1U);
  EXPECT_EQ(lines[0]["status"], "UNKNOWN_OUTCOME");
  EXPECT_EQ(lines[0]["records"], json::parse("[1,2,3]"));
  EXPECT_NE(lines[0]["acknowledged"], nullptr);
  again.store->close();
  again.store.reset();
  Store store(again.config.store, again.utc());
  const Recovered later = recover(again.config, store.journal(), again.utc(), again.now);
  EXPECT_TRUE(later.interrupted.empty());
  EXPECT_EQ(json::parse(store.journal().find("press1", later.ids.at(0).id)->result)["status"],
            "UNKNOWN_OUTCOME");
}

TEST_F(PublisherAuditStoredOnlineTest, HealthPublishesTheHeadOfTheChain) {
  bench.command("{}");
  bench.settle();
  bench.advance(60s);
  const json health = bench.last("/health");
  EXPECT_EQ(health["audit"]["records"], 2);
  EXPECT_EQ(health["audit"]["head"], to_text(bench.store->audit().head().hash));
  Bench without;
  without.settle();
  EXPECT_EQ(json::parse(without.broker.on(kBase + "/health").at(0))["audit"], nullptr);
}

TEST_F(PublisherOnlineTest, ResultComesOnceAndAgainUntilItIsAcknowledged) {
  bench.report(test::succeeded("a"));
  bench.advance(2h);
  EXPECT_EQ(bench.broker.on(kBase + "/press1/result").size(), 1U);

  bench.broker.acknowledges = false;
  bench.report(test::succeeded("b"));
  bench.lose_connection();
  bench.broker.acknowledges = true;
  bench.broker.log.clear();
  bench.advance(2s);
  const auto results = bench.broker.on(kBase + "/press1/result");
  ASSERT_EQ(results.size(), 1U);
  EXPECT_EQ(json::parse(results[0])["id"], "b");
  EXPECT_EQ(bench.broker.log.at(0).topic, kBase + "/press1/result");  // before the states
  EXPECT_EQ(bench.broker.log.at(0).retain, Retain::no);
}

TEST_F(PublisherOnlineTest, TotalEndsWhenTheResultIsFirstHandedOver) {
  CommandResult result = test::succeeded("a");
  result.received = bench.now;
  bench.lose_connection();
  bench.outbox.push(result);
  bench.now += 700ms;
  bench.step();
  bench.advance(1300ms);
  const auto results = bench.broker.on(kBase + "/press1/result");
  ASSERT_EQ(results.size(), 1U);
  EXPECT_EQ(json::parse(results[0])["t"]["total_ms"], 2000);
}

TEST_F(PublisherOnlineTest, ResultGoesToTheResponseTopicTooAndItsCorrelationToBoth) {
  CommandResult result = test::succeeded("a");
  result.response_topic = kBase + "/press1/result/hmi";
  result.correlation = {1, 2, 3};
  bench.outbox.push(result);
  result.response_topic = kBase + "/press2/state";  // would overwrite a state
  bench.report(result);
  ASSERT_EQ(bench.broker.taken.size(), 3U);
  EXPECT_EQ(bench.broker.taken[0].topic, kBase + "/press1/result");
  EXPECT_EQ(bench.broker.taken[0].correlation, (Bytes{1, 2, 3}));
  EXPECT_EQ(bench.broker.taken[1].topic, kBase + "/press1/result/hmi");
  EXPECT_EQ(bench.broker.taken[1].correlation, (Bytes{1, 2, 3}));
  EXPECT_EQ(bench.broker.taken[1].payload, bench.broker.taken[0].payload);
  EXPECT_EQ(bench.broker.taken[2].topic, kBase + "/press1/result");
}

TEST_F(PublisherTest, ResultComesWithoutItsCorrelationWhereTheBrokerDoesNotTakeBoth) {
  bench.broker.maximum_packet = 2000;
  bench.online();
  CommandResult result = test::succeeded("a");
  result.correlation = Bytes(1900, 7);
  bench.report(result);
  ASSERT_EQ(bench.broker.taken.size(), 1U);
  EXPECT_EQ(bench.broker.taken[0].topic, kBase + "/press1/result");
  EXPECT_TRUE(bench.broker.taken[0].correlation.empty());
  EXPECT_EQ(json::parse(bench.broker.taken[0].payload)["id"], "a");
}

TEST_F(PublisherOnlineTest, CommandReachesTheFieldWithItsTimes) {
  Message message = test::message_on(kBase + "/press2/command",
                                     R"({"id":"a","op":"write","tag":"setpoint","value":50})");
  message.response_topic = "r";
  message.correlation = {9};
  message.message_expiry = 5s;
  message.received = bench.now - 3ms;
  message.received_ms = 42;
  bench.broker.send(message);
  bench.step();
  ASSERT_EQ(bench.admitted.size(), 1U);
  const Command& command = bench.admitted[0].command;
  EXPECT_EQ(command.device, 1U);
  EXPECT_EQ(command.id, "a");
  EXPECT_EQ(command.response_topic, "r");
  EXPECT_EQ(command.correlation, Bytes{9});
  EXPECT_EQ(command.message_expiry, 5s);
  EXPECT_EQ(command.received, bench.now - 3ms);
  EXPECT_EQ(command.received_ms, 42);
  EXPECT_EQ(bench.admitted[0].deadline, bench.now - 3ms + 5s);
}

TEST_F(PublisherOnlineTest, RetainedCommandIsRefused) {
  Message message = test::message_on(kBase + "/press1/command",
                                     R"({"id":"a","op":"write","tag":"setpoint","value":50})",
                                     /*retained=*/true);
  message.received = bench.now;
  bench.broker.send(message);
  bench.settle();
  EXPECT_TRUE(bench.admitted.empty());
  EXPECT_EQ(bench.results().at(0)["reason"], "retained");
}

TEST_F(PublisherOnlineTest, CommandOnATopicOfNoDeviceIsIgnored) {
  bench.command(R"({"id":"a","op":"run"})", kBase + "/Press9/command");
  bench.command(R"({"id":"a","op":"run"})", kBase + "/press1/x/command");
  bench.settle();
  EXPECT_TRUE(bench.admitted.empty());
  EXPECT_TRUE(bench.broker.log.empty());
}

TEST_F(PublisherOnlineTest, EmptyRetainedPayloadOnlyClearsTheTopic) {
  Message message;
  message.topic = kBase + "/press1/command";
  message.retained = true;
  bench.broker.send(message);
  bench.settle();
  EXPECT_TRUE(bench.results().empty());
  bench.command("");  // not retained, MQTT 5: an empty command is invalid
  bench.settle();
  ASSERT_EQ(bench.results().size(), 1U);
  EXPECT_EQ(bench.results()[0]["reason"], "bad_json");
  bench.config.mqtt.version = 4;  // 3.1.1 does not deliver the flag
  bench.command("");
  bench.settle();
  EXPECT_EQ(bench.results().size(), 1U);
}

TEST_F(PublisherOnlineTest, CommandDuringTheEndIsAnswered) {
  bench.broker.acknowledges = false;
  bench.made().stop(bench.now);
  bench.outbox.push(test::sample(1));
  bench.step();
  bench.write("late");
  EXPECT_TRUE(bench.admitted.empty());
  const auto results = bench.results();
  ASSERT_EQ(results.size(), 1U);
  EXPECT_EQ(results[0]["reason"], "shutting_down");
  EXPECT_EQ(results[0]["id"], "late");
}

/// A profile on another broker, whose commands the publisher carries out.
struct PublisherOutletTest : test::OnBench {
  PublisherOutletTest() {
    ProfileConfig what;
    what.broker = "cloud";
    profile.emplace(bench.config, what, "9f3c21aa", "0.1.0", 0, [this](RelayedCommand command) {
      bench.made().take_relayed(std::move(command), bench.now);
    });
    Outlet::Settings settings;
    settings.mqtt = bench.config.mqtt;
    outlet.emplace(
        bench.config, settings, *profile, cloud, [this] { return bench.utc(); }, nullptr);
    bench.made().add(*outlet);
  }
  /// The other broker delivers a command as the agent begins to stop.
  void send_late() {
    cloud.log.clear();
    cloud.send(test::message_on(kBase + "/press1/command",
                                R"({"id":"late","op":"write","tag":"setpoint","value":1})"));
  }

  test::FakeBroker cloud;
  std::optional<JsonProfile> profile;
  std::optional<Outlet> outlet;
};

TEST_F(PublisherOutletTest, CommandOfAProfileDuringTheEndIsAnsweredAtItsBroker) {
  bench.online();
  send_late();
  bench.stop_without_spinning(10);
  const auto result = std::ranges::find(cloud.log, kBase + "/press1/result", &Publication::topic);
  ASSERT_NE(result, cloud.log.end());
  EXPECT_EQ(json::parse(result->payload)["reason"], "shutting_down");
  EXPECT_EQ(cloud.log.back().topic, kBase + "/state") << "the farewell";
}

TEST_F(PublisherOutletTest, StopDoesNotWaitForACommandOfAProfileThatNobodyAnswers) {
  bench.broker.reachable = false;  // so the session of mqtt ends at once
  bench.advance(1s);
  ASSERT_TRUE(cloud.up());
  send_late();
  const SteadyTime begin = bench.now;
  bench.stop_without_spinning(10);
  EXPECT_EQ(bench.now, begin);
}

TEST_F(PublisherOnlineTest, CommandIsRefusedOnceTheFieldIsToStop) {
  bench.outbox.refuse_commands();
  bench.write("late");
  bench.settle();
  EXPECT_TRUE(bench.admitted.empty());
  EXPECT_EQ(bench.results().at(0)["status"], "REJECTED");
  EXPECT_EQ(bench.results()[0]["reason"], "shutting_down");
}

TEST_F(PublisherTest, CommandIsJudgedByTheModelThatTheFieldHasFound) {
  bench.config.devices[0].commands.allow = {*test::codec()->addresses().parse_range("D5000")};
  bench.online();
  const std::string far = R"("op":"read","address":"D5000"})";
  bench.command(R"({"id":"a",)" + far);
  DeviceStatus status = test::offline(0, "starting");
  status.codec = std::make_shared<const fx::ProgrammingPort>(
      fx::ProgrammingPort::Settings{.model = fx::Model::fx1s});
  bench.outbox.push(status);
  bench.step();
  bench.command(R"({"id":"b",)" + far);
  bench.settle();
  ASSERT_EQ(bench.admitted.size(), 1U);
  EXPECT_EQ(bench.admitted[0].codec, test::codec());
  EXPECT_EQ(bench.results().at(0)["id"], "b");
  EXPECT_EQ(bench.results()[0]["reason"], "bad_address");
}

TEST_F(PublisherOnlineTest, ListDuringTheEndIsAnsweredAsAList) {
  bench.broker.acknowledges = false;
  bench.made().stop(bench.now);
  bench.outbox.push(test::sample(1));
  bench.step();
  const std::string list = R"("op":"write","targets":[{"tag":"setpoint","value":1}])";
  bench.command(R"({"id":"late",)" + list + "}");
  bench.command(R"({"id":"dry","dry_run":true,)" + list + "}");
  const auto results = bench.results();
  ASSERT_EQ(results.size(), 2U);
  EXPECT_EQ(results[0]["reason"], "shutting_down");
  ASSERT_EQ(results[0]["targets"].size(), 1U);
  EXPECT_EQ(results[0]["targets"][0]["reason"], "shutting_down");
  EXPECT_EQ(results[1]["dry_run"], true);
  EXPECT_EQ(results[1]["status"], "SUCCEEDED") << "it would have been admitted";
}

TEST_F(PublisherFloodTest, ResultsOfTheFieldMakeRoomBeforeTheNextCommandsAreLookedAt) {
  bench.config.devices[0].commands.queue = 1;
  bench.online();
  bench.write("a");
  bench.write("b");
  bench.outbox.push(bench.succeeded("a"));
  bench.write("c");
  bench.settle();
  EXPECT_EQ(bench.admitted.size(), 3U);
}

// ---- floods

CommandResult refused(std::string id) {
  CommandResult result;
  result.id = std::move(id);
  result.status = CommandStatus::rejected;
  result.reason = Reason::unknown_tag;
  return result;
}

Message message(std::size_t number, std::string payload, int qos = 1) {
  Message made = test::message_on(kBase + "/press1/command", std::move(payload));
  made.qos = qos;
  made.received = kStart;
  made.received_ms = 1790000000500 + static_cast<std::int64_t>(number);
  return made;
}

/// Of 185,000 bytes.
Message large_message() {
  Message large = message(1, R"({"id":"x","op":"run","by":")" + std::string(60000, 'x') + R"("})");
  large.response_topic = std::string(60000, 't');
  large.correlation = Bytes(65000, 1);
  return large;
}

void push_refused(Bench& bench, int results) {
  for (int i = 0; i < results; ++i) bench.outbox.push(refused(std::to_string(i)));
}

/// Results that the broker does not acknowledge.
void flood(Bench& bench, int results) {
  bench.broker.acknowledges = false;
  push_refused(bench, results);
  bench.step();
}

void send_runs(Bench& bench, std::size_t messages) {
  for (std::size_t i = 0; i < messages; ++i)
    bench.broker.send(message(i, R"({"id":"x","op":"run"})"));
}

TEST_F(PublisherOnlineTest, WhatWasReadBeforeAWriteGoesBeforeItsResult) {
  bench.write("a");
  bench.outbox.push(test::sample(1));
  CommandResult result = bench.succeeded("a");
  result.attempts = 1;
  bench.outbox.push(std::move(result));
  bench.step();
  ASSERT_EQ(bench.broker.log.size(), 2U);
  EXPECT_EQ(bench.broker.log[0].topic, kBase + "/press1/data/fast");
  EXPECT_EQ(bench.broker.log[1].topic, kBase + "/press1/result");
}

TEST_F(PublisherOnlineTest, WhatWasReadBeforeAWriteAndFindsNoRoomBeforeItsResultIsHistory) {
  bench.write("a");
  bench.broker.acknowledges = false;
  for (std::uint64_t i = 1; i <= 30; ++i) bench.outbox.push(test::sample(i));
  CommandResult result = bench.succeeded("a");
  result.attempts = 1;
  bench.outbox.push(std::move(result));
  bench.step();
  EXPECT_EQ(bench.results().size(), 1U) << "places stay free for results";
  const auto before = bench.broker.on(kBase + "/press1/data/fast").size();
  EXPECT_LT(before, 30U);
  bench.broker.acknowledges = true;
  bench.acknowledge_all();
  EXPECT_EQ(bench.broker.on(kBase + "/press1/data/fast").size(), before);
  EXPECT_EQ(bench.history().size(), 30U - before);
}

TEST_F(PublisherFloodOnlineTest, SamplesGoOutBetweenCommands) {
  send_runs(bench, 1000);
  bench.outbox.push(test::sample(1));
  EXPECT_EQ(bench.step(), bench.now) << "it is stepped again at once";
  EXPECT_EQ(bench.broker.on(kBase + "/press1/data/fast").size(), 1U);
  EXPECT_LT(bench.results().size(), 100U);
  bench.settle();
  EXPECT_EQ(bench.results().size(), 1000U);
}

TEST_F(PublisherFloodOnlineTest, ResultsLeaveAPartOfTheWindowToSamples) {
  flood(bench, 100);
  EXPECT_EQ(bench.broker.open(), 15U);
  bench.outbox.push(test::sample(1));
  bench.step();
  EXPECT_EQ(bench.broker.on(kBase + "/press1/data/fast").size(), 1U);
  while (bench.broker.open() != 0) {
    bench.broker.acknowledge_next();
    bench.step();
  }
  EXPECT_EQ(bench.broker.on(kBase + "/press1/result").size(), 100U);
}

TEST_F(PublisherFloodTest, WindowOfOneIsSharedInTurn) {
  bench.broker.receive_maximum = 1;
  bench.online();
  bench.broker.acknowledges = false;
  push_refused(bench, 10);
  for (std::uint64_t i = 1; i <= 10; ++i) bench.outbox.push(test::sample(i));
  bench.step();
  for (int i = 0; i < 10; ++i) {
    bench.broker.acknowledge_next();
    bench.step();
  }
  const auto samples = bench.broker.on(kBase + "/press1/data/fast").size();
  const auto results = bench.broker.on(kBase + "/press1/result").size();
  EXPECT_GE(samples, 4U);
  EXPECT_GE(results, 4U);
}

TEST_F(PublisherFloodOnlineTest, MessagesStayInTheNetworkWhileOthersWaitToBeLookedAt) {
  send_runs(bench, 300);
  bench.step();
  EXPECT_TRUE(bench.broker.held);
  bench.settle();
  EXPECT_FALSE(bench.broker.held);
  EXPECT_EQ(bench.results().size(), 300U);
}

TEST_F(PublisherFloodOnlineTest, FewLargeCommandsAreEnoughToHoldTheOthersBack) {
  for (int i = 0; i < 60; ++i) bench.broker.send(large_message());
  bench.step();
  EXPECT_TRUE(bench.broker.held);
}

// Acknowledgements arrive behind the messages that are held back.
TEST_F(PublisherFloodOnlineTest, WaitingResultsHoldMessagesBackAndLetSomeInForWhatComesBehind) {
  bench.broker.acknowledges = false;
  push_refused(bench, 1000);
  for (int i = 0; i < 100; ++i) {
    bench.now += 1ms;
    bench.step();
    EXPECT_TRUE(bench.broker.held);
  }
  EXPECT_GE(bench.broker.let_in, 100U);
  EXPECT_LE(bench.broker.let_in, 500U) << "fewer than can be answered";
  bench.broker.acknowledges = true;
  bench.acknowledge_all();
  EXPECT_FALSE(bench.broker.held);
  EXPECT_EQ(bench.broker.on(kBase + "/press1/result").size(), 1000U) << "none is dropped";
}

/// Results are pending while messages are held back. Delivers this many messages before the next
/// result is acknowledged.
void acknowledge_behind(Bench& bench, std::size_t messages,
                        const Message& each = message(0, R"({"id":"x","op":"run"})")) {
  bench.settle();
  flood(bench, 2100);
  bench.broker.acknowledge_all();
  bench.step();
  ASSERT_TRUE(bench.broker.held);
  for (std::size_t i = 0; i < messages; ++i) bench.broker.send(each);
  bench.step();
}

TEST_F(PublisherFloodTest, BrokerThatSendsFarAheadIsAskedForOneAtATime) {
  acknowledge_behind(bench, 1000);
  EXPECT_EQ(bench.broker.disconnects, 1);
  ASSERT_EQ(bench.broker.connects.size(), 1U) << "what was read is taken first";
  bench.broker.acknowledges = true;
  bench.broker.send(message(1000, R"({"id":"read meanwhile","op":"run"})"));
  bench.settle();
  bench.advance(1s);
  EXPECT_TRUE(bench.broker.up());
  EXPECT_EQ(bench.broker.sends_ahead, 1);
  EXPECT_EQ(bench.broker.connects, (std::vector<std::size_t>{0, 0})) << "the same server";
  std::set<std::string> told;
  for (const Publication& taken : bench.broker.taken)
    if (taken.topic == kBase + "/press1/result") told.insert(json::parse(taken.payload)["id"]);
  EXPECT_EQ(told.size(), 2102U) << "no result is lost with the connection";
  EXPECT_TRUE(told.contains("x"));
  EXPECT_TRUE(told.contains("read meanwhile"));
}

TEST_F(PublisherFloodTest, OneMessageAtATimeIsTheLeastThatIsAskedFor) {
  acknowledge_behind(bench, 1000);
  bench.advance(1s);
  acknowledge_behind(bench, 1000);
  EXPECT_TRUE(bench.broker.up());
  EXPECT_EQ(bench.broker.connects.size(), 2U);
}

TEST_F(PublisherFloodTest, StopWhileItConnectsAnewSaysGoodbye) {
  acknowledge_behind(bench, 1000);
  bench.broker.acknowledges = true;
  bench.made().stop(bench.now);
  for (int i = 0; i < 100 && !bench.publisher->finished(); ++i) bench.settle();
  EXPECT_TRUE(bench.publisher->finished());
  EXPECT_EQ(bench.last("/state")["state"], "offline");
}

TEST_F(PublisherFloodTest, NextConnectionAfterALossMaySendAheadAgain) {
  acknowledge_behind(bench, 1000);
  bench.advance(1s);
  ASSERT_EQ(bench.broker.sends_ahead, 1);
  bench.lose_connection();
  bench.advance(5s);
  EXPECT_EQ(bench.broker.sends_ahead, kReceiveMaximum);
}

TEST_F(PublisherFloodTest, BurstThatTheBrokerSendsAheadKeepsItsConnection) {
  bench.settle();
  flood(bench, 500);
  bench.broker.acknowledge_all();
  bench.step();
  ASSERT_TRUE(bench.broker.held);
  for (int i = 0; i < 1000; ++i) bench.broker.send(message(0, R"({"id":"x","op":"run"})"));
  bench.step();
  EXPECT_TRUE(bench.broker.up());
}

TEST_F(PublisherFloodTest, BrokerThatIsSlowWithItsPubackKeepsItsConnection) {
  acknowledge_behind(bench, 20 * kReceiveMaximum);
  EXPECT_TRUE(bench.broker.up());
}

TEST(PublisherFlood, FewLargeMessagesAreFarAheadToo) {
  for (const std::size_t messages : {20U, 50U}) {
    Bench bench;
    acknowledge_behind(bench, messages, large_message());
    EXPECT_EQ(bench.broker.disconnects, messages == 50 ? 1 : 0) << "9 MiB are, 4 MiB are not";
  }
}

TEST_F(PublisherFloodTest, MessagesWithQosZeroAreNotFarAhead) {
  acknowledge_behind(bench, 3000, message(0, R"({"id":"x","op":"run"})", 0));
  EXPECT_TRUE(bench.broker.up()) << "the broker waits for none of them";
}

TEST_F(PublisherFloodTest, WhatCameBeforeMessagesWereHeldBackDoesNotCount) {
  bench.settle();
  flood(bench, 1000);
  send_runs(bench, 1000);
  bench.step();
  bench.broker.acknowledge_next();
  bench.step();
  EXPECT_TRUE(bench.broker.up());
}

TEST_F(PublisherFloodTest, ConnectionIsKeptWhereMqttHasNoReceiveMaximum) {
  bench.config.mqtt.version = 4;
  acknowledge_behind(bench, 1000);
  EXPECT_TRUE(bench.broker.up());
}

TEST_F(PublisherFloodTest, SubackComesThroughWhereMessagesAreHeldBack) {
  bench.broker.confirms = false;
  bench.broker.acknowledges = false;
  push_refused(bench, 1000);
  bench.settle();
  ASSERT_TRUE(bench.broker.up());
  EXPECT_TRUE(bench.broker.held);
  EXPECT_GT(bench.broker.let_in, 0U);
}

TEST_F(PublisherFloodTest, ResultsThatFillTheirRoomEndTheSubscriptionUntilHalfOfThemAreOut) {
  bench.settings.result_bytes = 100000;
  bench.online();
  const std::string commands = kBase + "/+/command";
  flood(bench, 1000);
  EXPECT_FALSE(bench.broker.filters.contains(commands));
  bench.advance(10s);
  EXPECT_FALSE(bench.broker.filters.contains(commands)) << "nobody has taken any";
  std::size_t out_when_heard = 0;
  while (bench.broker.open() != 0) {
    bench.broker.acknowledge_next();
    bench.now += 20ms;
    bench.step();
    if (out_when_heard == 0 && bench.broker.filters.contains(commands))
      out_when_heard = bench.broker.taken.size();
  }
  // The results were several times the limit.
  EXPECT_GT(out_when_heard, 800U);
  EXPECT_LT(out_when_heard, 1000U);
  bench.broker.acknowledges = true;
  bench.settle();
  const auto states = bench.broker.on(kBase + "/state");
  ASSERT_EQ(states.size(), 2U) << "once not heard, once heard";
  EXPECT_EQ(json::parse(states[0])["reason"], "more commands arrive than the agent can answer");
  EXPECT_FALSE(json::parse(states[1]).contains("reason"));
  EXPECT_EQ(bench.broker.on(kBase + "/press1/result").size(), 1000U);
}

TEST_F(PublisherFloodTest, PauseEndsWithItsConnection) {
  bench.settings.result_bytes = 100000;
  bench.online();
  flood(bench, 1000);
  ASSERT_FALSE(bench.broker.filters.contains(kBase + "/+/command"));
  bench.broker.lose();
  bench.step();
  bench.broker.acknowledges = true;
  bench.advance(5s);
  bench.advance(2s);
  EXPECT_TRUE(bench.broker.filters.contains(kBase + "/+/command"));
  EXPECT_FALSE(bench.last("/state").contains("reason"));
}

TEST_F(PublisherFloodOnlineTest, ResultsThatAreRefusedKeepNobodyAwake) {
  flood(bench, 300);
  while (bench.broker.open() != 0) {
    bench.broker.refuse_next(0x97);
    bench.step();
  }
  ASSERT_TRUE(bench.broker.held);
  EXPECT_GT(bench.step() - bench.now, 5ms);
}

TEST_F(PublisherFloodOnlineTest, OfQosZeroOnlyAsMuchIsTakenAsCanBeAnswered) {
  for (std::size_t i = 0; i < 5000; ++i)
    bench.broker.send(message(i, R"({"id":"x","op":"run"})", 0));
  bench.broker.send(message(5000, R"({"id":"asked","op":"run"})", 1));
  bench.settle();
  EXPECT_LT(bench.results().size(), 300U);
  EXPECT_EQ(bench.results().back()["id"], "asked") << "what the broker waits for is never lost";
}

TEST_F(PublisherFloodOnlineTest, OfQosZeroNothingIsTakenWhileResultsAreFull) {
  flood(bench, 300);
  for (std::size_t i = 0; i < 10; ++i) bench.broker.send(message(i, R"({"id":"x","op":"run"})", 0));
  bench.step();
  bench.broker.acknowledges = true;
  bench.acknowledge_all();
  EXPECT_EQ(bench.results().size(), 300U);
}

TEST_F(PublisherFloodOnlineTest, NothingIsHeldBackAtTheEnd) {
  flood(bench, 1000);
  ASSERT_TRUE(bench.broker.held);
  bench.made().stop(bench.now);
  bench.step();
  EXPECT_FALSE(bench.broker.held);
}

}  // namespace
}  // namespace fxagent
