// The output of `fxagent read`.
#include "agent/cli/report/read_report.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "protocol/value/pack.h"

namespace fxagent {
namespace {

std::shared_ptr<const TagUnits> units(TagUnits of) {
  return std::make_shared<const TagUnits>(std::move(of));
}

/// 230.5 V from a device that sends the high word first; `image` is low byte first.
ReadReport voltage(ByteOrder configured) {
  ReadReport report;
  report.name = "voltage";
  report.address = "ir:0";
  report.units = units({.unit = "V"});
  report.point.emplace();
  report.point->address = {"ir:0", {1, 0, 16}, Unit::word, false};
  report.point->type = DataType::float32;
  report.point->order = configured;
  report.image = {0x66, 0x43, 0x00, 0x80};
  report.value = *unpack(*report.point, report.image, 0);
  return report;
}

ReadReport mode() {
  ReadReport report;
  report.name = "mode";
  report.address = "hr:7";
  report.units = units({.states = {{0, "idle"}, {1, "run"}}});
  report.value = Value(std::int64_t{1});
  return report;
}

ReadReport refused() {
  return {.name = "level", .address = "hr:900", .reason = "nak", .detail = "illegal data address"};
}

TEST(ReadReport, AValueHasItsUnitAndLabel) {
  EXPECT_EQ(value_text(Value(23.4), {.unit = "bar"}), "23.4 bar");
  EXPECT_EQ(value_text(Value(true), {.states = {{1, "on"}}}), "true (on)");
  EXPECT_EQ(value_text(Value::array({std::int64_t{1}, std::int64_t{2}}), {.unit = "A"}),
            "[1, 2] A");
  EXPECT_EQ(value_text(Value(BigInteger{"18446744073709551615"}), {.unit = "Wh"}),
            "18446744073709551615 Wh");
  EXPECT_EQ(value_text(Value(std::string("a\nb")), {}), "\"a\\nb\"");
}

TEST(ReadReport, ATableHasALineForEachTag) {
  const std::vector<ReadReport> reports{voltage(ByteOrder::abcd), mode(), refused()};
  EXPECT_EQ(read_table(reports, ShowOrders::no),
            "  voltage  ir:0    230.5 V\n"
            "  mode     hr:7    1 (run)\n"
            "  level    hr:900  nak: illegal data address\n");
}

TEST(ReadReport, OrdersStandSideBySideAndTheConfiguredOneIsMarked) {
  const std::vector<ReadReport> reports{voltage(ByteOrder::abcd), mode()};
  const std::string table = read_table(reports, ShowOrders::yes);
  EXPECT_TRUE(table.starts_with("  name     address  type")) << table;
  EXPECT_NE(table.find("230.5*"), std::string::npos) << table;
  const auto json = nlohmann::json::parse(read_json("meter1", reports, ShowOrders::yes, 4.2));
  EXPECT_EQ(json["ok"], true);
  EXPECT_EQ(json["tags"][0]["orders"]["ABCD"], nlohmann::json::parse("[230.5]"));
  // 8000 4366 and 6643 0080 by IEEE 754
  EXPECT_NEAR(json["tags"][0]["orders"]["CDAB"][0].get<double>(), -2.4178e-41, 1e-44);
  EXPECT_NEAR(json["tags"][0]["orders"]["BADC"][0].get<double>(), 2.3021e23, 1e20);
  EXPECT_FALSE(json["tags"][1].contains("orders"));
}

TEST(ReadReport, OnlyTheOrdersThatTheDeviceCanHaveAreShown) {
  ReadReport report = voltage(ByteOrder::abcd);
  report.orders = std::span(kByteOrders).first(2);
  const std::string table = read_table(std::span(&report, 1), ShowOrders::yes);
  EXPECT_NE(table.find("CDAB"), std::string::npos) << table;
  EXPECT_EQ(table.find("BADC"), std::string::npos) << table;
  const auto json =
      nlohmann::json::parse(read_json("m", std::span(&report, 1), ShowOrders::yes, 1));
  EXPECT_EQ(json["tags"][0]["orders"].size(), 2U);
}

TEST(ReadReport, AFloatThatIsPlainInAnotherOrderHasAHint) {
  EXPECT_EQ(hint_of(voltage(ByteOrder::abcd)), "");
  const std::vector<ReadReport> reports{voltage(ByteOrder::cdab)};
  EXPECT_EQ(hint_of(reports[0]),
            "voltage: in word order ABCD it is 230.5: compare word_order with the device");
  EXPECT_NE(read_table(reports, ShowOrders::no).find("\nhint: voltage: in word order ABCD"),
            std::string::npos);
  EXPECT_EQ(nlohmann::json::parse(read_json("m", reports, ShowOrders::no, 1))["tags"][0]["hint"],
            hint_of(reports[0]));
}

TEST(ReadReport, JsonIsNotOkWhereATagHasNoValue) {
  const std::vector<ReadReport> reports{mode(), refused()};
  const auto json = nlohmann::json::parse(read_json("meter1", reports, ShowOrders::no, 4.2));
  EXPECT_EQ(json, nlohmann::json::parse(R"({"ok": false, "device": "meter1", "ms": 4.2, "tags": [
      {"name": "mode", "address": "hr:7", "unit": "", "values": [1]},
      {"name": "level", "address": "hr:900", "unit": "", "reason": "nak",
       "detail": "illegal data address"}]})"));
}

}  // namespace
}  // namespace fxagent
