// Detects that another word order is likelier.
#include "protocol/value/word_order.h"

#include <gtest/gtest.h>

#include "tests/support/transcripts.h"

namespace fxagent {
namespace {

using test::hex;

Point float_point(DataType type, ByteOrder order, std::uint16_t count = 1) {
  return {.address = {"hr:0", {1, 0, 16}, Unit::word, true},
          .type = type,
          .order = order,
          .count = count,
          .is_array = count > 1};
}

/// `image` has the words in their order, each low byte first.
std::optional<ByteOrder> likelier(DataType type, ByteOrder order, const char* image,
                                  std::uint16_t count = 1) {
  const Bytes bytes = hex(image);
  return likelier_order(float_point(type, order, count), kByteOrders, read_from(bytes, 0));
}

TEST(WordOrder, AnAbsurdFloatNamesTheOrderThatIsPlain) {
  // 230.5 is 43 66 80 00 (IEEE 754). High word first:
  EXPECT_EQ(likelier(DataType::float32, ByteOrder::cdab, "66 43 00 80"), ByteOrder::abcd);
  // Low word first, but read high word first: 8000 4366 is a denormal.
  EXPECT_EQ(likelier(DataType::float32, ByteOrder::abcd, "00 80 66 43"), ByteOrder::cdab);
  EXPECT_EQ(likelier(DataType::float32, ByteOrder::abcd, "43 66 80 00"), ByteOrder::badc);
  EXPECT_EQ(likelier(DataType::float32, ByteOrder::abcd, "80 00 43 66"), ByteOrder::dcba);
  // 230.5 as a double is 40 6C D0 00 00 00 00 00.
  EXPECT_EQ(likelier(DataType::float64, ByteOrder::cdab, "6C 40 00 D0 00 00 00 00"),
            ByteOrder::abcd);
  // 50.124756 is 42 48 7F C0; 7F C0 42 48 is NaN.
  EXPECT_EQ(likelier(DataType::float32, ByteOrder::cdab, "48 42 C0 7F"), ByteOrder::abcd);
}

TEST(WordOrder, APlainValueAndOneThatNoOrderMakesPlainHaveNoHint) {
  EXPECT_EQ(likelier(DataType::float32, ByteOrder::abcd, "66 43 00 80"), std::nullopt);
  EXPECT_EQ(likelier(DataType::float32, ByteOrder::abcd, "00 00 00 00"), std::nullopt);
  EXPECT_EQ(likelier(DataType::float32, ByteOrder::abcd, "FF FF FF FF"), std::nullopt);
  // 1e-9 A (30 89 70 5F) is small but plausible.
  EXPECT_EQ(likelier(DataType::float32, ByteOrder::abcd, "89 30 5F 70"), std::nullopt);
  EXPECT_EQ(likelier(DataType::int32, ByteOrder::cdab, "66 43 00 80"), std::nullopt);
}

TEST(WordOrder, EveryElementOfAnArrayMustBePlain) {
  EXPECT_EQ(likelier(DataType::float32, ByteOrder::cdab, "66 43 00 80 00 00 00 00", 2),
            ByteOrder::abcd);
  EXPECT_EQ(likelier(DataType::float32, ByteOrder::cdab, "66 43 00 80 FF 7F FF FF", 2),
            std::nullopt);
}

TEST(WordOrder, AScaleDoesNotMakeAValueAbsurd) {
  Point point = float_point(DataType::float32, ByteOrder::abcd);
  ASSERT_TRUE(set_units(point, 1e20, 0));
  const Bytes bytes = hex("66 43 00 80");
  EXPECT_EQ(likelier_order(point, kByteOrders, read_from(bytes, 0)), std::nullopt);
}

TEST(WordOrder, TheHintNamesOrderAndValue) {
  const Point point = float_point(DataType::float32, ByteOrder::abcd);
  const Bytes swapped = hex("00 80 66 43");
  EXPECT_EQ(word_order_hint(point, kByteOrders, read_from(swapped, 0)),
            "in word order CDAB it is 230.5: compare word_order with the device");
  const Bytes bytes_too = hex("80 00 43 66");
  EXPECT_NE(word_order_hint(point, kByteOrders, read_from(bytes_too, 0)), "");
  EXPECT_EQ(word_order_hint(point, std::span(kByteOrders).first(2), read_from(bytes_too, 0)), "")
      << "a word order that the device cannot have helps nobody";
  EXPECT_TRUE(is_absurd(std::numeric_limits<double>::denorm_min()));
  EXPECT_FALSE(is_absurd(0));
}

}  // namespace
}  // namespace fxagent
