#include "agent/commands/result.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "tests/agent/uplink/plant.h"

namespace fxagent {
namespace {

using nlohmann::json;
using namespace std::chrono_literals;

TEST(ResultText, IsTheContractsExample) {
  CommandResult result = test::succeeded("b7e1");
  result.targets[0].verify = Verification{Value(std::int64_t{50}), true};
  result.received_ms = 1790000000000;
  result.queue = 22100us;
  result.wire = 38700us;
  result.bound = 230ms;
  EXPECT_EQ(json::parse(with_total(fxagent::result_text(result), 62ms)), json::parse(R"({
    "id": "b7e1", "status": "SUCCEEDED", "reason": null, "detail": null, "plc": "ACK",
    "op": "write", "tag": "setpoint", "address": "D200", "value": 50,
    "verify": {"read": 50, "match": true},
    "t": {"received": 1790000000000, "queue_ms": 22.1, "wire_ms": 38.7, "total_ms": 62.0,
          "bound_ms": 230.0}, "attempts": 1})"));
}

TEST(ResultText, RefusalOfWhatCouldNotBeReadHasNulls) {
  CommandResult result;
  result.reason = Reason::bad_json;
  result.detail = "not JSON";
  EXPECT_EQ(json::parse(with_total(fxagent::result_text(result), 0ms)), json::parse(R"({
    "id": null, "status": "REJECTED", "reason": "bad_json", "detail": "not JSON", "plc": null,
    "op": null, "tag": null, "address": null, "value": null, "verify": null,
    "t": {"received": 0, "queue_ms": 0, "wire_ms": 0, "total_ms": 0, "bound_ms": null},
    "attempts": 0})"));
}

TEST(ResultText, ListHasAStatusForEachTarget) {
  CommandResult result = test::succeeded("x");
  result.is_list = true;
  result.one_frame = true;
  result.dry_run = true;
  result.targets.push_back(result.targets[0]);
  result.targets[1].status = CommandStatus::failed;
  result.targets[1].reason = Reason::nak;
  result.targets[1].plc = PlcAnswer::nak;
  const json parsed = json::parse(with_total(fxagent::result_text(result), 0ms));
  EXPECT_FALSE(parsed.contains("tag"));
  EXPECT_EQ(parsed["one_frame"], true);
  EXPECT_EQ(parsed["dry_run"], true);
  ASSERT_EQ(parsed["targets"].size(), 2U);
  EXPECT_EQ(parsed["targets"][0]["status"], "SUCCEEDED");
  EXPECT_EQ(parsed["targets"][1]["reason"], "nak");
  EXPECT_EQ(parsed["targets"][1]["plc"], "NAK");
}

TEST(ResultText, DuplicateCarriesTheFirstResult) {
  CommandResult result;
  result.id = "x";
  result.status = CommandStatus::duplicate;
  result.reason = Reason::duplicate_id;
  EXPECT_EQ(json::parse(with_total(fxagent::result_text(result), 0ms))["first"], nullptr);
  result.first = std::make_shared<const CommandResult>(test::succeeded("x"));
  const json first = json::parse(with_total(fxagent::result_text(result), 0ms))["first"];
  EXPECT_EQ(first["status"], "SUCCEEDED");
  EXPECT_EQ(first["value"], 50);
}

TEST(ResultText, PartialListTellsHowFarItCameAndWhatBecameOfEachTarget) {
  CommandResult result;
  result.id = "a";
  result.op = "write";
  result.is_list = true;
  result.status = CommandStatus::partial;
  result.reason = Reason::shutting_down;
  result.progress = Progress{1, 2};
  result.targets.resize(2);
  result.targets[0].status = CommandStatus::succeeded;
  result.targets[1].status = CommandStatus::partial;
  result.targets[1].progress = Progress{32, 100};
  const json told = json::parse(fxagent::result_text(result));
  EXPECT_EQ(told["status"], "PARTIAL");
  EXPECT_EQ(told["reason"], "shutting_down");
  EXPECT_EQ(told["done"], 1);
  EXPECT_EQ(told["of"], 2);
  EXPECT_FALSE(told["targets"][0].contains("done"));
  EXPECT_EQ(told["targets"][1]["done"], 32);
  EXPECT_EQ(told["targets"][1]["of"], 100);
}

TEST(ResultText, OneExchangeHasNoProgress) {
  CommandResult result;
  result.status = CommandStatus::unknown_outcome;
  const json told = json::parse(fxagent::result_text(result));
  EXPECT_FALSE(told.contains("done") || told.contains("of"));
}

TEST(RecordedResult, PartialIsPartialAfterARestart) {
  const CommandResult result =
      fxagent::recorded_result(R"({"id":"a","status":"PARTIAL","plc":"NAK"})");
  EXPECT_EQ(result.status, CommandStatus::partial);
  EXPECT_EQ(result.plc, PlcAnswer::nak);
}

TEST(RecordedResult, DamagedRecordIsAnUnknownOutcomeAndNotPublishedAsItIs) {
  using namespace std::string_literals;
  for (const std::string& text : {""s, "{\"status\":\"SUCC"s, "[1]"s, "\xFF"s,
                                  "{\"status\":\"SUCCEEDED\"}\0,"s, "\xEF\xBB\xBF{}"s}) {
    CommandResult result = fxagent::recorded_result(text);
    result.id = "a";
    EXPECT_EQ(result.status, CommandStatus::unknown_outcome) << text;
    const json told = json::parse(fxagent::result_text(result));
    EXPECT_EQ(told["id"], "a");
    EXPECT_EQ(told["status"], "UNKNOWN_OUTCOME");
    EXPECT_EQ(told["detail"], "the record of the result is damaged");
  }
}

std::string text_of(const CommandResult& result) { return fxagent::result_text(result); }

TEST(ResultText, NoneIsLargerThanSixtyFourKibibytes) {
  CommandResult list;
  list.id = "b7e1";
  list.is_list = true;
  for (int i = 0; i < 64; ++i) {
    TargetResult target;
    target.tag = "t" + std::to_string(i);
    target.detail = std::string(1000, 'd');
    target.value = Value(std::string(100, 'v'));
    list.targets.push_back(target);
  }
  const auto without_details = json::parse(text_of(list));
  EXPECT_TRUE(without_details["targets"][0]["detail"].is_null());
  EXPECT_EQ(without_details["targets"][63]["value"], std::string(100, 'v'));
  for (TargetResult& target : list.targets) target.value = Value(std::string(2000, 'v'));
  const std::string text = text_of(list);
  EXPECT_LE(text.size(), 65536U);
  const auto without_values = json::parse(text);
  EXPECT_TRUE(without_values["targets"][0]["value"].is_null());
  EXPECT_EQ(without_values["targets"][0]["tag"], "t0");
  EXPECT_NE(without_values["detail"].get<std::string>().find("64 KiB"), std::string::npos);

  CommandResult again;
  again.id = "b7e1";
  again.status = CommandStatus::duplicate;
  again.detail = std::string(300, 'd');
  for (TargetResult& target : list.targets) target.value = Value(std::string(700, 'v'));
  again.first = std::make_shared<const CommandResult>(fxagent::recorded_result(text_of(list)));
  EXPECT_LE(text_of(again).size(), 65536U);
}

TEST(ResultText, LongestOneHasRoomForItsTotal) {
  CommandResult result;
  result.id = "b7e1";
  result.targets.resize(1);
  result.targets[0].value = Value(std::string());
  const std::size_t room = 65536 - text_of(result).size();
  for (std::size_t less = 0; less <= 30; ++less) {
    result.targets[0].value = Value(std::string(room - less, 'v'));
    EXPECT_LE(with_total(text_of(result), std::chrono::hours(23)).size(), 65536U) << less;
  }
}

// The targets of the DUPLICATE only repeat the command.
TEST(ResultText, DuplicateLeavesOutItsOwnTargetsBeforeWhatTheFirstResultSays) {
  CommandResult list;
  list.id = "b7e1";
  list.is_list = true;
  list.status = CommandStatus::partial;
  list.targets.resize(64);
  for (TargetResult& target : list.targets) {
    target.value = Value(std::string(500, 'v'));
    target.status = CommandStatus::failed;
    target.detail = "nak 06";
  }
  CommandResult again = list;
  again.status = CommandStatus::duplicate;
  again.first = std::make_shared<const CommandResult>(fxagent::recorded_result(text_of(list)));
  const json told = json::parse(text_of(again));
  EXPECT_EQ(told["targets"].size(), 0U);
  EXPECT_EQ(told["first"], json::parse(text_of(list)));

  for (TargetResult& target : list.targets) target.value = Value(std::string(880, 'v'));
  ASSERT_EQ(json::parse(text_of(list))["targets"][63]["value"], std::string(880, 'v'));
  again.first = std::make_shared<const CommandResult>(fxagent::recorded_result(text_of(list)));
  const std::string text = text_of(again);
  EXPECT_LE(text.size(), 65536U);
  EXPECT_EQ(json::parse(text)["first"]["targets"][63]["status"], "FAILED");
}

TEST(ResultText, DuplicateOfARecordWithTargetsThatAreNoneIsWritten) {
  for (const std::string targets : {"[1]", "5", "{\"a\":1}"}) {
    CommandResult again;
    again.status = CommandStatus::duplicate;
    again.first = std::make_shared<const CommandResult>(
        fxagent::recorded_result(R"({"id":"a","status":"SUCCEEDED","pad":")" +
                                 std::string(65440, 'x') + R"(","targets":)" + targets + "}"));
    EXPECT_EQ(json::parse(text_of(again))["first"]["status"], "SUCCEEDED") << targets;
  }
}

TEST(ResultText, DuplicateOfALongValueKeepsTheOneOfTheFirstResult) {
  CommandResult write;
  write.id = "b7e1";
  write.targets.resize(1);
  write.targets[0].value = Value(std::string(40000, 'v'));
  write.targets[0].verify = Verification{.read = std::nullopt, .match = true};
  CommandResult again = write;
  again.status = CommandStatus::duplicate;
  again.first = std::make_shared<const CommandResult>(write);
  const json told = json::parse(text_of(again));
  EXPECT_TRUE(told["value"].is_null());
  EXPECT_EQ(told["first"], json::parse(text_of(write)));
}

TEST(ResultText, DuplicateOfTwoLongListsLeavesOutThatOfTheCommand) {
  CommandResult list;
  list.id = "b7e1";
  list.is_list = true;
  list.targets.resize(64);
  // Each control character of a tag takes six bytes in JSON.
  for (TargetResult& target : list.targets) target.tag = std::string(128, '\x01');
  CommandResult again = list;
  again.status = CommandStatus::duplicate;
  again.first = std::make_shared<const CommandResult>(list);
  const std::string text = text_of(again);
  EXPECT_LE(text.size(), 65536U);
  const json told = json::parse(text);
  EXPECT_EQ(told["targets"].size(), 0U);
  EXPECT_EQ(told["first"]["targets"].size(), 64U);
  EXPECT_NE(told["detail"].get<std::string>().find("asked for is left out"), std::string::npos);
}

}  // namespace
}  // namespace fxagent
