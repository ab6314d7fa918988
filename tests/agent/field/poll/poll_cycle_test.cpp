#include "agent/field/poll/poll_cycle.h"

#include <gtest/gtest.h>

#include "tests/agent/field/field_plant.h"
#include "tests/agent/field/port_frames.h"

namespace fxagent::test {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

/// D100, D200 and D300 in one group, each in a separate read.
struct PollCycleTest : ::testing::Test {
  PollCycleTest() : device(port_device()) {
    device.retries = 2;
    for (const char* address : {"D100", "D200", "D300"})
      device.tags.push_back(tag(*device.codec, address, address));
  }
  /// Starts a cycle of the device's only group, planned with `findings`.
  PollCycle begun(std::uint64_t findings = 0) const {
    PollCycle cycle(device, 0);
    cycle.use(make_plan(*device.codec, cycle.points(), LineCost{}, 2), findings);
    return cycle;
  }
  Exchange data(Bytes image) {
    Exchange exchange = answer(Reply::Kind::data);
    exchange.reply.image = std::move(image);
    return exchange;
  }
  Exchange nak() { return answer(Reply::Kind::nak); }
  static Exchange failed(Exchange::Outcome outcome) {
    Exchange exchange;
    exchange.outcome = outcome;
    return exchange;
  }
  static void take(PollCycle& cycle, std::uint32_t read, Exchange exchange) {
    cycle.take(ReadIndices(&read, 1), std::move(exchange));
  }
  Telemetry finished(PollCycle& cycle, bool doubted = false, std::uint64_t findings = 0) {
    auto message = cycle.finish(doubted, findings, 9000, now);
    EXPECT_TRUE(message);
    return message.value_or(Telemetry{});
  }

  DeviceConfig device;
  SteadyTime now{};
  std::int64_t now_ms = 1000;

 private:
  /// Each answer arrives 10 ms after the previous one.
  Exchange answer(Reply::Kind kind) {
    Exchange exchange;
    exchange.outcome = Exchange::Outcome::answered;
    exchange.reply.kind = kind;
    exchange.ended = now += milliseconds(10);
    exchange.ended_ms = now_ms += 10;
    return exchange;
  }
};

struct PollCycleBegun : PollCycleTest {
  PollCycle cycle = begun();
};

TEST_F(PollCycleBegun, SampleHasTheValuesTheSpanAndTheTimeOfTheLastReply) {
  ASSERT_EQ(cycle.reads().plan().reads.size(), 3U);
  for (std::uint32_t read = 0; read < 3; ++read) take(cycle, read, data(word(7 + read)));
  const Telemetry message = finished(cycle);
  ASSERT_EQ(message.readings.size(), 3U);
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_FALSE(message.readings[i].bad);
    EXPECT_EQ(message.readings[i].value, number(static_cast<std::int64_t>(7 + i)));
  }
  EXPECT_EQ(message.ts_ms, 1030);
  EXPECT_EQ(message.span_ms, 20.0);
  EXPECT_FALSE(message.partial);
  EXPECT_FALSE(cycle.first_bad());
}

TEST_F(PollCycleTest, WhatWasRefusedIsReadInPartsInTheSameCycle) {
  PollCycle cycle(device, 0);
  const auto plan_of = [&](const std::vector<Point>& points, std::uint32_t most) {
    return make_plan(*device.codec, points, LineCost{milliseconds(1), seconds(1)}, most);
  };
  device.tags[1] = tag(*device.codec, "D101", "D101");
  cycle.use(plan_of(cycle.points(), 64), 0);
  ASSERT_EQ(cycle.reads().plan().reads.size(), 2U);
  take(cycle, 0, nak());
  const std::vector<std::uint32_t> points =
      cycle.reads().points_of(cycle.reads().plan().exchanges[0]);
  ASSERT_EQ(points, (std::vector<std::uint32_t>{0, 1}));
  cycle.reads().read_instead(points, plan_of({device.tags[0].point, device.tags[1].point}, 2));
  ASSERT_EQ(cycle.reads().plan().exchange_count(), 4U);
  take(cycle, 1, data(word(9)));
  take(cycle, 2, data(word(7)));
  take(cycle, 3, nak());
  const Telemetry message = finished(cycle);
  EXPECT_EQ(message.readings[0].value, number(7));
  EXPECT_EQ(message.readings[1].bad, BadReason::nak);
  EXPECT_EQ(message.readings[2].value, number(9));
}

