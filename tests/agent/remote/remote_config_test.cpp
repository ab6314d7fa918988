#include "agent/remote/remote_config.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <optional>
#include <string>

#include "tests/agent/remote/remote_plant.h"
#include "tests/support/scratch.h"

namespace fxagent {
namespace {

using namespace test;
using namespace std::chrono_literals;
using Why = RemoteConfig::Next::Why;

constexpr auto kTrial = 60s;

/// A local file, and an agent that starts, applies at once what it is told to, and dies.
class Plant {
 public:
  Plant() {
    local_ = local_plant();
    local_["store"]["path"] = scratch_.path("store");
    write();
    start();
  }

  json& local() { return local_; }
  void write() { std::ofstream(path()) << local_.dump(); }
  std::string path() const { return scratch_.path("agent.json"); }
  std::string kept_path() const { return scratch_.path("store/remote_config.json"); }

  void start(bool is_connected = true) {
    remote_.emplace(path(), kTrial);
    auto config = remote_->start(now());
    ASSERT_TRUE(config.has_value()) << listed(config.error());
    in_force_ = std::move(*config);
    if (is_connected) remote_->connection(true, steady_);
  }
  void stop() { remote_->stop(); }

  /// False: nothing was applied.
  bool hear(const json& document) { return hear_text(document.dump()); }
  bool hear_text(const std::string& text) { return apply(remote_->hear(text, now())); }
  bool hang_up() {
    auto next = remote_->read_local();
    if (!next) return false;
    return apply(std::move(*next));
  }
  bool pass(SteadyTime::duration time) {
    steady_ += time;
    utc_ms_ += std::chrono::duration_cast<std::chrono::milliseconds>(time).count();
    return apply(remote_->due(now()));
  }
  void connection(bool is_up) { remote_->connection(is_up, steady_); }

  RemoteConfig& remote() { return *remote_; }
  const Config& in_force() const { return in_force_; }
  int retries() const { return in_force_.devices[0].retries; }
  json reported() const { return json::parse(remote_->reported(in_force_.hash)); }
  /// "applied v1", with the first error behind it.
  std::string said() const {
    const json report = reported();
    std::string text = report["state"].get<std::string>() + " " + report["version"].dump();
    if (!report["errors"].empty()) text += ": " + report["errors"][0].get<std::string>();
    return text;
  }

  /// A document that sets the retries of the first device.
  json with_retries(const std::string& version, int retries) const {
    json devices = local_["devices"];
    devices[0]["retries"] = retries;
    return {{"version", version}, {"config", {{"devices", devices}}}};
  }

 private:
  RemoteConfig::Moment now() const { return {steady_, utc_ms_}; }
  bool apply(std::optional<RemoteConfig::Next> next) {
    if (!next) return false;
    in_force_ = next->config;
    remote_->accept(std::move(*next), now());
    return true;
  }

