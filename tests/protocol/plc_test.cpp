#include "protocol/plc.h"

#include <gtest/gtest.h>

#include "protocol/catalog.h"

namespace fxagent {
namespace {

using Clock = SpecialDevices::Clock;

/// Returns the image of words, low byte first.
Bytes words(std::initializer_list<std::uint32_t> values) {
  Bytes image;
  for (const std::uint32_t value : values) {
    image.push_back(static_cast<std::uint8_t>(value));
    image.push_back(static_cast<std::uint8_t>(value >> 8U));
  }
  return image;
}

TEST(ClockText, AWordForEachPart) {
  EXPECT_EQ(clock_text(Clock::from_second, words({15, 48, 1, 27, 11, 2026})),
            "2026-11-27 01:48:15");
  EXPECT_EQ(clock_text(Clock::from_year, words({2026, 11, 27, 1, 48, 15})), "2026-11-27 01:48:15");
}

TEST(ClockText, TwoDigitsOfAYear) {
  EXPECT_EQ(clock_text(Clock::from_second, words({0, 0, 0, 1, 1, 79})), "2079-01-01 00:00:00");
  EXPECT_EQ(clock_text(Clock::from_second, words({0, 0, 0, 1, 1, 80})), "1980-01-01 00:00:00");
}

// The example of the special registers of a Q: July 1993, the 31st at 10 o'clock, 35 min 48 s.
TEST(ClockText, Bcd) {
  EXPECT_EQ(clock_text(Clock::bcd, words({0x9307, 0x3110, 0x3548})), "1993-07-31 10:35:48");
}

TEST(ClockText, NothingThatIsNoDate) {
  EXPECT_EQ(clock_text(Clock::none, words({15, 48, 1, 27, 11, 26})), std::nullopt);
  EXPECT_EQ(clock_text(Clock::from_second, words({15, 48, 1, 27, 11})), std::nullopt);
  EXPECT_EQ(clock_text(Clock::from_second, words({0, 0, 0, 0, 0, 0})), std::nullopt);
  EXPECT_EQ(clock_text(Clock::from_second, words({60, 0, 0, 1, 1, 26})), std::nullopt);
  EXPECT_EQ(clock_text(Clock::from_year, words({500, 1, 1, 0, 0, 0})), std::nullopt);
  EXPECT_EQ(clock_text(Clock::bcd, words({0x260A, 0x3110, 0x3548})), std::nullopt);
  EXPECT_EQ(clock_text(Clock::bcd, {}), std::nullopt);
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
      EXPECT_TRUE(is_read(special.has_error)) << protocol.name << ' ' << model;
      EXPECT_TRUE(is_read(special.clock_copied)) << protocol.name << ' ' << model;
      EXPECT_TRUE(is_read(special.clock_at)) << protocol.name << ' ' << model;
    }
  }
  EXPECT_GT(named, 60);
}

}  // namespace
}  // namespace fxagent