TEST_F(PollCycleBegun, WhatIsLeftOutInPartsIsRefused) {
  take(cycle, 1, nak());
  Holes holes;
  holes.missing = {*span_of(device.tags[1].point)};
  cycle.reads().read_instead({1}, make_plan(*device.codec, std::vector<Point>{device.tags[1].point},
                                            LineCost{}, 2, holes));
  EXPECT_EQ(cycle.reads().plan().exchange_count(), 3U);
  take(cycle, 0, data(word(7)));
  take(cycle, 2, data(word(9)));
  const Telemetry message = finished(cycle);
  EXPECT_EQ(message.readings[1].bad, BadReason::nak);
  EXPECT_EQ(message.readings[2].value, number(9));
}

TEST_F(PollCycleBegun, WhatWasReadAlreadyIsNotReadAgainInParts) {
  take(cycle, 0, data(word(7)));
  take(cycle, 1, nak());
  cycle.reads().read_instead(
      {0, 1},
      make_plan(*device.codec, std::vector<Point>{device.tags[0].point, device.tags[1].point},
                LineCost{}, 2));
  EXPECT_TRUE(cycle.reads().has_images(std::vector{3U}));
  EXPECT_FALSE(cycle.reads().has_images(std::vector{4U}));
  take(cycle, 2, data(word(9)));
  take(cycle, 4, data(word(8)));
  const Telemetry message = finished(cycle);
  for (std::size_t i = 0; i < 3; ++i)
    EXPECT_EQ(message.readings[i].value, number(i == 0 ? 7 : i == 1 ? 8 : 9));
}

TEST_F(PollCycleBegun, FailedReadTakesOnlyItsOwnTagsAlong) {
  take(cycle, 0, data(word(7)));
  take(cycle, 1, nak());
  take(cycle, 2, failed(Exchange::Outcome::garbled));
  const Telemetry message = finished(cycle);
  EXPECT_FALSE(message.readings[0].bad);
  EXPECT_EQ(message.readings[1].bad, BadReason::nak);
  EXPECT_EQ(message.readings[2].bad, BadReason::bad_frame);
  EXPECT_EQ(cycle.first_bad()->why, BadReason::nak);
}

TEST_F(PollCycleBegun, GivenUpCycleKeepsWhatWasRead) {
  take(cycle, 0, data(word(7)));
  cycle.reads().give_up(BadReason::timeout);
  const Telemetry message = finished(cycle);
  EXPECT_FALSE(message.readings[0].bad);
  EXPECT_EQ(message.readings[1].bad, BadReason::timeout);
  EXPECT_EQ(message.readings[2].bad, BadReason::timeout);
  EXPECT_EQ(message.ts_ms, 1010);
  EXPECT_FALSE(message.span_ms) << "one reply has no span";
}

TEST_F(PollCycleBegun, CycleWithoutAnyReplyHasTheTimeOfItsEnd) {
  cycle.reads().give_up(BadReason::link_down);
  const Telemetry message = finished(cycle);
  EXPECT_EQ(message.ts_ms, 9000);
  for (const TagReading& reading : message.readings) EXPECT_EQ(reading.bad, BadReason::link_down);
}

TEST_F(PollCycleBegun, ReadIsRepeatedAsOftenAsTheConfigAllowsAndTheNextOneAnew) {
  EXPECT_TRUE(cycle.may_repeat());
  EXPECT_TRUE(cycle.may_repeat());
  EXPECT_FALSE(cycle.may_repeat());
  take(cycle, 0, nak());
  EXPECT_TRUE(cycle.may_repeat());
}

TEST_F(PollCycleBegun, WrittenValueIsASampleAndNewerThanWhatTheCycleHasRead) {
  take(cycle, 0, data(word(7)));
  const Telemetry at_once = cycle.written(0, number(50), 1015);
  EXPECT_TRUE(at_once.partial);
  EXPECT_EQ(at_once.ts_ms, 1015);
  ASSERT_EQ(at_once.readings.size(), 1U);
  EXPECT_EQ(at_once.readings[0].value, number(50));
  take(cycle, 1, data(word(8)));
  take(cycle, 2, data(word(9)));
  EXPECT_EQ(finished(cycle).readings[0].value, number(50));
}

TEST_F(PollCycleBegun, WrittenValueIsOlderThanAReadThatComesAfterIt) {
  cycle.written(1, number(50), 1000);
  for (std::uint32_t read = 0; read < 3; ++read) take(cycle, read, data(word(7)));
  EXPECT_EQ(finished(cycle).readings[1].value, number(7));
}

