#include "agent/remote/remote_config.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include "tests/agent/remote/remote_run.h"

namespace fxagent {
namespace {

using namespace test;
using namespace std::chrono_literals;
using Why = RemoteConfig::Next::Why;

struct RemoteConfigTest : ::testing::Test {
  Plant plant;
};

struct RemoteConfigAfterV1 : RemoteConfigTest {
  RemoteConfigAfterV1() { plant.hear(plant.with_retries("v1", 7)); }
};

struct RemoteConfigAfterGoodV1 : RemoteConfigAfterV1 {
  RemoteConfigAfterGoodV1() { plant.pass(kTrial); }
};

TEST_F(RemoteConfigTest, WithoutAWordTheLocalFileIsReported) {
  const json report = plant.reported();
  EXPECT_EQ(report["version"], nullptr);
  EXPECT_EQ(report["state"], "applied");
  EXPECT_EQ(report["hash"], plant.in_force().hash);
  EXPECT_EQ(report["since"], 1'790'000'000'000);
  EXPECT_EQ(report["errors"], json::array());
  EXPECT_FALSE(std::filesystem::exists(plant.kept_path()));
}

TEST_F(RemoteConfigTest, WhatIsRightIsAppliedAndGoodAfterItsTrial) {
  EXPECT_TRUE(plant.hear(plant.with_retries("v1", 7)));
  EXPECT_EQ(plant.retries(), 7);
  EXPECT_EQ(plant.said(), "applied \"v1\"");
  EXPECT_EQ(plant.reported()["confirmed"], false);
  EXPECT_TRUE(plant.remote().take_news());
  EXPECT_FALSE(plant.pass(59s));
  EXPECT_EQ(plant.reported()["confirmed"], false);
  EXPECT_FALSE(plant.pass(1s));
  EXPECT_TRUE(plant.remote().answer().is_due());
  EXPECT_EQ(plant.reported()["confirmed"], true);
  EXPECT_EQ(plant.reported()["since"], 1'790'000'000'000);
  plant.pass(1h);
  EXPECT_EQ(plant.remote().next_wake(), SteadyTime::max());
  plant.connection(false);
  EXPECT_FALSE(plant.pass(1h));  // a later outage proves nothing
  EXPECT_EQ(plant.retries(), 7);
}

TEST_F(RemoteConfigAfterV1, TheSameAgainIsAnsweredAndNotAppliedAgain) {
  plant.remote().take_news();
  EXPECT_FALSE(plant.hear(plant.with_retries("v1", 7)));
  EXPECT_TRUE(plant.remote().answer().is_due());
  EXPECT_FALSE(plant.remote().take_news());
  EXPECT_TRUE(plant.hear(plant.with_retries("v2", 7)));
}

TEST_F(RemoteConfigAfterGoodV1, AWrongOneChangesNothingAndEveryErrorIsSaid) {
  json wrong = plant.with_retries("v2", 99);
  wrong["config"]["devices"][0]["tags"][0]["address"] = "X8";
  wrong["config"]["store"] = nullptr;
  EXPECT_FALSE(plant.hear(wrong));
  EXPECT_EQ(plant.retries(), 7);
  const json report = plant.reported();
  EXPECT_EQ(report["state"], "rejected");
  EXPECT_EQ(report["version"], "v2");
  EXPECT_EQ(report["errors"].size(), 3u) << report;
  EXPECT_EQ(report["errors_in_all"], 3);
  EXPECT_EQ(report["in_force"], "v1");
  EXPECT_EQ(report["hash"], plant.in_force().hash);
  plant.remote().take_news();
  EXPECT_FALSE(plant.hear(wrong));
  EXPECT_FALSE(plant.remote().take_news());
  // The answer reports the state of the config in force.
  EXPECT_FALSE(plant.hear(plant.with_retries("v1", 7)));
  EXPECT_EQ(plant.said(), "applied \"v1\"");
}

TEST_F(RemoteConfigTest, ManyErrorsAreCutAndCounted) {
  json wrong = plant.with_retries("v1", 1);
  for (int i = 0; i < 3000; ++i)
    wrong["config"]["devices"][0]["tags"].push_back(
        {{"name", "t" + std::to_string(i)}, {"address", "X8"}});
  EXPECT_FALSE(plant.hear(wrong));
  const std::string text = plant.remote().report_text("");
  EXPECT_LT(text.size(), 2 * kMostReportedBytes);
  const json report = json::parse(text);
  EXPECT_EQ(report["errors"][0], "2000 more are not listed");
  EXPECT_EQ(report["errors_in_all"], 1001);
}

TEST_F(RemoteConfigAfterGoodV1, TheBrokerLostIsRolledBackAndNotTriedAgain) {
  plant.hear(plant.with_retries("v2", 8));
  plant.pass(10s);
  plant.connection(false);
  EXPECT_FALSE(plant.pass(59s));
  EXPECT_TRUE(plant.pass(1s));
  EXPECT_EQ(plant.retries(), 7);
  EXPECT_EQ(plant.said(),
            "rolled_back \"v2\": the broker was lost for 60 s while the config was on trial");
  EXPECT_EQ(plant.reported()["in_force"], "v1");
  plant.connection(true);
  plant.remote().take_news();
  EXPECT_FALSE(plant.hear(plant.with_retries("v2", 8)));
  EXPECT_EQ(plant.said().substr(0, 16), "rolled_back \"v2\"");
  EXPECT_FALSE(plant.remote().take_news());
  plant.start();
  EXPECT_EQ(plant.retries(), 7);
  EXPECT_FALSE(plant.hear(plant.with_retries("v2", 8)));
  EXPECT_TRUE(plant.hear(plant.with_retries("v3", 8)));  // the desired config has changed
}

TEST_F(RemoteConfigTest, WithoutAGoodOneTheLocalFileIsTheWayBack) {
  plant.connection(false);
  EXPECT_TRUE(plant.hear(plant.with_retries("v1", 7)));
  EXPECT_TRUE(plant.pass(kTrial));
  EXPECT_EQ(plant.retries(), 2);
  EXPECT_EQ(plant.reported()["in_force"], nullptr);
}

TEST_F(RemoteConfigAfterGoodV1, AProcessThatEndsInTheTrialIsRolledBack) {
  plant.hear(plant.with_retries("v2", 8));
  plant.start();
  EXPECT_EQ(plant.retries(), 7);
  EXPECT_EQ(plant.said(), "rolled_back \"v2\": the process ended during the trial of the config");
  EXPECT_TRUE(plant.remote().take_news());
  plant.start();
  EXPECT_EQ(plant.said().substr(0, 11), "rolled_back");
  EXPECT_FALSE(plant.remote().take_news());  // already reported
}

TEST_F(RemoteConfigAfterV1, AStopInTheTrialProvesNothing) {
  plant.stop();
  plant.start(/*is_connected=*/false);
  EXPECT_EQ(plant.retries(), 7);
  EXPECT_EQ(plant.reported()["confirmed"], false);
  plant.connection(true);
  plant.pass(kTrial);
  EXPECT_EQ(plant.reported()["confirmed"], true);
  plant.stop();
  plant.start();
  EXPECT_EQ(plant.retries(), 7);
}

TEST_F(RemoteConfigAfterV1, AStopIsGoodForOneStart) {
  plant.stop();
  plant.start();
  plant.start();  // the previous start has crashed
  EXPECT_EQ(plant.retries(), 2);
  EXPECT_EQ(plant.said().substr(0, 11), "rolled_back");
}

TEST_F(RemoteConfigAfterGoodV1, AStartWithoutBrokerUsesTheGoodOne) {
  plant.start(/*is_connected=*/false);
  EXPECT_EQ(plant.retries(), 7);
  EXPECT_FALSE(plant.pass(1h));
  EXPECT_EQ(plant.said(), "applied \"v1\"");
  EXPECT_EQ(plant.reported()["since"], 1'790'000'000'000);
}

TEST_F(RemoteConfigTest, AnEmptyDocumentWithdraws) {
  EXPECT_FALSE(plant.hear_text(""));
  plant.hear(plant.with_retries("v1", 7));
  plant.pass(kTrial);
  EXPECT_TRUE(plant.hear_text(""));
  EXPECT_EQ(plant.retries(), 2);
  EXPECT_EQ(plant.said(), "applied null");
  EXPECT_FALSE(std::filesystem::exists(plant.kept_path()));
  plant.start();
  EXPECT_EQ(plant.retries(), 2);
  // A withdrawn config may be sent again.
  EXPECT_TRUE(plant.hear(plant.with_retries("v1", 7)));
}

TEST_F(RemoteConfigTest, TheLocalFileIsTheBaseOfBoth) {
  json document = {{"version", "v1"}, {"patch", {{"templates", {{"t", {{"retries", 1}}}}}}}};
  plant.local()["templates"]["t"] = {{"retries", 4}, {"gap_ms", 3}};
  plant.local()["devices"][0]["template"] = "t";
  plant.write();
  EXPECT_TRUE(plant.hang_up());
  EXPECT_EQ(plant.retries(), 4);
  EXPECT_TRUE(plant.hear(document));
  EXPECT_EQ(plant.retries(), 1);
  plant.local()["templates"]["t"]["gap_ms"] = 5;
  plant.write();
  EXPECT_EQ(plant.in_force().devices[0].gap, 3ms);  // the file was not reloaded yet
  EXPECT_TRUE(plant.hang_up());
  EXPECT_EQ(plant.retries(), 1);
  EXPECT_EQ(plant.in_force().devices[0].gap, 5ms);
  EXPECT_EQ(plant.said(), "applied \"v1\"");
}

TEST_F(RemoteConfigTest, WhereItNoLongerFitsTheLocalFileWins) {
  json document = plant.with_retries("v1", 7);
  plant.hear(document);
  plant.pass(kTrial);
  plant.set("/agent/remote_allow", {"links"});
  EXPECT_TRUE(plant.hang_up());
  EXPECT_EQ(plant.retries(), 2);
  EXPECT_EQ(plant.reported()["state"], "rejected");
  EXPECT_NE(plant.said().find("remote_allow"), std::string::npos) << plant.said();
  plant.start();
  EXPECT_EQ(plant.retries(), 2);
  // The local file permits it again: a rejected document is judged once more.
  plant.hear(document);
  plant.set("/agent/remote_allow", {"devices"});
  EXPECT_TRUE(plant.hang_up());
  EXPECT_EQ(plant.remote().answer().rejected(), document.dump());
  EXPECT_TRUE(plant.hear_text(std::string(plant.remote().answer().rejected())));
  EXPECT_EQ(plant.retries(), 7);
}

TEST_F(RemoteConfigAfterGoodV1, AKeptOneThatNoLongerFitsAtTheStartIsLeftOut) {
  plant.set("/agent/remote_allow", json::array());
  plant.start();
  EXPECT_EQ(plant.retries(), 2);
  EXPECT_EQ(plant.reported()["state"], "rejected");
}

TEST_F(RemoteConfigAfterGoodV1, SwitchedOffNothingOfItStays) {
  plant.set("/agent/remote_config", false);
  EXPECT_TRUE(plant.hang_up());
  EXPECT_EQ(plant.retries(), 2);
  EXPECT_FALSE(plant.remote().is_enabled());
  EXPECT_FALSE(plant.remote().status().has_value());
  EXPECT_FALSE(std::filesystem::exists(plant.kept_path()));
  EXPECT_FALSE(plant.hear(plant.with_retries("v2", 8)));
  plant.set("/agent/remote_config", true);
  EXPECT_TRUE(plant.hang_up());
  EXPECT_TRUE(plant.hear(plant.with_retries("v1", 7)));
}

TEST_F(RemoteConfigTest, ADiskThatRefusesDecidesAsTheLocalFileAsks) {
  std::ofstream(plant.store()) << "no directory";
  EXPECT_FALSE(plant.hear(plant.with_retries("v1", 7)));
  EXPECT_EQ(plant.retries(), 2);
  EXPECT_NE(plant.said().find("remote_without_disk"), std::string::npos) << plant.said();
  plant.set("/agent/remote_without_disk", true);
  plant.hang_up();
  EXPECT_TRUE(plant.hear(plant.with_retries("v1", 7)));
  EXPECT_EQ(plant.retries(), 7);
  EXPECT_EQ(plant.said(), "applied \"v1\"");
}

TEST_F(RemoteConfigAfterV1, WhatTheDiskRefusedIsWrittenLater) {
  plant.take_disk();
  plant.pass(kTrial);
  EXPECT_EQ(plant.reported()["confirmed"], true);
  plant.give_disk();
  EXPECT_NE(plant.remote().next_wake(), SteadyTime::max());
  plant.pass(60s);
  plant.pass(1h);
  EXPECT_EQ(plant.remote().next_wake(), SteadyTime::max());
  plant.start();
  EXPECT_EQ(plant.said(), "applied \"v1\"");
}

TEST_F(RemoteConfigAfterGoodV1, DamageOnDiskIsLeftOut) {
  std::ofstream(plant.kept_path()) << "{\"format\": 1";
  plant.start();
  EXPECT_EQ(plant.retries(), 2);
  EXPECT_EQ(plant.said().rfind("applied null: the kept config is damaged", 0), 0u) << plant.said();
  EXPECT_TRUE(plant.hear(plant.with_retries("v1", 7)));
  EXPECT_EQ(plant.reported()["errors"], json::array());
}

TEST_F(RemoteConfigTest, NoSecretIsReported) {
  for (const json& document :
       {plant.with_retries("v1", 7), json{{"version", "v2"}, {"config", {{"mqtt", 3}}}},
        json{{"version", "v3"}, {"patch", {{"mqtt", {{"servers", {"mqtt://a"}}}}}}}}) {
    plant.hear(document);
    EXPECT_EQ(plant.remote().report_text("h").find("s3cret"), std::string::npos);
    EXPECT_EQ(plant.kept_text().find("s3cret"), std::string::npos);
  }
}

TEST_F(RemoteConfigAfterGoodV1, OneThatEndsTheProcessWhileItIsJudgedIsNotTriedAgain) {
  json document = plant.with_retries("v2", 8);
  document["by"] = "ann";
  plant.end_while_judging(document);
  EXPECT_EQ(plant.retries(), 7);
  EXPECT_EQ(plant.said(), "rolled_back \"v2\": the process ended during the check of the config");
  EXPECT_EQ(plant.remote().answer().last().desired.by, "ann");
  EXPECT_FALSE(plant.hear(document));
  plant.start();
  EXPECT_FALSE(plant.hear(document));
  EXPECT_EQ(plant.said().substr(0, 16), "rolled_back \"v2\"");
}

TEST_F(RemoteConfigAfterV1, JudgingAnotherDoesNotEndATrial) {
  plant.end_while_judging(plant.with_retries("v2", 8));
  EXPECT_EQ(plant.retries(), 7);
  EXPECT_EQ(plant.reported()["confirmed"], false);
  EXPECT_EQ(plant.said().substr(0, 16), "rolled_back \"v2\"");
}

TEST_F(RemoteConfigTest, OneThatIsRejectedLeavesNothingOfItsJudging) {
  EXPECT_FALSE(plant.hear(plant.with_retries("v1", 99)));
  EXPECT_EQ(plant.kept_text(), "");
  plant.start();
  EXPECT_EQ(plant.said(), "applied null");
}

/// The rights of the file count as they were when it was read, as long as its text is in use.
TEST_F(RemoteConfigTest, TheWayBackDoesNotDependOnTheFileOnDisk) {
  plant.local()["mqtt"].erase("allow_plain_secret");
  plant.write();
  std::filesystem::permissions(
      plant.path(), std::filesystem::perms::owner_read | std::filesystem::perms::owner_write);
  plant.start();
  std::filesystem::permissions(plant.path(), std::filesystem::perms::others_read,
                               std::filesystem::perm_options::add);
  EXPECT_TRUE(plant.hear(plant.with_retries("v1", 7)));
  plant.connection(false);
  EXPECT_TRUE(plant.pass(kTrial));
  EXPECT_EQ(plant.retries(), 2);
  plant.connection(true);
  EXPECT_TRUE(plant.hear(plant.with_retries("v2", 8)));
  EXPECT_TRUE(plant.hear_text(""));
  EXPECT_EQ(plant.retries(), 2);
}

TEST_F(RemoteConfigAfterV1, ReadingAtTheStartWritesNothing) {
  plant.stop();
  const std::string before = plant.kept_text();
  plant.read();
  EXPECT_EQ(plant.kept_text(), before);
  // A stop at this point, for example while a slow store opens, proves nothing.
  plant.start();
  EXPECT_EQ(plant.retries(), 7);
  EXPECT_NE(plant.kept_text(), before);
  plant.set("/agent/remote_config", false);
  plant.read();
  EXPECT_TRUE(std::filesystem::exists(plant.kept_path()));
}

TEST_F(RemoteConfigAfterV1, ASecondAgentTouchesNothing) {
  const std::string before = plant.kept_text();
  const auto begin_second = [&] {
    RemoteConfig second(plant.path(), kTrial, "boot");
    EXPECT_TRUE(second.start({}).has_value());
    second.begin();
    EXPECT_FALSE(second.take_left_answer());
  };
  begin_second();
  EXPECT_EQ(plant.kept_text(), before);
  plant.set("/agent/remote_config", false);
  begin_second();
  EXPECT_EQ(plant.kept_text(), before);
}

TEST_F(RemoteConfigAfterV1, AStoppedTrialThatNoLongerFitsIsOver) {
  plant.stop();
  plant.set("/agent/remote_allow", json::array());
  plant.start();
  EXPECT_EQ(plant.reported()["state"], "rejected");
  plant.start();
  EXPECT_EQ(plant.said(), "applied null");
}

TEST_F(RemoteConfigAfterV1, ATrialThatTheDiskDoesNotLetGoOnIsGivenUp) {
  plant.stop();
  plant.read();
  plant.take_disk();
  plant.remote().begin();
  EXPECT_LE(plant.remote().next_wake(), SteadyTime{1h});
  EXPECT_TRUE(plant.pass(0s));
  EXPECT_EQ(plant.retries(), 2);
  EXPECT_EQ(plant.said(), "applied null");
  EXPECT_EQ(plant.reported()["confirmed"], true);
  plant.give_disk();
}

json with_server(const std::string& version, const std::string& server) {
  return {{"version", version}, {"config", {{"mqtt", {{"servers", {server}}}}}}};
}

/// The login of the local file must not go to another broker.
void start_with_other_servers_allowed(Plant& plant) {
  plant.local()["agent"]["remote_allow"] = {"mqtt.servers", "devices"};
  for (const char* key : {"username", "password", "allow_plain_secret"})
    plant.local()["mqtt"].erase(key);
  plant.write();
  plant.start();
}

/// Two brokers whose documents redirect the agent to each other.
TEST_F(RemoteConfigTest, NobodyIsSentToAnotherBrokerAgainBeforeTheVerdict) {
  start_with_other_servers_allowed(plant);
  EXPECT_TRUE(plant.hear(with_server("b", "mqtt://192.0.2.2")));
  EXPECT_FALSE(plant.hear(with_server("a", "mqtt://192.0.2.1")));
  EXPECT_EQ(plant.said(), "applied \"b\"");
  EXPECT_TRUE(plant.remote().answer().is_due());
  EXPECT_TRUE(plant.pass(kTrial));
  EXPECT_EQ(plant.said(), "applied \"a\"");
  EXPECT_EQ(plant.in_force().mqtt.servers[0], "mqtt://192.0.2.1:1883");
  // After a lost trial the document is forgotten: the previous broker has its own.
  EXPECT_FALSE(plant.hear(with_server("b", "mqtt://192.0.2.2")));
  plant.connection(false);
  EXPECT_TRUE(plant.pass(kTrial));
  EXPECT_EQ(plant.in_force().mqtt.servers[0], "mqtt://192.0.2.2:1883");
  EXPECT_FALSE(plant.pass(1h));
  // A further document with the same broker need not wait.
  plant.connection(true);
  EXPECT_TRUE(plant.hear(with_server("c", "mqtt://192.0.2.3")));
  json stays = with_server("d", "mqtt://192.0.2.3");
  stays["config"]["devices"] = plant.with_retries("", 5)["config"]["devices"];
  EXPECT_TRUE(plant.hear(stays));
}

TEST_F(RemoteConfigTest, AnOlderRejectedOneDoesNotTakeThePlaceOfOneThatWaits) {
  start_with_other_servers_allowed(plant);
  EXPECT_TRUE(plant.hear(with_server("b", "mqtt://192.0.2.2")));
  EXPECT_FALSE(plant.hear(plant.with_retries("c", 99)));
  EXPECT_NE(plant.remote().answer().rejected(), "");
  EXPECT_FALSE(plant.hear(with_server("d", "mqtt://192.0.2.4")));
  EXPECT_EQ(plant.remote().answer().rejected(), "")
      << "a reload would judge it again and forget the last one";
  EXPECT_TRUE(plant.pass(kTrial));
  EXPECT_EQ(plant.said(), "applied \"d\"");
}

TEST_F(RemoteConfigTest, SwitchedOffWithoutAKeptConfigNothingIsSaidOfOne) {
  plant.set("/agent/remote_config", false);
  std::filesystem::remove_all(plant.store());
  std::ofstream(plant.store()) << "no directory";
  testing::internal::CaptureStderr();
  plant.start();
  const std::string log = testing::internal::GetCapturedStderr();
  EXPECT_EQ(log.find("kept config"), log.npos) << log;
  EXPECT_FALSE(plant.remote().take_left_answer());
}

TEST_F(RemoteConfigTest, SwitchedOffByARestartTheAnswerIsClearedOnce) {
  EXPECT_FALSE(plant.remote().take_left_answer());
  plant.hear(plant.with_retries("v1", 7));
  plant.set("/agent/remote_config", false);
  plant.start();
  EXPECT_FALSE(std::filesystem::exists(plant.kept_path()));
  EXPECT_TRUE(plant.remote().take_left_answer());
  EXPECT_FALSE(plant.remote().take_left_answer());
  plant.start();
  EXPECT_FALSE(plant.remote().take_left_answer());
}

TEST_F(RemoteConfigTest, WhoHasSentARolledBackOneIsKept) {
  json document = plant.with_retries("v1", 7);
  document["by"] = "ann";
  plant.hear(document);
  plant.start();
  EXPECT_EQ(plant.remote().answer().last().desired.by, "ann");
  plant.start();
  EXPECT_EQ(plant.remote().answer().last().desired.by, "ann");
}

TEST_F(RemoteConfigTest, OneThatWaitsIsJudgedWhenTheLocalFileEndsTheTrial) {
  start_with_other_servers_allowed(plant);
  EXPECT_TRUE(plant.hear(with_server("b", "mqtt://192.0.2.2")));
  EXPECT_FALSE(plant.hear(with_server("d", "mqtt://192.0.2.4")));
  plant.set("/agent/remote_allow", {"devices"});
  EXPECT_TRUE(plant.hang_up());
  plant.pass(1s);
  EXPECT_NE(plant.said().find("rejected \"d\""), std::string::npos) << plant.said();
}

TEST_F(RemoteConfigAfterV1, AnOlderRejectedOneDoesNotComeBackOverARolledBackOne) {
  plant.start();  // after a crash
  plant.hear(plant.with_retries("v0", 99));
  EXPECT_FALSE(plant.remote().answer().rejected().empty());
  EXPECT_FALSE(plant.hear(plant.with_retries("v1", 7)));
  EXPECT_EQ(plant.remote().answer().rejected(), "");
}

TEST_F(RemoteConfigAfterV1, AConfirmationThatTheDiskRefusedIsWrittenAtTheStop) {
  plant.take_disk();
  plant.pass(kTrial);
  plant.give_disk();
  plant.stop();
  plant.start();
  EXPECT_EQ(plant.said(), "applied \"v1\"");
  EXPECT_EQ(plant.retries(), 7);
}

TEST_F(RemoteConfigAfterGoodV1, WhatTheDiskRefusedToTryIsPutRightLater) {
  const std::string good = plant.kept_text();
  plant.take_disk();
  EXPECT_FALSE(plant.hear(plant.with_retries("v2", 8)));
  plant.give_disk();
  std::ofstream(plant.kept_path()) << "the text of the try, which came through";
  plant.pass(60s);
  EXPECT_EQ(plant.kept_text(), good);
}

TEST_F(RemoteConfigTest, ADocumentBeyondItsLimitIsNotHeldInMemory) {
  EXPECT_FALSE(plant.hear_text(std::string(kMaxDesiredBytes, ' ') + "{"));
  EXPECT_EQ(plant.remote().answer().rejected(), "");
  EXPECT_FALSE(plant.hear_text("{"));
  EXPECT_EQ(plant.remote().answer().rejected(), "{") << "it may fit the next local file";
}

/// A new local file that conflicts with the config on trial may fit the previous one.
TEST_F(RemoteConfigAfterGoodV1, WhereTheTrialNoLongerFitsTheGoodOneStays) {
  json links = plant.local()["links"];
  links[0]["serial"]["path"] = "/dev/ttyUSB7";
  plant.local()["devices"][0]["commands"] = json::object();
  json moved = plant.with_retries("v2", 7);
  moved["config"]["links"] = links;
  moved["config"]["devices"][0]["commands"] = json::object();
  moved["config"]["devices"][0]["tags"].erase(2);
  EXPECT_TRUE(plant.hear(moved)) << plant.said();
  plant.local()["agent"]["remote_allow"] = {"devices"};
  plant.local()["devices"][0]["commands"] = {{"allow", {"M100-M199", "Y0-Y7"}}};
  plant.write();
  EXPECT_TRUE(plant.hang_up());
  EXPECT_EQ(plant.retries(), 7);
  EXPECT_EQ(plant.reported()["state"], "rejected");
  EXPECT_EQ(plant.reported()["in_force"], "v1");
  EXPECT_EQ(plant.reported()["confirmed"], true);
  plant.start();
  EXPECT_EQ(plant.retries(), 7);
}

TEST_F(RemoteConfigAfterGoodV1, WhatAnotherAgentHasKeptIsLeftOut) {
  plant.set("/agent/id", "edge8");
  plant.start();
  EXPECT_EQ(plant.retries(), 2);
  EXPECT_EQ(plant.said(), "applied null");
}

}  // namespace
}  // namespace fxagent
