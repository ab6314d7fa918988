#include "protocol/plc.h"

#include <gtest/gtest.h>

#include "protocol/catalog.h"

namespace fxagent {
namespace {

using Clock = SpecialDevices::Clock;
using Words = std::vector<std::uint32_t>;

TEST(ClockText, AWordForEachPart) {
  EXPECT_EQ(clock_text(Clock::words, Words{15, 48, 1, 27, 11, 2026}), "2026-11-27 01:48:15");
  EXPECT_EQ(clock_text(Clock::words, Words{15, 48, 1, 27, 11, 26}), "2026-11-27 01:48:15");
}

// QCPU User's Manual SH-080483, SD210 to SD212: July 1993, the 31st at 10 o'clock, 35 min 48 s.
TEST(ClockText, Bcd) {
  EXPECT_EQ(clock_text(Clock::bcd, Words{0x9307, 0x3110, 0x3548}), "2093-07-31 10:35:48");
}

TEST(ClockText, NothingThatIsNoDate) {
  EXPECT_EQ(clock_text(Clock::none, Words{15, 48, 1, 27, 11, 26}), std::nullopt);
  EXPECT_EQ(clock_text(Clock::words, Words{15, 48, 1, 27, 11}), std::nullopt);
  EXPECT_EQ(clock_text(Clock::words, Words{0, 0, 0, 0, 0, 0}), std::nullopt);
  EXPECT_EQ(clock_text(Clock::words, Words{60, 0, 0, 1, 1, 26}), std::nullopt);
  EXPECT_EQ(clock_text(Clock::words, Words{0, 0, 0, 1, 1, 65535}), std::nullopt);
  EXPECT_EQ(clock_text(Clock::bcd, Words{0x260A, 0x3110, 0x3548}), std::nullopt);
  EXPECT_EQ(clock_text(Clock::bcd, Words{}), std::nullopt);
}

TEST(SpecialDevices, EveryModelHasThoseThatItNames) {
  int named = 0;
  for (const ProtocolInfo& protocol : catalog()) {
    for (const std::string_view model : protocol.models) {
      const auto any = protocol.make(default_options(protocol));
      ASSERT_TRUE(any);
      const auto codec = (*any)->plc()->with_model(model);
      ASSERT_NE(codec, nullptr);
      const SpecialDevices special = codec->plc()->special_devices();
      const auto is_read = [&](std::string_view name) {
        if (name.empty()) return true;
        ++named;
        return codec->addresses().parse_address(name, std::nullopt).has_value();
      };
      EXPECT_TRUE(is_read(special.battery_low)) << protocol.name << ' ' << model;
      EXPECT_TRUE(is_read(special.error)) << protocol.name << ' ' << model;
      EXPECT_TRUE(is_read(special.clock_copied)) << protocol.name << ' ' << model;
      for (const std::string_view part : special.clock_at)
        EXPECT_TRUE(is_read(part)) << protocol.name << ' ' << model << ' ' << part;
    }
  }
  EXPECT_GT(named, 100);
}

}  // namespace
}  // namespace fxagent