TEST_F(PollCycleBegun, WrittenValueStandsWhereTheRestOfTheCycleIsGivenUp) {
  cycle.written(1, number(50), 1000);
  cycle.reads().give_up(BadReason::timeout);
  const Telemetry message = finished(cycle);
  EXPECT_EQ(message.readings[0].bad, BadReason::timeout);
  EXPECT_FALSE(message.readings[1].bad);
  EXPECT_EQ(message.readings[1].value, number(50));
}

TEST_F(PollCycleTest, ArrayThatIsCutKeepsTheWholeThatWasWrittenBetweenItsReads) {
  device.tags.assign(1, array_of(tag(*device.codec, "recipe", "D100"), 2));
  PollCycle cycle = begun();
  ASSERT_EQ(cycle.reads().plan().reads.size(), 2U);
  take(cycle, 0, data(word(1)));
  cycle.written(0, numbers({50, 51}), 1015);
  take(cycle, 1, data(word(51)));
  EXPECT_EQ(finished(cycle).readings[0].value, numbers({50, 51}));
}

TEST_F(PollCycleBegun, PlaceThatMayHaveBeenWrittenIsBadUntilItIsReadAgain) {
  take(cycle, 0, data(word(7)));
  cycle.overwritten(*span_of(device.tags[0].point), nullptr, BadReason::timeout);
  EXPECT_EQ(cycle.reads().outdated(), 0U);
  take(cycle, 0, data(word(8)));
  EXPECT_FALSE(cycle.reads().outdated());
  take(cycle, 1, data(word(1)));
  take(cycle, 2, data(word(2)));
  const Telemetry message = finished(cycle);
  EXPECT_EQ(message.readings[0].value, number(8));
  EXPECT_EQ(message.readings[2].value, number(2));
}

TEST_F(PollCycleTest, ReadThatIsNotRepeatedInTimeTakesOnlyTheWrittenTagAlong) {
  device.tags[1] = tag(*device.codec, "beside", "D101");
  PollCycle cycle(device, 0);
  cycle.use(make_plan(*device.codec, cycle.points(), LineCost{}, 4), 0);
  ASSERT_EQ(cycle.reads().plan().reads.size(), 2U);
  take(cycle, 0, data({7, 0, 9, 0}));
  cycle.overwritten(*span_of(device.tags[0].point), nullptr, BadReason::nak);
  cycle.reads().give_up(BadReason::link_down);
  const Telemetry message = finished(cycle);
  EXPECT_EQ(message.readings[0].bad, BadReason::nak);
  EXPECT_TRUE(message.readings[0].value.items.empty()) << "nor is the older value its last one";
  EXPECT_FALSE(message.readings[1].bad);
  EXPECT_EQ(message.readings[1].value, number(9));
  EXPECT_EQ(message.readings[2].bad, BadReason::link_down);
}

TEST_F(PollCycleBegun, FloodOfLostWritesDoesNotKeepACycleFromItsEnd) {
  take(cycle, 0, data(word(7)));
  cycle.overwritten(*span_of(device.tags[0].point), nullptr, BadReason::timeout);
  take(cycle, 0, data(word(8)));
  cycle.overwritten(*span_of(device.tags[0].point), nullptr, BadReason::timeout);
  EXPECT_FALSE(cycle.reads().outdated()) << "once in a cycle";
  take(cycle, 1, data(word(1)));
  take(cycle, 2, data(word(2)));
  const Telemetry message = finished(cycle);
  EXPECT_EQ(message.readings[0].bad, BadReason::timeout);
  EXPECT_FALSE(message.readings[1].bad);
}

TEST_F(PollCycleBegun, TwoLostWritesInARowStillLeaveOneReadToItsTurn) {
  take(cycle, 0, data(word(7)));
  cycle.overwritten(*span_of(device.tags[0].point), nullptr, BadReason::timeout);
  cycle.overwritten(*span_of(device.tags[0].point), nullptr, BadReason::timeout);
  ASSERT_EQ(cycle.reads().outdated(), 0U);
  take(cycle, 0, data(word(8)));
  take(cycle, 1, data(word(1)));
  take(cycle, 2, data(word(2)));
  const Telemetry message = finished(cycle);
  EXPECT_FALSE(message.readings[0].bad);
  EXPECT_EQ(message.readings[0].value, number(8));
}