  Scratch scratch_;
  json local_;
  std::optional<RemoteConfig> remote_;
  Config in_force_;
  SteadyTime steady_{1h};
  std::int64_t utc_ms_ = 1'790'000'000'000;
};

TEST(RemoteConfig, WithoutAWordTheLocalFileIsReported) {
  Plant plant;
  const json report = plant.reported();
  EXPECT_EQ(report["version"], nullptr);
  EXPECT_EQ(report["state"], "applied");
  EXPECT_EQ(report["hash"], plant.in_force().hash);
  EXPECT_EQ(report["since"], 1'790'000'000'000);
  EXPECT_EQ(report["errors"], json::array());
  EXPECT_FALSE(std::filesystem::exists(plant.kept_path()));
}

TEST(RemoteConfig, WhatIsRightIsAppliedAndGoodAfterItsTrial) {
  Plant plant;
  EXPECT_TRUE(plant.hear(plant.with_retries("v1", 7)));
  EXPECT_EQ(plant.retries(), 7);
  EXPECT_EQ(plant.said(), "applied \"v1\"");
  EXPECT_EQ(plant.reported()["confirmed"], false);
  EXPECT_TRUE(plant.remote().take_news());
  EXPECT_FALSE(plant.pass(59s));
  EXPECT_EQ(plant.reported()["confirmed"], false);
  EXPECT_FALSE(plant.pass(1s));
  EXPECT_TRUE(plant.remote().has_answer());
  EXPECT_EQ(plant.reported()["confirmed"], true);
  EXPECT_EQ(plant.reported()["since"], 1'790'000'000'000);
  EXPECT_EQ(plant.remote().next_wake(), SteadyTime::max());
  plant.connection(false);
  EXPECT_FALSE(plant.pass(1h));  // a broker that goes later proves nothing
  EXPECT_EQ(plant.retries(), 7);
}

TEST(RemoteConfig, TheSameAgainIsAnsweredAndNotAppliedAgain) {
  Plant plant;
  plant.hear(plant.with_retries("v1", 7));
  plant.remote().take_news();
  EXPECT_FALSE(plant.hear(plant.with_retries("v1", 7)));
  EXPECT_TRUE(plant.remote().has_answer());
  EXPECT_FALSE(plant.remote().take_news());
  EXPECT_TRUE(plant.hear(plant.with_retries("v2", 7)));
}

TEST(RemoteConfig, AWrongOneChangesNothingAndEveryErrorIsSaid) {
  Plant plant;
  plant.hear(plant.with_retries("v1", 7));
  plant.pass(kTrial);
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
  // The one in force is answered for what it is.
  EXPECT_FALSE(plant.hear(plant.with_retries("v1", 7)));
  EXPECT_EQ(plant.said(), "applied \"v1\"");
}

TEST(RemoteConfig, ManyErrorsAreCutAndCounted) {
  Plant plant;
  json wrong = plant.with_retries("v1", 1);
  for (int i = 0; i < 3000; ++i)
    wrong["config"]["devices"][0]["tags"].push_back(
        {{"name", "t" + std::to_string(i)}, {"address", "X8"}});
  EXPECT_FALSE(plant.hear(wrong));
  const std::string text = plant.remote().reported("");
  EXPECT_LT(text.size(), 2 * kMostReportedBytes);
  const json report = json::parse(text);
  EXPECT_EQ(report["errors"][0], "2000 more are not listed");
  EXPECT_EQ(report["errors_in_all"], 1001);
}

TEST(RemoteConfig, TheBrokerLostIsRolledBackAndNotTriedAgain) {
  Plant plant;
  plant.hear(plant.with_retries("v1", 7));
  plant.pass(kTrial);
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
  EXPECT_TRUE(plant.hear(plant.with_retries("v3", 8)));  // desired has changed
}

TEST(RemoteConfig, WithoutAGoodOneTheLocalFileIsTheWayBack) {
  Plant plant;
  plant.connection(false);
  EXPECT_TRUE(plant.hear(plant.with_retries("v1", 7)));
  EXPECT_TRUE(plant.pass(kTrial));
  EXPECT_EQ(plant.retries(), 2);
  EXPECT_EQ(plant.reported()["in_force"], nullptr);
}

TEST(RemoteConfig, AProcessThatEndsInTheTrialIsRolledBack) {
  Plant plant;
  plant.hear(plant.with_retries("v1", 7));
  plant.pass(kTrial);
  plant.hear(plant.with_retries("v2", 8));
  plant.start();
  EXPECT_EQ(plant.retries(), 7);
  EXPECT_EQ(plant.said(), "rolled_back \"v2\": the process ended while the config was on trial");
  EXPECT_TRUE(plant.remote().take_news());
  plant.start();
  EXPECT_EQ(plant.said().substr(0, 11), "rolled_back");
  EXPECT_FALSE(plant.remote().take_news());  // that was said before
}

TEST(RemoteConfig, AStopInTheTrialProvesNothing) {
  Plant plant;
  plant.hear(plant.with_retries("v1", 7));
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

TEST(RemoteConfig, AStopIsGoodForOneStart) {
  Plant plant;
  plant.hear(plant.with_retries("v1", 7));
  plant.stop();
  plant.start();
  plant.start();  // that one has crashed
  EXPECT_EQ(plant.retries(), 2);
  EXPECT_EQ(plant.said().substr(0, 11), "rolled_back");
}

TEST(RemoteConfig, AStartWithoutBrokerUsesTheGoodOne) {
  Plant plant;
  plant.hear(plant.with_retries("v1", 7));
  plant.pass(kTrial);
  plant.start(/*is_connected=*/false);
  EXPECT_EQ(plant.retries(), 7);
  EXPECT_FALSE(plant.pass(1h));
  EXPECT_EQ(plant.said(), "applied \"v1\"");
  EXPECT_EQ(plant.reported()["since"], 1'790'000'000'000);
}

TEST(RemoteConfig, AnEmptyDocumentWithdraws) {
  Plant plant;
  EXPECT_FALSE(plant.hear_text(""));
  plant.hear(plant.with_retries("v1", 7));
  plant.pass(kTrial);
  EXPECT_TRUE(plant.hear_text(""));
  EXPECT_EQ(plant.retries(), 2);
  EXPECT_EQ(plant.said(), "applied null");
  EXPECT_FALSE(std::filesystem::exists(plant.kept_path()));
  plant.start();
  EXPECT_EQ(plant.retries(), 2);
  // And what was withdrawn may come again.
  EXPECT_TRUE(plant.hear(plant.with_retries("v1", 7)));
}

TEST(RemoteConfig, TheLocalFileIsTheBaseOfBoth) {
  Plant plant;
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
  EXPECT_EQ(plant.in_force().devices[0].gap, 3ms);  // a file that nobody has reloaded
  EXPECT_TRUE(plant.hang_up());
  EXPECT_EQ(plant.retries(), 1);
  EXPECT_EQ(plant.in_force().devices[0].gap, 5ms);
  EXPECT_EQ(plant.said(), "applied \"v1\"");
}

TEST(RemoteConfig, WhereItNoLongerFitsTheLocalFileWins) {
  Plant plant;
  json document = plant.with_retries("v1", 7);
  plant.hear(document);
  plant.pass(kTrial);
  plant.local()["agent"]["remote_allow"] = {"links"};
  plant.write();
  EXPECT_TRUE(plant.hang_up());
  EXPECT_EQ(plant.retries(), 2);
  EXPECT_EQ(plant.reported()["state"], "rejected");
  EXPECT_NE(plant.said().find("remote_allow"), std::string::npos) << plant.said();
  plant.start();
  EXPECT_EQ(plant.retries(), 2);
  // The local file lets it in again: what was rejected is heard once more.
  plant.hear(document);
  plant.local()["agent"]["remote_allow"] = {"devices"};
  plant.write();
  EXPECT_TRUE(plant.hang_up());
  EXPECT_EQ(plant.remote().rejected(), document.dump());
  EXPECT_TRUE(plant.hear_text(std::string(plant.remote().rejected())));
  EXPECT_EQ(plant.retries(), 7);
}

TEST(RemoteConfig, AKeptOneThatNoLongerFitsAtTheStartIsLeftOut) {
  Plant plant;
  plant.hear(plant.with_retries("v1", 7));
  plant.pass(kTrial);
  plant.local()["agent"]["remote_allow"] = json::array();
  plant.write();
  plant.start();
  EXPECT_EQ(plant.retries(), 2);
  EXPECT_EQ(plant.reported()["state"], "rejected");
}

TEST(RemoteConfig, SwitchedOffNothingOfItStays) {
  Plant plant;
  plant.hear(plant.with_retries("v1", 7));
  plant.pass(kTrial);
  plant.local()["agent"]["remote_config"] = false;
  plant.write();
  EXPECT_TRUE(plant.hang_up());
  EXPECT_EQ(plant.retries(), 2);
  EXPECT_FALSE(plant.remote().is_enabled());
  EXPECT_FALSE(plant.remote().status().has_value());
  EXPECT_FALSE(std::filesystem::exists(plant.kept_path()));
  EXPECT_FALSE(plant.hear(plant.with_retries("v2", 8)));
  plant.local()["agent"]["remote_config"] = true;
  plant.write();
  EXPECT_TRUE(plant.hang_up());
  EXPECT_TRUE(plant.hear(plant.with_retries("v1", 7)));
}

TEST(RemoteConfig, ADiskThatRefusesDecidesAsTheLocalFileAsks) {
  Plant plant;
  std::ofstream(plant.kept_path().substr(0, plant.kept_path().rfind('/'))) << "no directory";
  EXPECT_FALSE(plant.hear(plant.with_retries("v1", 7)));
  EXPECT_EQ(plant.retries(), 2);
  EXPECT_NE(plant.said().find("remote_without_disk"), std::string::npos) << plant.said();
  plant.local()["agent"]["remote_without_disk"] = true;
  plant.write();
  plant.hang_up();
  EXPECT_TRUE(plant.hear(plant.with_retries("v1", 7)));
  EXPECT_EQ(plant.retries(), 7);
  EXPECT_EQ(plant.said(), "applied \"v1\"");
}

TEST(RemoteConfig, WhatTheDiskRefusedIsWrittenLater) {
  Plant plant;
  plant.hear(plant.with_retries("v1", 7));
  const std::string store = plant.kept_path().substr(0, plant.kept_path().rfind('/'));
  std::filesystem::rename(store, store + ".away");
  std::ofstream(store) << "no directory";
  plant.pass(kTrial);
  EXPECT_EQ(plant.reported()["confirmed"], true);
  std::filesystem::remove(store);
  std::filesystem::rename(store + ".away", store);
  EXPECT_NE(plant.remote().next_wake(), SteadyTime::max());
  plant.pass(60s);
  EXPECT_EQ(plant.remote().next_wake(), SteadyTime::max());
  plant.start();
  EXPECT_EQ(plant.said(), "applied \"v1\"");
}

TEST(RemoteConfig, DamageOnDiskIsLeftOut) {
  Plant plant;
  plant.hear(plant.with_retries("v1", 7));
  plant.pass(kTrial);
  std::ofstream(plant.kept_path()) << "{\"format\": 1";
  plant.start();
  EXPECT_EQ(plant.retries(), 2);
  EXPECT_TRUE(plant.hear(plant.with_retries("v1", 7)));
}

TEST(RemoteConfig, NoSecretIsReported) {
  Plant plant;
  for (const json& document :
       {plant.with_retries("v1", 7), json{{"version", "v2"}, {"config", {{"mqtt", 3}}}},
        json{{"version", "v3"}, {"patch", {{"mqtt", {{"servers", {"mqtt://a"}}}}}}}}) {
    plant.hear(document);
    EXPECT_EQ(plant.remote().reported("h").find("s3cret"), std::string::npos);
    std::ifstream kept(plant.kept_path());
    const std::string text{std::istreambuf_iterator<char>(kept), {}};
    EXPECT_EQ(text.find("s3cret"), std::string::npos);
  }
}

}  // namespace
}  // namespace fxagent
