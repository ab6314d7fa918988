// `fxagent plan` for a device whose protocol can read several places in one frame.

#include <gtest/gtest.h>

#include "agent/cli/report/plan_report.h"
#include "agent/config/loader.h"
#include "tests/protocol/gathering_codec.h"

namespace fxagent::test {
namespace {

double ms(std::chrono::nanoseconds duration) {
  return std::chrono::duration<double, std::milli>(duration).count();
}

/// One device at 9600 baud that polls these places; the test replaces its protocol.
Config config_of(const std::vector<std::string>& addresses) {
  auto config = parse_config(
      R"({"agent":{"id":"e","root":"r"},"mqtt":{"servers":["mqtt://127.0.0.1:1883"]},)"
      R"("links":[{"name":"l","serial":{"path":"/dev/x","baud":9600}}],)"
      R"("devices":[{"name":"p","link":"l","protocol":"modbus-ascii","turnaround_ms":20,)"
      R"("groups":[{"name":"g","interval_ms":1000}],)"
      R"("tags":[{"name":"t","address":"hr:0","group":"g"}]}]})");
  EXPECT_TRUE(config.has_value());
  DeviceConfig& device = config->devices[0];
  auto codec = std::make_shared<GatheringCodec>(gathering_codec());
  codec->commands = {{1, 24}};
  device.codec = codec;
  const TagConfig one = device.tags[0];
  device.tags.clear();
  for (const std::string& address : addresses) {
    TagConfig tag = one;
    tag.point.address = *codec->parse_address(address, std::nullopt);
    tag.point.type = default_type(tag.point.address);
    device.tags.push_back(tag);
  }
  return *config;
}

TEST(PlanReportGather, PlacesThatGoTogetherAreOneExchangeWithTheirNames) {
  const auto links = plan_links(config_of({"W5", "W900", "V30"}));
  ASSERT_EQ(links[0].groups.size(), 1U);
  const GroupLoad& group = links[0].groups[0];
  ASSERT_EQ(group.exchanges.size(), 1U);
  const ExchangeReport& exchange = group.exchanges[0];
  EXPECT_TRUE(exchange.gathered);
  EXPECT_EQ(exchange.addresses, (std::vector<std::string>{"W5", "W900", "V30"}));
  EXPECT_EQ(exchange.bytes(), 6U);
  // 14 characters of frame, 6 for each part, and two for each byte.
  EXPECT_EQ(exchange.chars, 14U + 3 * 6 + 12);
  EXPECT_NEAR(ms(*exchange.line_time), 20 + 44 * 10 / 9.6, 0.01);
  EXPECT_NEAR(ms(*group.line_time), 20 + 44 * 10 / 9.6, 0.01);
}

TEST(PlanReportGather, ItsLineTimeIsTheSumOfWhereItGoes) {
  const auto links = plan_links(config_of({"W5", "W900", "B37"}));
  const GroupLoad& group = links[0].groups[0];
  const LineTimeUse& use = group.use;
  const double character = 10 / 9.6;
  EXPECT_NEAR(ms(use.asked), (2 * 4 + 4.0 / 16) * character, 0.01);
  EXPECT_NEAR(ms(use.word_access), 4 * 15.0 / 16 * character, 0.01);
  EXPECT_NEAR(ms(use.framing), (14 + 3 * 6) * character, 0.01);
  EXPECT_NEAR(ms(use.unasked), 0, 0.01);
  EXPECT_NEAR(ms(use.turnaround), 20, 0.01);
  EXPECT_NEAR(ms(use.asked + use.framing + use.unasked + use.word_access + use.turnaround),
              ms(*group.line_time), 0.01);
}

TEST(PlanReportGather, TheBoundCountsTheWholeFrame) {
  const auto few = plan_links(config_of({"W5", "W900"}));
  const auto many = plan_links(config_of({"W5", "W900", "W1800", "W2700", "V30", "V900"}));
  ASSERT_TRUE(few[0].command_bound && many[0].command_bound);
  EXPECT_NEAR(ms(*many[0].command_bound - *few[0].command_bound), 4 * (6 + 4) * 10 / 9.6, 0.01);
}

}  // namespace
}  // namespace fxagent::test
