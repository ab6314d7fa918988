#include "protocol/value/bytes.h"

#include <gtest/gtest.h>

#include "tests/support/says.h"

namespace fxagent {
namespace {

TEST(Bytes, AreSpelledInUpperCaseWithBlanks) {
  EXPECT_EQ(to_hex(Bytes{0x02, 0xAF, 0x30}), "02 AF 30");
  EXPECT_EQ(to_hex(Bytes{}), "");
}

TEST(Bytes, AreReadInEverySpellingPeopleUse) {
  const Bytes expected{0x02, 0x30, 0xAF};
  for (const char* text : {"02 30 AF", "0230af", "0x02,0x30,0XAF", "02:30:AF", "\t02\r\n30 AF\n"}) {
    const auto bytes = from_hex(text);
    ASSERT_TRUE(bytes) << text;
    EXPECT_EQ(*bytes, expected) << text;
  }
  EXPECT_TRUE(from_hex("")->empty());
}

TEST(Bytes, ALetterThatIsNotHexIsNamedWithItsPlace) {
  const Error error = test::error_of(from_hex("02 3G"));
  EXPECT_EQ(error.code, ErrorCode::bad_request);
  EXPECT_EQ(error.text, "'G' at position 5 is not a hex digit");
}

TEST(Bytes, ASingleDigitIsLeftOver) {
  for (const char* text : {"02 3", "3 02", "0x2"})
    test::expect_says(test::error_of(from_hex(text)).text, "left over");
}

TEST(Bytes, HexDigitsHaveValuesInBothCases) {
  EXPECT_EQ(hex_digit('0'), 0);
  EXPECT_EQ(hex_digit('9'), 9);
  EXPECT_EQ(hex_digit('A'), 10);
  EXPECT_EQ(hex_digit('f'), 15);
  for (const char c : {'/', ':', '@', 'G', '`', 'g'})
    EXPECT_EQ(hex_digit(static_cast<std::uint8_t>(c)), -1) << c;
}

TEST(Bytes, NumbersAreAppendedMostSignificantDigitFirst) {
  Bytes out;
  append_hex(out, 0x10F6, 4);
  append_hex(out, 4, 2);
  EXPECT_EQ(std::string(out.begin(), out.end()), "10F604");
}

}  // namespace
}  // namespace fxagent
