#include "agent/store/audit_chain.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "agent/cli/audit/audit_report.h"
#include "agent/commands/audit_records.h"
#include "tests/support/says.h"

namespace fxagent::audit {
namespace {

constexpr std::int64_t kNow = 1790000000000;

Receipt receipt(std::uint64_t number) {
  Receipt made{.number = number,
               .device = "press1",
               .topic = "fx/plant-a/edge7/press1/command",
               .payload = R"({"id":"b7e1"})"};
  made.payload_bytes = made.payload.size();
  made.by = "anna";
  made.received_ms = kNow + static_cast<std::int64_t>(number);
  return made;
}

const std::string kSucceeded =
    R"({"id":"b7e1","status":"SUCCEEDED","reason":null,"detail":null,"plc":"ACK","op":"write",)"
    R"("tag":"setpoint","address":"D200","value":50,"verify":{"read":50,"match":true},)"
    R"("t":{"received":1790000000001},"attempts":1})";

FrameTrace enquiry() {
  FrameTrace trace;
  trace.add(WireFrame::Way::out, Bytes{0x05});
  trace.add(WireFrame::Way::in, Bytes{0x06});
  return trace;
}

struct Chain {
  std::vector<Record> records;
  Head head;

  void add(const std::string& body) { records.push_back(seal(head, body)); }
  std::vector<Finding> findings(std::optional<Head> published = std::nullopt) const {
    Verifier verifier(published);
    for (const Record& record : records) verifier.add(record);
    return verifier.finish(head);
  }
};

Chain small_chain() {
  Chain chain;
  chain.add(admitted(receipt(1), "b7e1", "write", kNow));
  chain.add(result(1, "press1", kSucceeded, enquiry(), kNow));
  chain.add(delivery(1, "press1", "b7e1", true, kNow));
  chain.add(answered(receipt(2), R"({"id":"c","status":"REJECTED"})", kNow));
  chain.add(delivery(2, "press1", "c", true, kNow));
  return chain;
}

TEST(Audit, HashIsSha256) {
  EXPECT_EQ(to_text(sha256("abc")),  // FIPS 180-2, appendix B.1
            "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
}

TEST(Audit, EachRecordCarriesTheHashOfTheOneBefore) {
  const Chain chain = small_chain();
  std::string before(64, '0');
  for (const Record& record : chain.records) {
    const auto said = nlohmann::json::parse(record.text);
    EXPECT_EQ(said["n"], record.number);
    EXPECT_EQ(said["prev"], before);
    before = to_text(sha256(record.text));
  }
  EXPECT_EQ(to_text(chain.head.hash), before);
  EXPECT_TRUE(chain.findings().empty());
}

TEST(Audit, EverySingleByteThatIsChangedIsFoundInItsRecord) {
  const Chain whole = small_chain();
  for (std::size_t i = 0; i < whole.records.size(); ++i) {
    const auto changed = [&](const Chain& chain, std::size_t place) {
      const auto findings = chain.findings();
      ASSERT_EQ(findings.size(), 1U) << i << " at " << place;
      EXPECT_EQ(findings[0].record, i + 1) << place;
    };
    for (std::size_t place = 0; place < whole.records[i].text.size(); ++place) {
      Chain chain = whole;
      chain.records[i].text[place] ^= 1;
      changed(chain, place);
    }
    for (std::size_t place = 0; place < 32; ++place) {
      Chain chain = whole;
      chain.records[i].hash[place] ^= 0x80;
      changed(chain, place);
    }
  }
}

TEST(Audit, RecordThatIsEditedWithItsHashIsFoundAtTheNext) {
  for (std::size_t i = 0; i < 5; ++i) {
    Chain chain = small_chain();
    Record& record = chain.records[i];
    record.text.replace(record.text.find("press1"), 6, "press2");
    const Digest digest = sha256(record.text);
    record.hash.assign(digest.begin(), digest.end());
    const auto findings = chain.findings();
    ASSERT_EQ(findings.size(), 1U) << i;
    EXPECT_EQ(findings[0].record, i == 4 ? 5U : i + 2) << findings[0].text;
  }
}

TEST(Audit, EachRecordThatIsMissingIsNamed) {
  for (std::size_t i = 0; i < 5; ++i) {
    Chain chain = small_chain();
    chain.records.erase(chain.records.begin() + static_cast<std::ptrdiff_t>(i));
    const auto findings = chain.findings();
    ASSERT_EQ(findings.size(), 1U) << i;
    EXPECT_EQ(findings[0].record, i + 1);
    test::expect_says(findings[0].text, "missing");
  }
}

TEST(Audit, TailThatWasCutOffIsFoundByTheHead) {
  Chain chain = small_chain();
  chain.records.resize(2);
  const auto findings = chain.findings();
  ASSERT_EQ(findings.size(), 1U);
  EXPECT_EQ(findings[0].record, 3U);
  EXPECT_EQ(findings[0].text, "records 3 to 5 are missing at the end");
  chain.records.clear();
  ASSERT_EQ(chain.findings().size(), 1U);
  EXPECT_EQ(chain.findings()[0].record, 1U);
}

TEST(Audit, TailThatWasCutOffWithTheHeadIsFoundByThePublishedOne) {
  Chain chain = small_chain();
  const Head published = chain.head;
  chain.records.resize(2);
  chain.head.records = 2;
  chain.head.hash = sha256(chain.records[1].text);
  EXPECT_TRUE(chain.findings().empty());
  ASSERT_EQ(chain.findings(published).size(), 1U);
  EXPECT_EQ(chain.findings(published)[0].record, 3U);
}

TEST(Audit, ChainThatWasMadeAnewIsFoundByThePublishedHead) {
  const Head published = small_chain().head;
  Chain forged;
  for (int i = 0; i < 6; ++i) forged.add(delivery(1, "press1", "x", true, kNow));
  EXPECT_TRUE(forged.findings().empty());
  ASSERT_EQ(forged.findings(published).size(), 1U);
  EXPECT_EQ(forged.findings(published)[0].record, 5U);
}

TEST(Audit, HeadPublishedEarlierIsStillInTheChain) {
  Chain chain = small_chain();
  const Head published = chain.head;
  chain.add(delivery(3, "press1", "d", true, kNow));
  EXPECT_TRUE(chain.findings(published).empty());
}

TEST(Audit, RecordsThatChangedPlacesAreFound) {
  for (std::size_t i = 0; i + 1 < 5; ++i) {
    Chain chain = small_chain();
    std::swap(chain.records[i].text, chain.records[i + 1].text);
    std::swap(chain.records[i].hash, chain.records[i + 1].hash);
    const auto findings = chain.findings();
    ASSERT_FALSE(findings.empty()) << i;
    EXPECT_EQ(findings[0].record, i + 1);
  }
}

TEST(Audit, PrunedRecordsAreNotMissing) {
  Chain chain = small_chain();
  chain.add(pruned(2, chain.records[1].hash, kNow));
  chain.records.erase(chain.records.begin(), chain.records.begin() + 2);
  EXPECT_TRUE(chain.findings().empty());
  chain.records.erase(chain.records.begin());  // a further record, which no prune record mentions
  const auto findings = chain.findings();
  ASSERT_EQ(findings.size(), 1U);
  EXPECT_EQ(findings[0].record, 3U);
}

TEST(Audit, PruningThatNamesAnotherHashIsFound) {
  Chain chain = small_chain();
  chain.add(pruned(2, chain.records[0].hash, kNow));
  chain.records.erase(chain.records.begin(), chain.records.begin() + 2);
  ASSERT_EQ(chain.findings().size(), 1U);
  EXPECT_EQ(chain.findings()[0].record, 3U);
}

TEST(Audit, PayloadIsKeptShortAndPrintable) {
  Receipt bad = receipt(1);
  bad.payload = "{\xFF\x01" + std::string(1000, 'x');
  bad.payload_bytes = bad.payload.size();
  bad.by.clear();
  const auto said = nlohmann::json::parse(answered(bad, R"({"id":null})", kNow));
  EXPECT_EQ(said["payload"], "{\\xff\x01" + std::string(253, 'x'));
  EXPECT_EQ(said["payload_bytes"], 1003);
  EXPECT_EQ(said["by"], nullptr);
}

TEST(Audit, LongResultLosesItsValuesAndSaysSo) {
  const std::string text =
      R"({"id":"a","status":"REJECTED","value":")" + std::string(60000, 'x') + R"("})";
  const auto said = nlohmann::json::parse(answered(receipt(1), text, kNow));
  EXPECT_EQ(said["result"]["status"], "REJECTED");
  EXPECT_EQ(said["result"]["value"], nullptr);
  EXPECT_EQ(said["result"]["cut"], true);
}

TEST(Audit, LongCommandKeepsTheBeginningOfItsFrames) {
  FrameTrace trace;
  for (int i = 0; i < 100; ++i) trace.add(WireFrame::Way::out, Bytes(10, 0x30));
  EXPECT_EQ(trace.frames().size(), FrameTrace::kMostFrames);
  trace.add(WireFrame::Way::in, {});
  EXPECT_EQ(trace.omitted(), 36U);
}

// ---- the report -------------------------------------------------------------------------------

TEST(AuditReport, RecordsOfACommandBecomeOneLine) {
  Report report;
  for (const Record& record : small_chain().records) report.add(record);
  const auto lines = report.take();
  ASSERT_EQ(lines.size(), 2U);
  const auto first = nlohmann::json::parse(lines[0].json);
  EXPECT_EQ(first["arrival"], 1);
  EXPECT_EQ(first["received"], kNow + 1);
  EXPECT_EQ(first["topic"], "fx/plant-a/edge7/press1/command");
  EXPECT_EQ(first["by"], "anna");
  EXPECT_EQ(first["id"], "b7e1");
  EXPECT_EQ(first["status"], "SUCCEEDED");
  EXPECT_EQ(first["plc"], "ACK");
  EXPECT_EQ(first["verify"]["read"], 50);
  EXPECT_EQ(first["frames"], nlohmann::json::parse(R"([{"out":"05"},{"in":"06"}])"));
  EXPECT_EQ(first["acknowledged"], kNow);
  EXPECT_EQ(first["records"], nlohmann::json::parse("[1,2,3]"));
  EXPECT_EQ(
      lines[0].text,
      "2026-09-21T14:13:20.001Z press1 b7e1 by \"anna\": write setpoint D200 = 50: SUCCEEDED, "
      "ACK, read back 50 | > 05 < 06 | acknowledged 2026-09-21T14:13:20.000Z");
  EXPECT_EQ(nlohmann::json::parse(lines[1].json)["status"], "REJECTED");
}

TEST(AuditReport, TargetsOfAListHaveACommaBetweenThem) {
  Report report;
  Head head;
  report.add(
      seal(head, result(1, "press1",
                        R"({"id":"l","op":"write","status":"FAILED","targets":[)"
                        R"({"tag":"a","address":"hr:1","value":7},{"address":"hr:2","value":9}]})",
                        {}, kNow)));
  test::expect_says(report.take().at(0).text, ": write a hr:1 = 7, hr:2 = 9: FAILED");
}

TEST(AuditReport, CommandWithoutAResultAndWhatPruningLeftHaveLinesToo) {
  Report report;
  Head head;
  report.add(seal(head, result(1, "press1", kSucceeded, {}, kNow)));
  report.add(seal(head, delivery(9, "press1", "z", false, kNow)));
  report.add(seal(head, admitted(receipt(10), "open", "write", kNow)));
  Receipt by_hand = receipt(11);
  by_hand.topic = "command line";
  report.add(seal(head, admitted(by_hand, "by hand", "write", kNow)));
  report.add(seal(head, pruned(3, Bytes(32, 0), kNow)));
  const auto lines = report.take();
  ASSERT_EQ(lines.size(), 5U);
  EXPECT_EQ(lines[0].text,
            "before the records press1 z: (no op): no result is recorded | the "
            "broker has not acknowledged it");
  EXPECT_TRUE(nlohmann::json::parse(lines[0].json)["refused_by_broker"]);
  test::expect_says(lines[1].text, "records up to 3 were removed");
  EXPECT_EQ(nlohmann::json::parse(lines[2].json)["received"], kNow + 1);
  EXPECT_EQ(nlohmann::json::parse(lines[3].json)["status"], nullptr);
  EXPECT_TRUE(lines[4].text.ends_with("no result is recorded")) << "no broker has to know it";
}

TEST(AuditReport, RemoteConfigHasALine) {
  Report report;
  Head head;
  ConfigReceipt receipt{.version = "v7\x1b",
                        .by = "ann",
                        .state = "rejected",
                        .desired_hash = "2dabccfd753b3d60",
                        .hash = "0f3a",
                        .errors = {"/links: differs", "two", "three"},
                        .errors_in_all = 300};
  report.add(seal(head, config(receipt, "fx/edge7/config/desired", kNow)));
  report.add(seal(head, config({"", "", "applied", "", "0f3b", {}, 0}, "t", kNow + 1)));
  const auto lines = report.take();
  ASSERT_EQ(lines.size(), 2U);
  test::expect_says(lines[0].text,
                    " by \"ann\": rejected: /links: differs (and 299 more) | in force 0f3a");
  EXPECT_EQ(lines[0].text.find('\x1b'), std::string::npos);
  test::expect_says(lines[1].text, "config withdrawn: applied | in force 0f3b");
  const auto said = nlohmann::json::parse(lines[0].json);
  EXPECT_EQ(said["errors_in_all"], 300);
  EXPECT_EQ(said["topic"], "fx/edge7/config/desired");
}

TEST(AuditReport, TextOfASenderMovesNoCursor) {
  Report report;
  Head head;
  Receipt bad = receipt(1);
  bad.by = "\x1b[2J\n";
  report.add(seal(head, answered(bad, R"({"id":null,"detail":"\u001b[31m"})", kNow)));
  const std::string text = report.take().at(0).text;
  EXPECT_EQ(text.find('\x1b'), std::string::npos) << text;
  EXPECT_EQ(text.find('\n'), std::string::npos);
}

TEST(AuditReport, SinceIsATimeOrADuration) {
  EXPECT_EQ(since_from("1790000000123", kNow), 1790000000123);
  EXPECT_EQ(since_from("2026-09-21", kNow), 1789948800000);
  EXPECT_EQ(since_from("2026-09-21T13:33", kNow), 1789997580000);
  EXPECT_EQ(since_from("2026-09-21T13:33:20Z", kNow), 1789997600000);
  EXPECT_EQ(since_from("2h", kNow), kNow - 7200000);
  EXPECT_EQ(since_from("90s", kNow), kNow - 90000);
  EXPECT_EQ(since_from("7d", kNow), kNow - 604800000);
  for (const char* wrong : {"", "h", "-2h", "2y", "2026-13-01", "2026-02-30", "yesterday",
                            "2026-09-21T25:00", "99999999999999999999"})
    EXPECT_FALSE(since_from(wrong, kNow)) << wrong;
}

}  // namespace
}  // namespace fxagent::audit
