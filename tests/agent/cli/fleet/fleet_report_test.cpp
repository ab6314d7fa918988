#include "agent/cli/fleet/fleet_report.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "agent/text/sha256.h"

namespace fxagent {
namespace {

constexpr const char* kSent = R"({"version": "v8", "patch": {}})";

std::string report(const std::string& state, const std::string& in_force) {
  return R"({"version": "v8", "hash": "5f0c9a31e7d2b846", "state": ")" + state +
         R"(", "errors": ["/devices/0/link: there is no link \"line9\""], "desired_hash": ")" +
         short_hash(kSent) + R"(", "in_force": ")" + in_force + R"(", "confirmed": true})";
}

/// Three agents: one has v8, one refuses it, one is offline.
Fleet three_agents() {
  Fleet fleet("fx");
  const std::string online =
      R"({"state": "online", "since": 1790000000000, "boot": "9f3c21aa", "version": "0.1.0"})";
  for (const char* name : {"edge1", "edge2"}) {
    fleet.take("fx/" + std::string(name) + "/state", online);
    fleet.take("fx/" + std::string(name) + "/config/desired", kSent);
  }
  fleet.take("fx/edge1/config/reported", report("applied", "v8"));
  fleet.take("fx/edge2/config/reported", report("rejected", "v7"));
  fleet.take("fx/edge3/state", R"({"state": "offline", "since": null, "reason": "lost"})");
  fleet.take(
      "fx/edge3/health",
      R"({"ts": 1790000060000, "version": "0.1.0", "config": {"hash": "0123456789abcdef"}})");
  return fleet;
}

TEST(FleetReport, TableHasALineForEachAgentAndTheReasonOfARefusal) {
  EXPECT_EQ(
      fleet_text(three_agents()),
      "  AGENT  STATE                                        VERSION  CONFIG         SENT\n"
      "  edge1  online since 2026-09-21 14:13                0.1.0    v8 5f0c9a31    as sent\n"
      "  edge2  online since 2026-09-21 14:13                0.1.0    v7 5f0c9a31    v8 "
      "REFUSED\n"
      "  edge3  offline, lost, last health 2026-09-21 14:14  0.1.0    file 01234567  nothing "
      "sent\n"
      "edge2 refuses v8:\n"
      "  /devices/0/link: there is no link \"line9\"\n"
      "2 of 3 online, 1 of 2 as sent, 1 without a sent config\n");
  EXPECT_FALSE(is_fleet_good(three_agents()));
}

TEST(FleetReport, IsGoodOnlyIfEachAgentIsOnlineAndAsAsked) {
  Fleet fleet = three_agents();
  fleet.take("fx/edge2/config/desired", "");
  fleet.take("fx/edge2/config/reported", "");
  EXPECT_FALSE(is_fleet_good(fleet)) << "edge3 is offline";
  fleet.take("fx/edge3/state", R"({"state": "online"})");
  EXPECT_TRUE(is_fleet_good(fleet));
  fleet.take("fx/edge3/state", R"({"state": "online", "conflict": "aaaaaaaa"})");
  EXPECT_FALSE(is_fleet_good(fleet));
  EXPECT_FALSE(is_fleet_good(Fleet("fx"))) << "no agent";
}

TEST(FleetReport, ADocumentThatThisUserMayNotReadIsNotCounted) {
  Fleet fleet = three_agents();
  for (const char* name : {"edge1", "edge2"})
    fleet.take("fx/" + std::string(name) + "/config/desired", "");
  std::string text = fleet_text(fleet);
  EXPECT_NE(text.find("v8 5f0c9a31    v8 applied, unread\n"), std::string::npos) << text;
  EXPECT_NE(text.find("v8 REFUSED\n"), std::string::npos) << text;
  EXPECT_NE(text.find("unread: config/desired could not be read"), std::string::npos) << text;
  EXPECT_TRUE(
      text.ends_with("\n2 of 3 online, 0 of 1 as sent, 1 unread, 1 without a sent config\n"))
      << text;
  const auto made = nlohmann::json::parse(fleet_json(fleet));
  EXPECT_EQ(made["agents"][0]["config"], "unread");
  EXPECT_EQ(made["agents"][0]["asked"], "v8");
}

TEST(FleetReport, ARefusalOfADocumentThatTheBrokerDoesNotHaveIsALineBelow) {
  Fleet fleet("fx");
  fleet.take("fx/edge1/state", R"({"state": "online", "since": 1790000000000})");
  fleet.take("fx/edge1/config/desired", R"({"version": "v7", "patch": {}})");
  fleet.take("fx/edge1/config/reported", report("rejected", "v7"));
  const std::string text = fleet_text(fleet);
  EXPECT_NE(text.find("v7 5f0c9a31  as sent\n"
                      "edge1 refuses v8, which the broker does not have:\n"
                      "  /devices/0/link: there is no link \"line9\"\n"
                      "1 of 1 online, 1 of 1 as sent\n"),
            text.npos)
      << text;
  EXPECT_TRUE(is_fleet_good(fleet));
  const auto made = nlohmann::json::parse(fleet_json(fleet));
  EXPECT_EQ(made["agents"][0]["config"], "as_asked");
  EXPECT_EQ(made["agents"][0]["asked"], "v7");
  EXPECT_EQ(made["agents"][0]["answered"], "v8");
  EXPECT_EQ(made["agents"][0]["errors"].size(), 1U);
}

