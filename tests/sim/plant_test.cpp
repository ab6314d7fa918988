#include "tests/sim/plant.h"

#include <gtest/gtest.h>

#include "tests/sim/sample_plc.h"

namespace fxsim {
namespace {

using std::chrono::seconds;

constexpr Device kRunning{Kind::m, 0};
constexpr Device kParts{Kind::c_value32, 0};

TEST(DemoPlant, StartAndStopAreMomentary) {
  auto plc = make_plc("FX3U", "demo");
  plc.force({Kind::m, 101}, true);
  EXPECT_EQ(plc.memory().get({Kind::m, 101}), 1U);
  plc.advance(TimePoint(kScanTime));
  EXPECT_EQ(plc.memory().get({Kind::m, 101}), 0U);
  EXPECT_EQ(plc.memory().get(kRunning), 0U);
  plc.force({Kind::m, 100}, true);
  plc.advance(TimePoint(2 * kScanTime));
  EXPECT_EQ(plc.memory().get({Kind::m, 100}), 0U);
  EXPECT_EQ(plc.memory().get(kRunning), 1U);
}

TEST(DemoPlant, ForcedOutputOfTheLadderFallsBackAtTheNextScan) {
  auto plc = make_plc("FX3U", "demo");
  plc.advance(TimePoint(kScanTime));
  plc.force({Kind::y, 0}, false);
  plc.force({Kind::y, 7}, true);
  plc.force({Kind::x, 7}, true);
  EXPECT_EQ(plc.memory().get({Kind::y, 0}), 0U);
  plc.advance(TimePoint(2 * kScanTime));
  EXPECT_EQ(plc.memory().get({Kind::y, 0}), 1U);  // driven by M0
  EXPECT_EQ(plc.memory().get({Kind::y, 7}), 1U);  // not driven by the ladder
  EXPECT_EQ(plc.memory().get({Kind::x, 7}), 0U);
}

TEST(DemoPlant, TemperatureFollowsTheSetpointAndRaisesTheAlarm) {
  auto plc = make_plc("FX3U", "demo");
  plc.preset({Kind::d, 200}, 900);
  plc.advance(TimePoint(seconds(1)));
  EXPECT_EQ(plc.memory().get({Kind::m, 50}), 0U);
  plc.advance(TimePoint(seconds(60)));
  EXPECT_NEAR(plc.memory().get({Kind::d, 100}), 900, 5);
  EXPECT_EQ(plc.memory().get({Kind::m, 50}), 1U);
}

TEST(DemoPlant, PartsAreCountedOnEveryModel) {
  for (const auto* model : {"FX0N", "FX1S", "FX1N", "FX2N", "FX3S", "FX3G", "FX3U"}) {
    SCOPED_TRACE(model);
    auto plc = make_plc(model, "demo");
    const Device parts = plc.memory().has(kParts) ? kParts : Device{Kind::c_value32, 35};
    plc.advance(TimePoint(seconds(60)));  // 250 mm/s, one part every 500 mm
    EXPECT_NEAR(plc.memory().get(parts), 30, 1);
    EXPECT_EQ(plc.memory().get({Kind::c_value, 0}), plc.memory().get(parts) - 20);
    EXPECT_EQ(plc.memory().get({Kind::d, 120}), 2U);
    EXPECT_EQ(plc.memory().get({Kind::t_contact, 0}), 1U);
    EXPECT_EQ(plc.memory().get({Kind::t_value, 0}), 50U);
  }
}

TEST(DemoPlant, NothingMovesInStop) {
  auto plc = make_plc("FX3U", "demo");
  plc.advance(TimePoint(seconds(10)));
  plc.force({Kind::special_m, 37}, true);
  const auto parts = plc.memory().get(kParts);
  plc.advance(TimePoint(seconds(70)));
  EXPECT_EQ(plc.memory().get(kParts), parts);
  plc.force({Kind::special_m, 37}, false);
  plc.advance(TimePoint(seconds(80)));
  EXPECT_NEAR(plc.memory().get(kParts), parts + 5, 1);  // time in STOP is not caught up
}

TEST(DemoPlant, IsTheSameHoweverOftenItIsAsked) {
  auto once = make_plc("FX3U", "demo");
  auto often = make_plc("FX3U", "demo");
  once.advance(TimePoint(seconds(30)));
  for (int i = 1; i <= 3000; ++i) often.advance(TimePoint(std::chrono::milliseconds(10 * i)));
  for (const auto kind : {Kind::d, Kind::m, Kind::c_value32, Kind::x, Kind::y})
    for (unsigned n = 0; n < 56; ++n)
      EXPECT_EQ(once.memory().get({kind, n}), often.memory().get({kind, n}));
}

TEST(DemoPlant, RunsOnAnFx5WithItsPartsInALongCounter) {
  auto plc = make_plc("FX5U", "demo");
  plc.advance(TimePoint(seconds(30)));
  EXPECT_GT(plc.memory().get({Kind::lc_value, 0}), 0U);
  EXPECT_EQ(plc.memory().get({Kind::y, 0}), 1U);
}

TEST(CounterPlant, EveryRegisterRisesByOneAScan) {
  auto plc = make_plc("FX2N", "counter");
  EXPECT_EQ(plc.memory().get({Kind::d, 7999}), 7999U);
  plc.advance(TimePoint(seconds(1)));
  EXPECT_EQ(plc.memory().get({Kind::d, 0}), 50U);
  EXPECT_EQ(plc.memory().get({Kind::d, 7999}), 8049U);
}

TEST(StillPlant, KeepsWhatIsPutIn) {
  auto plc = make_plc("FX1N", "none");
  plc.force({Kind::x, 0}, true);
  plc.preset({Kind::d, 100}, 234);
  plc.advance(TimePoint(seconds(100)));
  EXPECT_EQ(plc.memory().get({Kind::x, 0}), 1U);
  EXPECT_EQ(plc.memory().get({Kind::d, 100}), 234U);
}

}  // namespace
}  // namespace fxsim
