#include "agent/field/poll/report_by_exception.h"

#include <gtest/gtest.h>

#include "tests/agent/field/field_plant.h"

namespace fxagent::test {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

const SteadyTime kStart{std::chrono::hours(1000)};

SteadyTime after(seconds time) { return kStart + time; }

/// temp (D100, scaled by 0.1), running (M0) and levels (D110-D112) in one group; one tag in
/// another.
DeviceConfig press() {
  DeviceConfig device = port_device();
  device.groups.push_back(group("slow", milliseconds(5000)));
  const Codec& codec = *device.codec;
  device.tags.push_back(scaled(tag(codec, "temp", "D100"), 0.1));
  device.tags.push_back(tag(codec, "elsewhere", "D300", std::nullopt, 1));
  device.tags.push_back(tag(codec, "running", "M0"));
  device.tags.push_back(array_of(tag(codec, "levels", "D110"), 3));
  return device;
}

DeviceConfig press_on_change(std::optional<double> deadband = std::nullopt) {
  DeviceConfig device = press();
  device.groups[0].on_change = true;
  device.groups[0].max_silent = seconds(60);
  device.tags[0].units = device.tags[3].units =
      std::make_shared<const TagUnits>(TagUnits{.limits = {.deadband = deadband}});
  return device;
}

/// The result of a cycle for one tag.
using Outcome = std::variant<Value, BadReason>;

std::vector<TagReading> brought(const std::vector<Outcome>& outcomes) {
  constexpr std::uint32_t kTags[] = {0, 2, 3};
  std::vector<TagReading> readings(outcomes.size());
  for (std::size_t i = 0; i < outcomes.size(); ++i) {
    readings[i].tag = kTags[i];
    if (const auto* value = std::get_if<Value>(&outcomes[i]))
      readings[i].value = *value;
    else
      readings[i].bad = std::get<BadReason>(outcomes[i]);
  }
  return readings;
}
std::vector<TagReading> good(double temp, bool running = true,
                             std::initializer_list<std::int64_t> levels = {1, 2, 3}) {
  return brought({real(temp), flag(running), numbers(levels)});
}
std::vector<TagReading> all(BadReason why) { return brought({why, why, why}); }

struct ReportByExceptionTest : ::testing::Test {
  const DeviceConfig device = press();
  ReportByException report{device, 0};
};

TEST(ReportByException, KnowsTheTagsOfItsGroupInTheirOrder) {
  const DeviceConfig device = press();
  EXPECT_EQ(ReportByException(device, 0).tags(), (std::vector<std::uint32_t>{0, 2, 3}));
  EXPECT_EQ(ReportByException(device, 1).tags(), (std::vector<std::uint32_t>{1}));
}

TEST_F(ReportByExceptionTest, PublishAlwaysSaysEveryCycle) {
  for (int i = 0; i < 3; ++i) {
    const auto readings = report.cycle(good(23.4), 1000 + i, kStart);
    ASSERT_TRUE(readings) << i;
    ASSERT_EQ(readings->size(), 3U);
    EXPECT_EQ((*readings)[0].tag, 0U);
    EXPECT_EQ((*readings)[0].value, real(23.4));
    EXPECT_EQ((*readings)[1].tag, 2U);
    EXPECT_FALSE((*readings)[1].bad);
  }
}

TEST_F(ReportByExceptionTest, PublishAndMaxSilentMayChangeBetweenTwoCycles) {
  EXPECT_TRUE(report.cycle(good(23.4), 1, kStart));
  GroupConfig group = report.group();
  group.on_change = true;
  group.max_silent = seconds(60);
  report.adjust(group);
  EXPECT_TRUE(report.cycle(good(23.4), 2, kStart)) << "the value to compare with";
  EXPECT_FALSE(report.cycle(good(23.4), 3, kStart));
  EXPECT_FALSE(report.cycle(good(23.4), 4, after(seconds(20))));
  group.max_silent = seconds(10);
  report.adjust(group);
  EXPECT_TRUE(report.cycle(good(23.4), 5, after(seconds(20))));
  EXPECT_FALSE(report.cycle(good(23.4), 6, after(seconds(21)))) << "the value is still known";
  group.on_change = false;
  report.adjust(group);
  EXPECT_TRUE(report.cycle(good(23.4), 7, after(seconds(21))));
  EXPECT_TRUE(report.cycle(good(23.4), 8, after(seconds(21))));
}

struct ReportByExceptionOnChange : ::testing::Test {
  const DeviceConfig device = press_on_change();
  ReportByException report{device, 0};
};

TEST_F(ReportByExceptionOnChange, OnChangeSaysTheFirstCycleAndThenOnlyChanges) {
  EXPECT_TRUE(report.cycle(good(23.4), 1, kStart));
  EXPECT_FALSE(report.cycle(good(23.4), 2, kStart));
  EXPECT_TRUE(report.cycle(good(23.5), 3, kStart));
  EXPECT_FALSE(report.cycle(good(23.5), 4, kStart));
  const auto changed = report.cycle(good(23.5, false), 5, kStart).value();
  EXPECT_EQ(changed.size(), 3U) << "the whole group is sent";
}

TEST_F(ReportByExceptionOnChange, OnChangeSpeaksAfterMaxSilent) {
  EXPECT_TRUE(report.cycle(good(23.4), 1, after(seconds(0))));
  EXPECT_FALSE(report.cycle(good(23.4), 2, after(seconds(59))));
  EXPECT_TRUE(report.cycle(good(23.4), 3, after(seconds(60))));
  EXPECT_FALSE(report.cycle(good(23.4), 4, after(seconds(119))));
}

TEST_F(ReportByExceptionOnChange, OnChangeSpeaksAtTheCycleBeforeMaxSilentWouldBeExceeded) {
  const auto cycle = [&](int at) {
    return report.cycle(good(23.4), at, after(seconds(at)), after(seconds(at + 25))).has_value();
  };
  EXPECT_TRUE(cycle(0));
  EXPECT_FALSE(cycle(25)) << "the next one is not too late";
  EXPECT_TRUE(cycle(50)) << "the next one would be 75 s after the last";
  EXPECT_FALSE(cycle(75));
  EXPECT_TRUE(cycle(100));
}

TEST_F(ReportByExceptionOnChange, OnChangeSpeaksACycleEarlyWhereALateOneWouldBeTooLate) {
  EXPECT_TRUE(report.cycle(good(23.4), 1, after(seconds(0)), after(seconds(20))));
  EXPECT_FALSE(report.cycle(good(23.4), 2, after(seconds(20)), after(seconds(40))));
  EXPECT_TRUE(report.cycle(good(23.4), 3, after(seconds(40)), after(seconds(60))));
}

TEST_F(ReportByExceptionOnChange, SilentDeviceSpeaksNoSoonerThanMaxSilent) {
  EXPECT_TRUE(report.cycle(all(BadReason::timeout), 1, after(seconds(0)), after(seconds(40))));
  EXPECT_FALSE(report.cycle(all(BadReason::timeout), 2, after(seconds(40)), after(seconds(80))));
  EXPECT_TRUE(report.cycle(all(BadReason::timeout), 3, after(seconds(80)), after(seconds(120))));
}

TEST_F(ReportByExceptionTest, TagThatACommandMayHaveWrittenHasNoLastValueUntilItIsRead) {
  report.cycle(good(23.4), 1000, kStart);
  report.overwritten(0);
  const auto bad = report.cycle(all(BadReason::timeout), 2000, kStart).value();
  EXPECT_TRUE(bad[0].value.items.empty());
  EXPECT_EQ(bad[0].last_ms, 0);
  EXPECT_EQ(bad[1].value, flag(true)) << "nobody wrote there";
}

TEST(ReportByException, DeadbandIsMeasuredFromTheValueLastSent) {
  const DeviceConfig device = press_on_change(0.5);
  ReportByException report(device, 0);
  EXPECT_TRUE(report.cycle(good(20.0), 1, kStart));
  EXPECT_FALSE(report.cycle(good(20.2), 2, kStart));
  EXPECT_FALSE(report.cycle(good(20.4), 3, kStart));
  EXPECT_TRUE(report.cycle(good(20.6), 4, kStart)) << "0.6 from 20.0, though 0.2 from the last";
  EXPECT_FALSE(report.cycle(good(20.2), 5, kStart));
  EXPECT_TRUE(report.cycle(good(20.1), 6, kStart)) << "down counts as up";
}

TEST(ReportByException, ChangeOfExactlyOneDeadbandIsSent) {
  // In binary, 0.3 - 0.2 is slightly less than 0.1.
  for (int raw = 1; raw < 2000; ++raw) {
    const DeviceConfig device = press_on_change(0.1);
    ReportByException report(device, 0);
    const auto value = [](int number) { return static_cast<double>(number) / 10.0; };
    ASSERT_TRUE(report.cycle(good(value(raw)), 1, kStart));
    EXPECT_TRUE(report.cycle(good(value(raw + 1)), 2, kStart)) << value(raw);
  }
}

TEST(ReportByException, ChangeOfABitIgnoresEveryDeadband) {
  DeviceConfig device = press_on_change();
  device.tags[2].units = std::make_shared<const TagUnits>(TagUnits{.limits = {.deadband = 5.0}});
  ReportByException report(device, 0);
  EXPECT_TRUE(report.cycle(good(1.0, false), 1, kStart));
  EXPECT_TRUE(report.cycle(good(1.0, true), 2, kStart));
}

TEST(ReportByException, ArrayIsComparedElementByElement) {
  const DeviceConfig device = press_on_change(10);
  ReportByException report(device, 0);
  EXPECT_TRUE(report.cycle(good(1.0, true, {100, 200, 300}), 1, kStart));
  EXPECT_FALSE(report.cycle(good(1.0, true, {109, 209, 309}), 2, kStart));
  EXPECT_TRUE(report.cycle(good(1.0, true, {100, 200, 310}), 3, kStart));
}

TEST_F(ReportByExceptionTest, BadTagCarriesSinceAndItsLastGoodValue) {
  report.cycle(good(23.4), 1000, kStart);
  report.cycle(brought({BadReason::nak, flag(true), numbers({1, 2, 3})}), 2000, kStart);
  const auto readings =
      report.cycle(brought({BadReason::bad_frame, flag(true), numbers({1, 2, 3})}), 3000, kStart);
  ASSERT_TRUE(readings);
  const TagReading& temp = (*readings)[0];
  EXPECT_EQ(temp.bad, BadReason::bad_frame);
  EXPECT_EQ(temp.bad_since_ms, 2000) << "when it turned bad, not when the reason changed";
  EXPECT_EQ(temp.value, real(23.4));
  EXPECT_EQ(temp.last_ms, 1000);
  EXPECT_FALSE((*readings)[1].bad);
  EXPECT_EQ(report.first_bad(), (ReportByException::BadTag{0, BadReason::bad_frame}));
}

TEST_F(ReportByExceptionTest, EachBadTagHasItsOwnSince) {
  report.cycle(brought({BadReason::nak, flag(true), numbers({1, 2, 3})}), 1000, kStart);
  report.cycle(brought({BadReason::nak, BadReason::nak, numbers({1, 2, 3})}), 2000, kStart);
  const auto both =
      report.cycle(brought({BadReason::nak, BadReason::nak, numbers({1, 2, 3})}), 3000, kStart);
  EXPECT_EQ((*both)[0].bad_since_ms, 1000);
  EXPECT_EQ((*both)[1].bad_since_ms, 2000);
  EXPECT_EQ((*both)[2].bad_since_ms, 0);
  const auto one =
      report.cycle(brought({real(23.4), BadReason::nak, numbers({1, 2, 3})}), 4000, kStart);
  EXPECT_EQ((*one)[0].bad_since_ms, 0);
  EXPECT_EQ((*one)[1].bad_since_ms, 2000) << "another one that is good again changes nothing";
}

TEST_F(ReportByExceptionTest, TagThatWasNeverReadHasNoLastValue) {
  const auto readings = report.cycle(all(BadReason::unsupported), 1000, kStart).value();
  EXPECT_TRUE(readings[0].value.items.empty());
  EXPECT_EQ(readings[0].last_ms, 0);
  EXPECT_EQ(readings[0].bad_since_ms, 1000);
}

TEST_F(ReportByExceptionTest, GoodAgainForgetsThatItWasBad) {
  report.cycle(all(BadReason::nak), 1000, kStart);
  const auto readings = report.cycle(good(23.4), 2000, kStart).value();
  EXPECT_FALSE(readings[0].bad);
  EXPECT_EQ(readings[0].bad_since_ms, 0);
  EXPECT_EQ(report.first_bad(), std::nullopt);
  const auto again = report.cycle(all(BadReason::nak), 3000, kStart);
  EXPECT_EQ((*again)[0].bad_since_ms, 3000);
}

TEST(ReportByException, OnChangeSaysWhenATagTurnsBadAndWhenItTurnsGood) {
  const DeviceConfig device = press_on_change(0.5);
  ReportByException report(device, 0);
  EXPECT_TRUE(report.cycle(good(20.0), 1, kStart));
  EXPECT_TRUE(report.cycle(brought({BadReason::nak, flag(true), numbers({1, 2, 3})}), 2, kStart));
  EXPECT_FALSE(report.cycle(brought({BadReason::nak, flag(true), numbers({1, 2, 3})}), 3, kStart));
  EXPECT_TRUE(report.cycle(good(20.0), 4, kStart)) << "good again, though with the old value";
  EXPECT_FALSE(report.cycle(good(20.0), 5, kStart));
}

TEST(ReportByException, SilentDeviceIsToldOnceAndThenEveryMaxSilent) {
  DeviceConfig device = press();
  device.groups[0].max_silent = seconds(60);
  ReportByException report(device, 0);
  EXPECT_TRUE(report.cycle(good(23.4), 1, after(seconds(0))));
  EXPECT_TRUE(report.cycle(all(BadReason::timeout), 2, after(seconds(1))));
  EXPECT_FALSE(report.cycle(all(BadReason::timeout), 3, after(seconds(2))));
  EXPECT_FALSE(report.cycle(all(BadReason::timeout), 4, after(seconds(60))));
  EXPECT_TRUE(report.cycle(all(BadReason::timeout), 5, after(seconds(61))));
  EXPECT_FALSE(report.cycle(all(BadReason::timeout), 6, after(seconds(62))));
  EXPECT_TRUE(report.cycle(good(23.4), 7, after(seconds(63))));
}

TEST(ReportByException, SilentDeviceIsToldPerAttemptWhereAttemptsAreRarer) {
  DeviceConfig device = press();
  device.groups[0].max_silent = seconds(10);
  ReportByException report(device, 0);
  for (int i = 0; i < 5; ++i)
    EXPECT_TRUE(report.cycle(all(BadReason::timeout), i, after(seconds(30 * i)))) << i;
}

TEST_F(ReportByExceptionTest, DeadLinkCountsAsSilence) {
  EXPECT_TRUE(report.cycle(all(BadReason::link_down), 1, kStart));
  EXPECT_FALSE(report.cycle(all(BadReason::link_down), 2, kStart));
}

TEST_F(ReportByExceptionTest, DeviceThatRefusesIsNotSilent) {
  EXPECT_TRUE(report.cycle(all(BadReason::nak), 1, kStart));
  EXPECT_TRUE(report.cycle(all(BadReason::nak), 2, kStart)) << "publish: always, and it answers";
}

TEST_F(ReportByExceptionTest, OneGoodTagMakesACycleWorthTelling) {
  const auto mixed = brought({real(1.0), BadReason::timeout, BadReason::timeout});
  EXPECT_TRUE(report.cycle(mixed, 1, kStart));
  EXPECT_TRUE(report.cycle(mixed, 2, kStart));
}

TEST(ReportByException, WrittenValueIsGoodAtOnceAndWhatOnChangeComparesWith) {
  const DeviceConfig device = press_on_change(0.5);
  ReportByException report(device, 0);
  report.cycle(brought({BadReason::nak, flag(true), numbers({1, 2, 3})}), 1000, kStart);
  const TagReading reading = report.written(0, real(50.0), 2000);
  EXPECT_EQ(reading.tag, 0U);
  EXPECT_EQ(reading.value, real(50.0));
  EXPECT_FALSE(reading.bad);
  EXPECT_EQ(report.first_bad(), std::nullopt);
  EXPECT_FALSE(report.cycle(good(50.0), 3000, kStart));
  EXPECT_TRUE(report.cycle(good(50.5), 4000, kStart));
}

TEST_F(ReportByExceptionOnChange, WriteBeforeTheFirstCycleDoesNotReplaceIt) {
  report.written(0, real(50.0), 1000);
  EXPECT_TRUE(report.cycle(good(50.0), 2000, kStart));
}

}  // namespace
}  // namespace fxagent::test
