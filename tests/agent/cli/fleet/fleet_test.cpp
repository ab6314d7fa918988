#include "agent/cli/fleet/fleet.h"

#include <gtest/gtest.h>

#include "agent/text/sha256.h"

namespace fxagent {
namespace {

constexpr const char* kDocument = R"({"version": "v2", "patch": {}})";

/// Returns a report on a document.
std::string fleet_report(const std::string& state, const std::string& desired_hash,
                         bool confirmed = true) {
  return R"({"version": "v2", "hash": "5f0c9a31e7d2b846", "state": ")" + state +
         R"(", "errors": ["/devices/0: wrong"], "errors_in_all": 1, "since": 1, "desired_hash": ")" +
         desired_hash + R"(", "in_force": "v1", "confirmed": )" + (confirmed ? "true" : "false") +
         "}";
}

TEST(Fleet, ReadsStateHealthReportAndDesired) {
  Fleet fleet("fx/plant-a");
  fleet.take(
      "fx/plant-a/edge1/state",
      R"({"state": "online", "since": 1790000000000, "boot": "9f3c21aa", "version": "0.1.0"})");
  fleet.take("fx/plant-a/edge1/health", R"({"ts": 1790000060000, "config": {"hash": "ab"}})");
  fleet.take("fx/plant-a/edge2/state", R"({"state": "offline", "since": null, "reason": "lost"})");
  fleet.take("fx/plant-a/edge2/health", R"({"ts": 5, "version": "0.0.9"})");
  const FleetAgent& first = fleet.agent("edge1");
  EXPECT_EQ(first.presence, FleetAgent::Presence::online);
  EXPECT_EQ(first.since_ms, 1790000000000);
  EXPECT_EQ(first.version, "0.1.0");
  EXPECT_EQ(first.hash, "ab");
  const FleetAgent& second = fleet.agent("edge2");
  EXPECT_EQ(second.presence, FleetAgent::Presence::offline);
  EXPECT_EQ(second.since_ms, std::nullopt);
  EXPECT_EQ(second.offline_reason, "lost");
  EXPECT_EQ(second.version, "0.0.9") << "of its last health";
}

TEST(Fleet, IgnoresTopicsOfDevicesAndOtherRoots) {
  Fleet fleet("fx");
  fleet.take("fx/edge1/press1/state", R"({"state": "online"})");
  fleet.take("fx2/edge1/state", R"({"state": "online"})");
  fleet.take("fx/state", R"({"state": "online"})");
  fleet.take("fx//state", R"({"state": "online"})");
  EXPECT_TRUE(fleet.agents().empty());
}

TEST(Fleet, HostilePayloadsAreUnknownStates) {
  Fleet fleet("fx");
  for (const char* payload : {"", "{", "[]", "null", "7", R"({"state": 7, "since": "x"})"})
    for (const char* topic : {"fx/e/state", "fx/e/health", "fx/e/config/reported"})
      fleet.take(topic, payload);
  EXPECT_EQ(fleet.agent("e").presence, FleetAgent::Presence::unknown);
  EXPECT_EQ(agreement_of(fleet.agent("e")), Agreement::local_file);
}

TEST(Fleet, AgreementComparesTheReportWithTheDocument) {
  Fleet fleet("fx");
  const auto agreement = [&] { return agreement_of(fleet.agent("e")); };
  EXPECT_EQ(agreement(), Agreement::local_file);
  fleet.take("fx/e/config/desired", kDocument);
  EXPECT_EQ(fleet.agent("e").desired->version, "v2");
  EXPECT_EQ(agreement(), Agreement::no_answer) << "it has never reported";
  fleet.take("fx/e/config/reported", fleet_report("applied", "0000000000000000"));
  EXPECT_EQ(agreement(), Agreement::no_answer) << "it reported on another document";
  const std::string hash = short_hash(kDocument);
  fleet.take("fx/e/config/reported", fleet_report("applied", hash, false));
  EXPECT_EQ(agreement(), Agreement::on_trial);
  fleet.take("fx/e/config/reported", fleet_report("applied", hash));
  EXPECT_EQ(agreement(), Agreement::as_asked);
  fleet.take("fx/e/config/reported", fleet_report("rolled_back", hash));
  EXPECT_EQ(agreement(), Agreement::rolled_back);
  fleet.take("fx/e/config/reported", fleet_report("rejected", hash));
  EXPECT_EQ(agreement(), Agreement::refused);
  EXPECT_EQ(fleet.agent("e").report->errors, std::vector<std::string>{"/devices/0: wrong"});
  fleet.take("fx/e/config/reported", fleet_report("applied", hash));
  fleet.take("fx/e/config/desired", "");
  EXPECT_EQ(agreement(), Agreement::unread)
      << "the broker lost the document, or this user may not read it";
  fleet.take("fx/e/config/reported", "");
  EXPECT_EQ(agreement(), Agreement::local_file);
}

TEST(Fleet, ARefusalOfAnotherDocumentLeavesTheOneInForceAsAsked) {
  Fleet fleet("fx");
  const auto agreement = [&] { return agreement_of(fleet.agent("e")); };
  fleet.take("fx/e/config/desired", R"({"version": "v1", "patch": {}})");
  for (const char* state : {"rejected", "rolled_back"}) {
    fleet.take("fx/e/config/reported", fleet_report(state, "0000000000000000"));
    EXPECT_EQ(agreement(), Agreement::as_asked) << state;
    EXPECT_TRUE(has_refused_another(fleet.agent("e")));
  }
  fleet.take("fx/e/config/reported", fleet_report("rejected", "0000000000000000", false));
  EXPECT_EQ(agreement(), Agreement::on_trial);
  fleet.take("fx/e/config/desired", kDocument);
  EXPECT_EQ(agreement(), Agreement::no_answer) << "v1 is in force, v2 was sent";
  EXPECT_FALSE(has_refused_another(fleet.agent("e")));
  fleet.take("fx/e/config/desired", R"({"version": "v1", "patch": {}})");
  fleet.take("fx/e/config/reported", fleet_report("applied", "0000000000000000"));
  EXPECT_EQ(agreement(), Agreement::no_answer) << "applied, but another document of that version";
}

TEST(Fleet, HashIsThatOfTheInterface) {
  EXPECT_EQ(short_hash("abc"), "ba7816bf8f01cfea") << "SHA-256 of abc, FIPS 180-2";
}

TEST(Fleet, SubscribesByWildcardOrByName) {
  const Fleet fleet("fx");
  EXPECT_EQ(fleet.filters({}),
            (std::vector<std::string>{"fx/+/state", "fx/+/health", "fx/+/config/reported",
                                      "fx/+/config/desired"}));
  EXPECT_EQ(fleet.filters({"a", "b"}).size(), 8U);
  EXPECT_EQ(fleet.filters({"a", "b"}).front(), "fx/a/state");
}

}  // namespace
}  // namespace fxagent
