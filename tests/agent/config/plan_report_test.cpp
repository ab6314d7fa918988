#include "agent/plan_report.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <string>

namespace fxagent {
namespace {

using std::chrono::milliseconds;
using std::chrono::nanoseconds;

double ms(nanoseconds duration) {
  return std::chrono::duration<double, std::milli>(duration).count();
}

Config config_of(const std::string& link, const std::string& device) {
  const std::string text =
      R"({"agent":{"id":"e","root":"r"},"mqtt":{"servers":["mqtt://127.0.0.1:1883"]},"links":[)" +
      link + R"(],"devices":[)" + device + "]}";
  auto config = parse_config(text);
  EXPECT_TRUE(config.has_value()) << (config ? "" : config.error().front().text);
  return config ? *config : Config{};
}

const std::string kSerial = R"({"name":"l","serial":{"path":"/dev/x","baud":9600}})";

std::string plc(const std::string& tags, const std::string& more = "") {
  return R"({"name":"p","link":"l","protocol":"fx-programming-port","model":"FX3U","turnaround_ms":0,)"
         R"("groups":[{"name":"g","interval_ms":1000}],"tags":[)" +
         tags + "]" + more + "}";
}

/// 100 D and 64 M in one group, as two arrays.
const std::string kLarge = R"({"name":"d","address":"D0","count":100,"group":"g"},
                              {"name":"m","address":"M0","count":64,"group":"g"})";

TEST(PlanReport, LeastLineTimeIsThatOfTheCharactersCounted) {
  const auto links = plan_links(config_of(kSerial, plc(kLarge)));
  ASSERT_EQ(links.size(), 1U);
  ASSERT_EQ(links[0].groups.size(), 1U);
  const GroupReportLine& group = links[0].groups[0];
  // 64, 64, 64 and 8 bytes of D, 8 bytes of M: five times 11 + 4 characters, and two for each byte.
  ASSERT_TRUE(group.line_time);
  EXPECT_NEAR(ms(*group.line_time), 511.5, 0.1);
  EXPECT_EQ(group.exchanges.size(), 5U);
  for (const ExchangeReport& exchange : group.exchanges)
    EXPECT_NEAR(ms(*exchange.line_time), (15 + 2 * exchange.bytes) * 10 / 9.6, 0.01)
        << exchange.address;
  EXPECT_NEAR(ms(group.waste.framing), 5 * 15 * 10 / 9.6, 0.1);
  EXPECT_NEAR(ms(group.waste.unasked), 0, 0.01);
  EXPECT_EQ(group.waste.turnaround.count(), 0);
}

TEST(PlanReport, TimesOfTheOtherProtocolsAreThoseOfTheirFrames) {
  // Computer link, format 1 with sum: 17 there, 8 and 4 a word back, 5 for the ACK; 10 bits each.
  const auto link = plan_links(config_of(
      kSerial,
      R"({"name":"p","link":"l","protocol":"fx-computer-link","model":"FX3U","turnaround_ms":0,
          "groups":[{"name":"g"}],"tags":[{"name":"d","address":"D0","count":10,"group":"g"}]})"));
  EXPECT_NEAR(ms(*link[0].groups[0].line_time), (17 + 8 + 40 + 5) * 10 / 9.6, 0.01);
  // Modbus RTU 8E1: 8 there, 5 and 2 a register back, 3.5 of silence; 11 bits each.
  const auto rtu = plan_links(
      config_of(kSerial, R"({"name":"p","link":"l","protocol":"modbus-rtu","turnaround_ms":0,
          "groups":[{"name":"g"}],"tags":[{"name":"d","address":"hr:0","count":10,"group":"g"}]})"));
  EXPECT_NEAR(ms(*rtu[0].groups[0].line_time), (8 + 5 + 20 + 3.5) * 11 / 9.6, 0.01);
  EXPECT_NEAR(ms(rtu[0].groups[0].waste.turnaround), 3.5 * 11 / 9.6, 0.01);
}

TEST(PlanReport, TheBoundIsTheLongestPollAndTheOrderItself) {
  const auto links = plan_links(config_of(
      kSerial,
      plc(kLarge + R"(,{"name":"s","address":"D500","group":"g","access":"read_write"})")));
  // A poll of 64 bytes; a write of 11 + 4 and 1 characters; a read of 11 and 8.
  EXPECT_NEAR(ms(*links[0].command_bound), (15 + 128 + 16 + 19) * 10 / 9.6, 0.1);
}

TEST(PlanReport, SmallerBlocksTakeLongerAndLetCommandsThroughSooner) {
  const auto links = plan_links(config_of(
      kSerial,
      plc(kLarge + R"(,{"name":"s","address":"D500","group":"g","access":"read_write"})")));
  ASSERT_EQ(links[0].block_trade.size(), 4U);
  for (std::size_t i = 0; i + 1 < 3; ++i) {
    EXPECT_GT(links[0].block_trade[i].cycle, links[0].block_trade[i + 1].cycle);
    EXPECT_LT(links[0].block_trade[i].command_bound, links[0].block_trade[i + 1].command_bound);
  }
  EXPECT_EQ(links[0].block_trade[3].cycle, *links[0].groups[0].line_time);
  EXPECT_EQ(links[0].block_trade[3].command_bound, *links[0].command_bound);
}

TEST(PlanReport, AnOverloadNamesTheIntervalThatFits) {
  Config config = config_of(kSerial, plc(kLarge));
  config.devices[0].groups[0].interval = milliseconds(400);
  const auto links = plan_links(config);
  EXPECT_GT(*links[0].busy_percent, 100.0);
  ASSERT_EQ(links[0].warnings.size(), 1U);
  EXPECT_NE(links[0].warnings[0].find("p/g asks for 400 ms"), std::string::npos);
  // What it names is enough, and a little less is not.
  config.devices[0].groups[0].interval = *links[0].groups[0].shortest_interval;
  EXPECT_LE(*plan_links(config)[0].busy_percent, 100.1);
  config.devices[0].groups[0].interval -= milliseconds(10);
  EXPECT_GT(*plan_links(config)[0].busy_percent, 100.0);
}

TEST(PlanReport, WithoutASpeedThereAreNoTimes) {
  const auto links =
      plan_links(config_of(R"({"name":"l","tcp":{"host":"127.0.0.1","port":5551}})", plc(kLarge)));
  EXPECT_FALSE(links[0].busy_percent);
  EXPECT_FALSE(links[0].command_bound);
  EXPECT_FALSE(links[0].groups[0].line_time);
  EXPECT_FALSE(links[0].groups[0].exchanges.empty());
  EXPECT_NE(links[0].warnings[0].find("line_baud"), std::string::npos);
  const auto told = plan_links(config_of(
      R"({"name":"l","tcp":{"host":"127.0.0.1","port":5551},"line_baud":9600})", plc(kLarge)));
  EXPECT_EQ(told[0].baud, 9600);
  EXPECT_NEAR(ms(*told[0].groups[0].line_time), 511.5, 0.1);
}

TEST(PlanReport, AnOpenModelIsPlannedAsTheWidestAndThatIsSaid) {
  std::string device = plc(R"({"name":"d","address":"D5000","group":"g"})");
  device.replace(device.find("FX3U"), 4, "auto");
  const auto links = plan_links(config_of(kSerial, device));
  EXPECT_EQ(links[0].groups[0].exchanges.size(), 1U);
  EXPECT_NE(links[0].warnings[0].find("planned as FX3U"), std::string::npos);
}

TEST(PlanReport, AWhatIfJoinsTheGroupOfItsInterval) {
  Config config = config_of(kSerial, plc(kLarge));
  ASSERT_TRUE(add_what_if(config, "p D500..D563@1000"));
  EXPECT_EQ(config.devices[0].groups.size(), 1U);
  EXPECT_EQ(config.devices[0].tags.back().point.count, 64);
  ASSERT_TRUE(add_what_if(config, "p M500@200"));
  EXPECT_EQ(config.devices[0].groups.back().name, "what-if");
  EXPECT_EQ(plan_links(config)[0].groups.size(), 2U);
  EXPECT_FALSE(add_what_if(config, "p D7990..D8005@200"));
}

}  // namespace
}  // namespace fxagent