TEST_F(PollCycleBegun, ReadAgainThatFailsIsNotRepeatedForEver) {
  take(cycle, 0, data(word(7)));
  cycle.overwritten(*span_of(device.tags[0].point), nullptr, BadReason::timeout);
  take(cycle, 0, nak());
  EXPECT_FALSE(cycle.reads().outdated());
  take(cycle, 1, data(word(1)));
  take(cycle, 2, data(word(2)));
  EXPECT_EQ(finished(cycle).readings[0].bad, BadReason::timeout);
}

TEST_F(PollCycleTest, HalvesOfAnArrayThatWereReadOnBothSidesOfAWriteAreNotMixed) {
  device.tags.assign(1, array_of(tag(*device.codec, "recipe", "D100"), 2));
  PollCycle cycle = begun();
  take(cycle, 0, data(word(1)));
  const Bytes written{50, 0, 51, 0};
  cycle.overwritten(*span_of(device.tags[0].point), &written, BadReason::timeout);
  take(cycle, 1, data(word(51)));
  EXPECT_EQ(finished(cycle).readings[0].value, numbers({50, 51}));
}

TEST_F(PollCycleTest, ForeignBytesDuringTheCycleMakeAllOfItBad) {
  PollCycle cycle = begun(3);
  take(cycle, 0, data(word(1)));
  take(cycle, 1, nak());
  take(cycle, 2, data(word(1)));
  const Telemetry message = finished(cycle, false, 4);
  EXPECT_EQ(message.readings[0].bad, BadReason::bad_frame);
  EXPECT_EQ(message.readings[1].bad, BadReason::nak) << "a reason of its own goes first";
  EXPECT_EQ(message.readings[2].bad, BadReason::bad_frame);
}

TEST_F(PollCycleTest, NothingIsGoodOnADoubtedBus) {
  PollCycle cycle = begun(4);
  for (std::uint32_t read = 0; read < 3; ++read) take(cycle, read, data(word(1)));
  for (const TagReading& reading : finished(cycle, true, 4).readings)
    EXPECT_EQ(reading.bad, BadReason::bad_frame);
}

TEST_F(PollCycleTest, NewCycleKnowsNothingOfTheOneBefore) {
  PollCycle cycle = begun(0);
  cycle.written(0, number(50), 1000);
  cycle.reads().give_up(BadReason::timeout);
  cycle.begin(5);
  for (std::uint32_t read = 0; read < 3; ++read) take(cycle, read, data(word(1)));
  for (const TagReading& reading : finished(cycle, false, 5).readings) {
    EXPECT_FALSE(reading.bad);
    EXPECT_EQ(reading.value, number(1));
  }
}

TEST_F(PollCycleBegun, WhatWasSaidIsNotSaidAgain) {
  for (std::uint32_t read = 0; read < 3; ++read) take(cycle, read, data(word(7)));
  finished(cycle);
  EXPECT_FALSE(cycle.reads().has_images(std::vector{0U}));
  cycle.reads().give_up(BadReason::link_down);  // as for a step of a cycle that never began
  for (const TagReading& reading : finished(cycle).readings)
    EXPECT_EQ(reading.bad, BadReason::link_down);
}

TEST_F(PollCycleTest, TagWithoutAReadIsUnsupportedOrWasRefused) {
  PollCycle cycle(device, 0);
  Plan plan = make_plan(*device.codec, cycle.points(), LineCost{}, 2);
  plan.sources[0] = {};
  plan.sources[2] = {};
  plan.refused = {2};
  cycle.use(std::move(plan), 0);
  take(cycle, 1, data(word(1)));
  const Telemetry message = finished(cycle);
  EXPECT_EQ(message.readings[0].bad, BadReason::unsupported);
  EXPECT_FALSE(message.readings[1].bad);
  EXPECT_EQ(message.readings[2].bad, BadReason::nak);
}

TEST_F(PollCycleTest, ValueThatIsNoNumberIsBadValue) {
  device.tags[0].point.type = DataType::bcd16;
  PollCycle cycle = begun();
  for (std::uint32_t read = 0; read < 3; ++read) take(cycle, read, data(word(0x0A00)));
  EXPECT_EQ(finished(cycle).readings[0].bad, BadReason::bad_value);
}