TEST(FleetReport, AFleetToWhichNothingWasSentHasNoneAsSent) {
  Fleet fleet("fx");
  fleet.take("fx/e/state", R"({"state": "online"})");
  fleet.add("edge9");
  const std::string text = fleet_text(fleet);
  EXPECT_TRUE(text.ends_with("\n1 of 2 online, 1 without a sent config\n")) << text;
}

TEST(FleetReport, TextFromAnAgentCannotControlTheTerminal) {
  Fleet fleet("fx");
  fleet.take("fx/e/state", R"({"state": "online", "version": "\u001b[2J\"x\\"})");
  const std::string text = fleet_text(fleet);
  EXPECT_EQ(text.find('\x1b'), std::string::npos);
  EXPECT_NE(text.find("\\u001b[2J\"x\\\\"), std::string::npos) << text;
}

TEST(FleetReport, JsonHasEveryFieldOfEachAgent) {
  const auto made = nlohmann::json::parse(fleet_json(three_agents()));
  EXPECT_EQ(made["ok"], false);
  EXPECT_EQ(made["error"], nullptr);
  ASSERT_EQ(made["agents"].size(), 3U);
  EXPECT_EQ(made["agents"][0]["config"], "as_asked");
  EXPECT_EQ(made["agents"][1]["config"], "refused");
  EXPECT_EQ(made["agents"][1]["in_force"], "v7");
  EXPECT_EQ(made["agents"][2]["state"], "offline");
  EXPECT_EQ(made["agents"][2]["since"], nullptr);
}

TEST(FleetReport, LinesAndSumOfARolloutNameEachOutcome) {
  std::vector<Push> pushes(3);
  for (std::size_t i = 0; i < pushes.size(); ++i) {
    pushes[i].agent = "edge" + std::to_string(i + 1);
    pushes[i].version = "v8";
    pushes[i].hash = short_hash(kSent);
  }
  pushes[2].agent = "edge10";
  Rollout rollout(pushes, {});
  RolloutLines lines(rollout);
  Fleet fleet = three_agents();
  std::string said;
  for (int i = 0; i < 4; ++i) {
    rollout.advance(fleet, {});
    said += lines.take();
    fleet.take("fx/edge2/config/reported", report("rejected", "v7"));
  }
  EXPECT_EQ(said,
            "batch 1 of 3\n  edge1   accepted\nbatch 2 of 3\n  edge2   refused\n"
            "    /devices/0/link: there is no link \"line9\"\n");
  EXPECT_EQ(rollout_sum(rollout),
            "STOPPED: 1 of 3 accepted\naccepted: edge1\nrefused: edge2\nnot sent: edge10\n");
  const auto made = nlohmann::json::parse(rollout_json(rollout, ""));
  EXPECT_EQ(made["agents"][2]["outcome"], "not_sent");
}

TEST(FleetReport, DryRunListsBatchesAndWhoHasTheDocument) {
  std::vector<Push> pushes(2);
  pushes[0].agent = "edge1";
  pushes[1].agent = "edge3";
  for (Push& push : pushes) push.version = "v8", push.hash = short_hash(kSent);
  const std::string text = dry_run_text(pushes, {}, three_agents());
  EXPECT_NE(text.find("  1      edge1  online"), std::string::npos) << text;
  EXPECT_NE(text.find("v8, has it"), std::string::npos) << text;
  EXPECT_NE(text.find("  2      edge3  offline, lost"), std::string::npos) << text;
}

TEST(FleetReport, DryRunDoesNotApproveAnAgentWithoutAReport) {
  std::vector<Push> pushes(2);
  pushes[0].agent = "edge1";
  pushes[1].agent = "edge2";
  Fleet fleet = three_agents();
  EXPECT_TRUE(is_dry_run_good(pushes, {}, fleet));
  fleet.take("fx/edge2/config/reported", "");
  EXPECT_FALSE(is_dry_run_good(pushes, {}, fleet));
  EXPECT_FALSE(is_dry_run_good(pushes, {.skip_offline = true}, fleet));
  const std::string text = dry_run_text(pushes, {}, fleet);
  EXPECT_NE(text.find("the broker has no report of its config"), std::string::npos) << text;
}

TEST(FleetReport, DryRunApprovesAnAgentThatIsOfflineOnlyIfItIsSkipped) {
  std::vector<Push> pushes(2);
  pushes[0].agent = "edge1";
  pushes[1].agent = "edge3";
  EXPECT_FALSE(is_dry_run_good(pushes, {}, three_agents()));
  EXPECT_TRUE(is_dry_run_good(pushes, {.skip_offline = true}, three_agents()));
  pushes[0].agent = "edge9";
  EXPECT_FALSE(is_dry_run_good(pushes, {.skip_offline = true}, three_agents())) << "none is online";
}

}  // namespace
}  // namespace fxagent
