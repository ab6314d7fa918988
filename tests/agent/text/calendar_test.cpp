#include "agent/text/text.h"

#include <gtest/gtest.h>

namespace fxagent {
namespace {

// Numbers from date(1).
TEST(Calendar, ATimeIsWrittenInUtcWithMilliseconds) {
  EXPECT_EQ(utc_text(0), "1970-01-01T00:00:00.000Z");
  EXPECT_EQ(utc_text(-1), "1969-12-31T23:59:59.999Z");
  EXPECT_EQ(utc_text(951782400007), "2000-02-29T00:00:00.007Z");
  EXPECT_EQ(utc_text(1790000000123), "2026-09-21T14:13:20.123Z");
}

TEST(Calendar, ATimeThatNoCalendarHasIsItsNumber) {
  EXPECT_EQ(utc_text(std::numeric_limits<std::int64_t>::max()), "9223372036854775807 ms");
  EXPECT_EQ(utc_text(std::numeric_limits<std::int64_t>::min()), "-9223372036854775808 ms");
}

TEST(Calendar, ADayAMinuteAndASecondAreRead) {
  EXPECT_EQ(utc_ms_from("2026-09-21"), 1789948800000);
  EXPECT_EQ(utc_ms_from("2026-09-21T13:33"), 1789997580000);
  EXPECT_EQ(utc_ms_from("2026-09-21T13:33:20Z"), 1789997600000);
  EXPECT_EQ(utc_ms_from("2024-02-29Z"), 1709164800000);
  for (const char* wrong : {"", "Z", "2026-02-29", "2026-13-01", "2026-09-21T", "2026-09-21T13",
                            "2026-09-21T24:00", "2026-09-21T23:60", "2026-09-21 ", " 2026-09-21",
                            "2026-09-21T13:33:20.5", "yesterday", "-026-09-21"})
    EXPECT_FALSE(utc_ms_from(wrong)) << wrong;
}

}  // namespace
}  // namespace fxagent
