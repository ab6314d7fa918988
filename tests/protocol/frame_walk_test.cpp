#include "protocol/device_walk.h"

#include <gtest/gtest.h>

#include "tests/protocol/answers.h"

namespace fxagent {
namespace {

using namespace test;
using Values = std::vector<std::string>;
using Shown = std::vector<std::pair<std::string, std::string>>;

/// A protocol whose devices are D0 to D9, M0 to M9 and CN0 to CN9, by the first digit.
class ToyWalk final : public DeviceWalk {
 public:
  using DeviceWalk::DeviceWalk;

 private:
  std::optional<FrameDevice> device_in(ByteView wire) override {
    const std::uint32_t code = number_in(form_, wire).value_or(0);
    const std::string number = std::to_string(code & 0xF);
    if (code >> 4 == 0xD) return FrameDevice{"D" + number};
    if (code >> 4 == 0xA) return FrameDevice{"M" + number, 1};
    if (code >> 4 == 0xC) return FrameDevice{"CN" + number, 32};
    if (code >> 4 == 0xB) return FrameDevice{"TS" + number, 1, true};
    return std::nullopt;
  }
};

constexpr Field kUnit = read_by<&ToyWalk::decimal>("unit", 2);
constexpr Field kCode = read_by<&ToyWalk::hex>("code", 4);
constexpr Field kRest = read_by<&ToyWalk::rest>("rest");
constexpr Field kBitDevice = read_by<&ToyWalk::bit_device>("device", 2);
constexpr Field kWordDevice = read_by<&ToyWalk::word_device>("device", 2);
constexpr Field kPoints = read_by<&ToyWalk::points>("points", 2);
constexpr Field kPointsTo256 = read_by<&ToyWalk::points_to_256>("points", 2);
constexpr Field kBits = read_by<&ToyWalk::bits>("data");
constexpr Field kWords = read_by<&ToyWalk::words>("data");
constexpr Field kBitItems = read_by<&ToyWalk::bit_items>("", 2);
constexpr Field kText = read_by<&ToyWalk::text>("text");

Explanation walked(const Fields& fields, NumberForm form, const Bytes& frame) {
  Explanation out = begin_explanation(std::nullopt);
  ToyWalk(out, form, frame).walk(fields);
  return out;
}

std::string error(const Fields& fields, NumberForm form, const Bytes& frame) {
  const Explanation out = walked(fields, form, frame);
  EXPECT_EQ(out.ok, !out.error.has_value());
  return out.error.value_or("good");
}

TEST(FrameWalk, NumbersAreReadInEachForm) {
  const Fields fields = {kUnit, kCode, kRest};
  const Shown shown = {{"unit", "18"}, {"code", "ABCD"}};
  EXPECT_EQ(walked(fields, NumberForm::digits, ascii("12abCD")).fields, shown);
  EXPECT_EQ(walked(fields, NumberForm::high_first, hex("12 AB CD")).fields, shown);
  EXPECT_EQ(walked(fields, NumberForm::low_first, hex("12 CD AB")).fields, shown);
  EXPECT_EQ(walked({kRest}, NumberForm::digits, ascii("a b")).fields, (Shown{{"rest", "a b"}}));
  EXPECT_EQ(walked({kRest}, NumberForm::low_first, hex("41 42")).fields,
            (Shown{{"rest", "41 42"}}));
}

TEST(FrameWalk, AfterTheFirstFaultNothingMoreIsShown) {
  const Explanation out = walked({kUnit, kCode, kUnit}, NumberForm::digits, ascii("12X30055"));
  EXPECT_FALSE(out.ok);
  EXPECT_EQ(out.error, "the code is not hex digits: 58 33 30 30");
  EXPECT_EQ(out.fields, (Shown{{"unit", "18"}}));
  EXPECT_EQ(error({kUnit, kCode}, NumberForm::low_first, hex("12 AB")), "the request is truncated");
}

TEST(FrameWalk, WordsOfABitDeviceAreItsBits) {
  const Fields fields = {kWordDevice, kPoints, kWords};
  const Explanation bits = walked(fields, NumberForm::low_first, hex("A3 01 01 80"));
  EXPECT_EQ(bits.device, "M3");
  EXPECT_EQ(bits.count, 16U);
  ASSERT_EQ(bits.values.size(), 16U);
  EXPECT_EQ(bits.values.front(), "1");
  EXPECT_EQ(bits.values[1], "0");
  EXPECT_EQ(bits.values.back(), "1");
  EXPECT_EQ(walked(fields, NumberForm::high_first, hex("D3 01 12 34")).values, Values{"1234"});
  EXPECT_EQ(error(fields, NumberForm::digits, ascii("B3010000")),
            "contacts of timers and counters can only be accessed bit by bit");
}

// In text one point has 8 digits. In bytes it has two, the low word first.
TEST(FrameWalk, ADeviceOf32BitsIsOnePointInTextAndTwoInBytes) {
  const Fields fields = {kWordDevice, kPoints, kWords};
  for (const Explanation& out :
       {walked(fields, NumberForm::digits, ascii("C00112345678")),
        walked(fields, NumberForm::low_first, hex("C0 02 78 56 34 12")),
        walked(fields, NumberForm::high_first, hex("C0 02 56 78 12 34"))}) {
    EXPECT_EQ(out.values, Values{"12345678"});
    EXPECT_EQ(out.count, 1U);
  }
}

TEST(FrameWalk, ABitIsOneDigit) {
  const Fields fields = {kBitDevice, kPoints, kBits};
  EXPECT_EQ(walked(fields, NumberForm::digits, ascii("A003101")).values, (Values{"1", "0", "1"}));
  EXPECT_EQ(walked(fields, NumberForm::low_first, hex("A0 03 10 10")).values,
            (Values{"1", "0", "1"}));
  EXPECT_EQ(error(fields, NumberForm::low_first, hex("A0 02 12")), "the data are not bits");
  EXPECT_EQ(error(fields, NumberForm::digits, ascii("A00210")), "good");
  EXPECT_EQ(error(fields, NumberForm::digits, ascii("A0021")),
            "1 data characters given, 2 expected");
  EXPECT_EQ(error(fields, NumberForm::low_first, hex("A0 03 10")),
            "1 bytes of data given, 2 expected");
  EXPECT_EQ(error(fields, NumberForm::low_first, hex("D0 01 10")), "D0 is a word, not a bit");
}

TEST(FrameWalk, NoPointsAreAFaultOr256) {
  EXPECT_EQ(walked({kBitDevice, kPointsTo256}, NumberForm::low_first, hex("A0 00")).count, 256U);
  EXPECT_EQ(error({kBitDevice, kPoints}, NumberForm::low_first, hex("A0 00")),
            "the number of points is 0");
  EXPECT_EQ(error({kBitDevice, kPointsTo256}, NumberForm::digits, ascii("A00X")),
            "the number of points is not two hex digits from 01 up");
}

TEST(FrameWalk, EveryItemIsShownByItsDevice) {
  const Explanation out =
      walked({kPoints, kBitItems}, NumberForm::low_first, hex("02 A1 01 A7 00"));
  EXPECT_TRUE(out.ok);
  EXPECT_EQ(out.device, "M1,M7");
  EXPECT_EQ(out.count, 2U);
  EXPECT_EQ(out.fields, (Shown{{"points", "2"}, {"M1", "1"}, {"M7", "0"}}));
  EXPECT_EQ(error({kPoints, kBitItems}, NumberForm::low_first, hex("02 A1 01 A7")),
            "only 1 of 2 points are present");
  EXPECT_EQ(error({kPoints, kBitItems}, NumberForm::digits, ascii("01D11")),
            "'D1' is not a device for this command");
  EXPECT_EQ(error({kPoints, kBitItems}, NumberForm::digits, ascii("01A12")),
            "'2' is not a value of M1");
}

TEST(FrameWalk, ATextFollowsItsLength) {
  EXPECT_EQ(walked({kText}, NumberForm::digits, ascii("03ABC")).fields, (Shown{{"text", "ABC"}}));
  EXPECT_EQ(walked({kText}, NumberForm::low_first, hex("02 41 42")).fields,
            (Shown{{"text", "41 42"}}));
  EXPECT_EQ(error({kText}, NumberForm::digits, ascii("04ABC")),
            "the text is shorter than its length says");
}

TEST(FrameWalk, ASumMayHaveLowerCaseDigits) {
  Explanation out = begin_explanation(Direction::reply);
  EXPECT_TRUE(judge_sum(out, "a7", 0xA7).ok);
  EXPECT_EQ(out.checksum_given, "a7");
  EXPECT_EQ(out.checksum_computed, "A7");
  EXPECT_EQ(judge_sum(out, "A8", 0xA7).error, "sum A8 given, A7 computed");
}

}  // namespace
}  // namespace fxagent