TEST_F(PollCycleTest, ValueThatIsNoneIsToldOnceWithWhatIsThere) {
  device.tags[0].point.type = DataType::bcd16;
  PollCycle cycle = begun();
  const auto told_after = [&](std::uint16_t raw, seconds pause) {
    now += pause;
    cycle.begin(0);
    for (std::uint32_t read = 0; read < 3; ++read) take(cycle, read, data(word(raw)));
    cycle.finish(false, 0, 5000, now);
    return cycle.take_no_values();
  };
  const auto told = told_after(0x0A00, seconds(0));
  ASSERT_EQ(told.size(), 1U);
  EXPECT_EQ(told[0].tag, 0U);
  EXPECT_NE(told[0].why.find("0A00 is not BCD"), std::string::npos) << told[0].why;
  for (int poll = 0; poll < 100; ++poll) {
    EXPECT_TRUE(told_after(0x0A00, seconds(1)).empty());
    EXPECT_TRUE(told_after(0x0100, seconds(1)).empty());
  }
  EXPECT_TRUE(told_after(0x0100, seconds(60)).empty());
  EXPECT_EQ(told_after(0x0A01, seconds(1)).size(), 1U)
      << "after a minute of values it is news again";
}

TEST_F(PollCycleTest, FloatThatIsPlainInAnotherWordOrderIsToldOnce) {
  Point& point = device.tags[0].point;
  point.address = *device.codec->addresses().parse_address("D100", DataType::float32);
  point.type = DataType::float32;
  point.order = ByteOrder::cdab;
  PollCycle cycle = begun();
  const auto told_of = [&](std::uint16_t first, std::uint16_t second) {
    cycle.begin(0);
    take(cycle, 0, data(word(first)));
    take(cycle, 1, data(word(second)));
    for (std::uint32_t read = 2; read < 4; ++read) take(cycle, read, data(word(1)));
    EXPECT_FALSE(finished(cycle).readings[0].bad) << "it is a number all the same";
    return cycle.take_no_values();
  };
  EXPECT_TRUE(told_of(0x8000, 0x4366).empty()) << "230.5, low word first";
  const auto told = told_of(0x4366, 0x8000);  // 230.5, high word first
  ASSERT_EQ(told.size(), 1U);
  EXPECT_EQ(told[0].tag, 0U);
  EXPECT_NE(told[0].why.find("e-41"), std::string::npos) << told[0].why;
  EXPECT_EQ(told[0].hint, "in word order ABCD it is 230.5: compare word_order with the device");
  EXPECT_TRUE(told_of(0x4366, 0x8000).empty());
}

TEST_F(PollCycleTest, GroupThatHasNothingNewToSayHasNoSample) {
  device.groups[0].on_change = true;
  PollCycle cycle = begun();
  for (std::uint32_t read = 0; read < 3; ++read) take(cycle, read, data(word(1)));
  finished(cycle);
  cycle.begin(0);
  for (std::uint32_t read = 0; read < 3; ++read) take(cycle, read, data(word(1)));
  EXPECT_FALSE(cycle.finish(false, 0, 9000, now));
}

TEST_F(PollCycleTest, TagWithAnotherNameOnThePlcIsBadUntilTheModelIsRight) {
  const auto codec = [](const char* model) {
    return codec_of("mc-3e", {{"model", std::string(model)}});
  };
  device = device_on("mc-3e", codec("Q"));
  for (const char* address : {"X7", "X10", "D10"})
    device.tags.push_back(tag(*device.codec, address, address));
  PollCycle cycle(device, 0);
  const auto bad_by = [&](const char* model) {
    cycle.compare(*device.codec, model == nullptr ? nullptr : codec(model).get());
    cycle.use(make_plan(*device.codec, cycle.points(), LineCost{}, 64), 0);
    for (std::uint32_t read = 0; read < cycle.reads().plan().reads.size(); ++read)
      take(cycle, read, data(Bytes((cycle.reads().plan().reads[read].read.span.bits + 7) / 8)));
    std::vector<std::optional<BadReason>> bad;
    for (const TagReading& reading : finished(cycle).readings) bad.push_back(reading.bad);
    return bad;
  };
  using Bad = std::vector<std::optional<BadReason>>;
  EXPECT_EQ(bad_by("FX5U"), (Bad{std::nullopt, BadReason::unsupported, std::nullopt}))
      << "X10 is X20 there";
  EXPECT_EQ(bad_by("iQ-R"), Bad(3)) << "all names are the same";
  EXPECT_EQ(bad_by("FX5U").at(1), BadReason::unsupported);
  EXPECT_EQ(bad_by(nullptr), Bad(3));
}

}  // namespace
}  // namespace fxagent::test
