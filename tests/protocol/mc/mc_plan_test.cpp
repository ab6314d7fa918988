// The planner's mix of batch reads, random reads and blocks of the MC protocol.

#include <gtest/gtest.h>

#include <chrono>

#include "protocol/mc/mc.h"
#include "protocol/plan/plan.h"
#include "tests/protocol/every_plan.h"
#include "tests/support/pick.h"

namespace fxagent::mc {
namespace {

using namespace std::chrono_literals;
using test::EveryPlan;

Mc plc(Frame frame, Model model = Model::fx5u) {
  Mc::Settings settings;
  settings.frame = frame;
  settings.model = model;
  return Mc(settings);
}

Point point(const Codec& codec, const std::string& address,
            std::optional<DataType> type = std::nullopt) {
  Point out;
  const auto parsed = codec.addresses().parse_address(address, type);
  EXPECT_TRUE(parsed.has_value()) << address;
  out.address = *parsed;
  out.type = type.value_or(default_type(out.address));
  return out;
}

std::size_t gathered(const Plan& plan, std::uint32_t exchange) {
  const Request request = plan.request(plan.exchanges[exchange]);
  const auto* gather = std::get_if<Gather>(&request);
  return gather == nullptr ? 0 : gather->parts.size();
}

TEST(McPlan, ScatteredWordsAndBitsOverEthernetAreOneExchange) {
  for (const Frame frame : {Frame::e3, Frame::e4}) {
    const Mc codec = plc(frame);
    std::vector<Point> points;
    for (const char* name : {"D0", "D1500", "D3000", "D7000", "M5", "M3000", "M7000", "X17", "R5"})
      points.push_back(point(codec, name));
    points.push_back(point(codec, "D5000", DataType::int32));
    const Plan plan = make_plan(codec, points, LineCost{0ns, 2ms}, 0);
    ASSERT_EQ(plan.exchange_count(), 1U);
    EXPECT_EQ(gathered(plan, 0), points.size());
    EXPECT_TRUE(codec.encode(plan.request(plan.exchanges[0]), 1));
  }
}

TEST(McPlan, ADoubleWordSharesAFrameThatHasNoRoomForTwo) {
  for (const LineCost& cost : {LineCost{0ns, 2ms}, LineCost{1ms, 2ms}})
    for (const std::uint32_t bytes : {6U, 7U, 8U}) {
      Mc::Settings settings;
      settings.model = Model::fx5u;
      settings.max_block_bytes = bytes;
      const Mc codec(settings);
      const std::vector points{point(codec, "LCN0"), point(codec, "D0")};
      const Plan plan = make_plan(codec, points, cost, 0);
      ASSERT_EQ(plan.exchange_count(), 1U) << bytes;
      EXPECT_EQ(gathered(plan, 0), 2U) << bytes;
      EXPECT_TRUE(codec.encode(plan.request(plan.exchanges[0]), 1));
    }
}

TEST(McPlan, WhatOneBatchReadBringsIsOneBatchRead) {
  const Mc codec = plc(Frame::e3);
  std::vector<Point> points;
  for (int n = 0; n < 100; ++n) points.push_back(point(codec, "D" + std::to_string(n)));
  const Plan plan = make_plan(codec, points, LineCost{0ns, 2ms}, 0);
  ASSERT_EQ(plan.exchange_count(), 1U);
  EXPECT_EQ(gathered(plan, 0), 0U);
}

TEST(McPlan, MoreThanAFrameHoldsIsSharedOut) {
  const Mc codec = plc(Frame::e3, Model::l);
  std::vector<Point> points;
  for (int n = 0; n < 300; ++n) points.push_back(point(codec, "D" + std::to_string(40 * n)));
  const Plan plan = make_plan(codec, points, LineCost{0ns, 2ms}, 0);
  EXPECT_EQ(plan.exchange_count(), 2U);
  for (std::uint32_t e = 0; e < plan.exchange_count(); ++e)
    EXPECT_TRUE(codec.encode(plan.request(plan.exchanges[e]), 1));
}

TEST(McPlan, OverASerialLineNoOtherMixTakesLessLineTime) {
  test::Pick pick(4031);
  std::size_t mixed = 0;
  std::size_t alone = 0;
  for (int round = 0; round < 60; ++round) {
    const std::uint32_t far = round % 3 == 0 ? 4 : 80;
    const Mc codec = plc(round % 2 == 0 ? Frame::c3 : Frame::c4);
    const LineCost cost{std::chrono::nanoseconds(1041667), std::chrono::milliseconds(pick(0, 40))};
    std::vector<Point> points;
    for (std::uint32_t n = pick(2, 6); n > 0; --n)
      points.push_back(point(codec, (pick(0, 3) == 0 ? "M" : "D") + std::to_string(pick(0, far))));
    const Plan plan = make_plan(codec, points, cost, 0);
    ASSERT_EQ(plan.line_time.count(), EveryPlan(codec, points, cost).least()) << round;
    for (std::uint32_t e = 0; e < plan.exchange_count(); ++e) {
      EXPECT_TRUE(codec.encode(plan.request(plan.exchanges[e]), 1));
      (gathered(plan, e) > 0 ? mixed : alone) += 1;
    }
  }
  EXPECT_GT(mixed, 5U);
  EXPECT_GT(alone, 5U);
}

TEST(McPlan, OverASerialLineWordsAndBitsAreOneBlockRead) {
  for (const Frame frame : {Frame::c3, Frame::c4})
    for (const Model model : {Model::fx5u, Model::iq_r}) {
      const Mc codec = plc(frame, model);
      std::vector<Point> points;
      for (int n = 0; n < 100; ++n) points.push_back(point(codec, "D" + std::to_string(n)));
      for (int n = 0; n < 64; ++n) points.push_back(point(codec, "M" + std::to_string(n)));
      const LineCost cost{std::chrono::nanoseconds(86806), 5ms};
      const Plan plan = make_plan(codec, points, cost, 0);
      ASSERT_EQ(plan.exchange_count(), 1U);
      EXPECT_EQ(gathered(plan, 0), 2U);
      const Request request = plan.request(plan.exchanges[0]);
      EXPECT_EQ(std::get<Gather>(request).parts.front().gather, kBlockRead);
      EXPECT_TRUE(codec.encode(request, 1));
    }
  EXPECT_EQ(plc(Frame::c4, Model::l).gathers().size(), 1U);
  EXPECT_EQ(plc(Frame::c4, Model::unknown).gathers().size(), 1U);
}

// A part's cost must not depend on the other parts, or the planner's line times are wrong.
TEST(McPlan, APartAddsTheSameToEveryFrame) {
  for (const Frame frame : {Frame::e3, Frame::e4, Frame::c3, Frame::c4})
    for (const Model model : {Model::fx5u, Model::l, Model::iq_r}) {
      const Mc codec = plc(frame, model);
      for (const char* name : {"D100", "M32"}) {
        const Span place = codec.addresses().parse_address(name, std::nullopt)->span;
        for (const ReadWay& way : codec.addresses().read_ways(place.space)) {
          if (way.gather == 0) continue;
          const Read part{{place.space, place.first_bit, way.unit_bits}, way.way, way.gather};
          const auto chars = [&](std::size_t parts) {
            Gather gather;
            gather.parts.assign(parts, part);
            const LineLength length = codec.line_length(gather);
            return length.request_chars + length.reply_chars + length.closing_chars;
          };
          EXPECT_EQ(chars(2) - chars(1), chars(20) - chars(19)) << name;
          EXPECT_EQ(chars(20) - chars(1), 19 * (chars(2) - chars(1))) << name;
        }
      }
    }
}

}  // namespace
}  // namespace fxagent::mc
