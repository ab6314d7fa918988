#include "protocol/value/point.h"

#include <gtest/gtest.h>

#include <cmath>

#include "protocol/value/pack.h"
#include "protocol/value/value.h"
#include "tests/support/says.h"
#include "tests/support/transcripts.h"

namespace fxagent {
namespace {

using test::hex;

Point word_point(DataType type, std::uint16_t count = 1) {
  return {.address = {"D0", {1, 0, 16}, Unit::word, true},
          .type = type,
          .count = count,
          .is_array = count > 1};
}

Point group_point(std::uint32_t digits, DataType type) {
  return {
      .address = {"K" + std::to_string(digits) + "M0", {2, 0, digits * 4}, Unit::bit_group, true},
      .type = type};
}

Point scaled_point(DataType type, double scale, double offset) {
  Point point = word_point(type);
  EXPECT_TRUE(set_units(point, scale, offset));
  return point;
}

Value whole(std::int64_t number) { return Value(Scalar(number)); }
Value real(double number) { return Value(Scalar(number)); }
Value text(const char* characters) { return Value(Scalar(std::string(characters))); }
Value large(const char* digits) { return Value(Scalar(BigInteger{digits})); }
Value flag(bool on) { return Value(Scalar(on)); }

Value read(const Point& point, const char* image) {
  const auto value = unpack(point, hex(image), 0);
  EXPECT_TRUE(value.has_value()) << image << (value ? "" : value.error().text);
  return value.value_or(Value{});
}

std::string written(const Point& point, const Value& value) {
  const auto image = pack(point, value);
  EXPECT_TRUE(image.has_value()) << (image ? "" : image.error().text);
  return image ? to_hex(*image) : "";
}

PackFault fault(const Point& point, const Value& value) {
  const PackError error = test::error_of(pack(point, value));
  EXPECT_FALSE(error.text.empty());
  return error.fault;
}

// ---- words of the config ----------------------------------------------------------------------

TEST(DataType, EveryWordIsReadBack) {
  for (const char* word : {"bool", "int16", "uint16", "int32", "uint32", "int64", "uint64",
                           "float32", "float64", "bcd16", "bcd32", "string"})
    EXPECT_EQ(to_string(*data_type_from(word)), word);
  test::expect_says(test::error_of(data_type_from("int")).text, "uint32");
}

TEST(ByteOrder, HasFourSpellingsAndTwoNames) {
  for (const char* word : {"ABCD", "CDAB", "BADC", "DCBA"})
    EXPECT_EQ(to_string(*byte_order_from(word)), word);
  EXPECT_EQ(*byte_order_from("low_first"), ByteOrder::cdab);
  EXPECT_EQ(*byte_order_from("high_first"), ByteOrder::abcd);
  EXPECT_FALSE(byte_order_from("abcd"));
}

TEST(Point, HasADefaultTypeForEachUnit) {
  const auto of = [](Unit unit, std::uint32_t bits) {
    return default_type({"", {0, 0, bits}, unit, true});
  };
  EXPECT_EQ(of(Unit::bit, 1), DataType::boolean);
  EXPECT_EQ(of(Unit::word_bit, 1), DataType::boolean);
  EXPECT_EQ(of(Unit::word, 16), DataType::int16);
  EXPECT_EQ(of(Unit::dword, 32), DataType::int32);
  EXPECT_EQ(of(Unit::long_index, 32), DataType::int32);
  EXPECT_EQ(of(Unit::long_count, 32), DataType::uint32);
  EXPECT_EQ(of(Unit::bit_group, 16), DataType::int16);
  EXPECT_EQ(of(Unit::bit_group, 20), DataType::int32);
}

TEST(Point, TakesOnlyTheTypesOfItsUnit) {
  const DataType all[] = {DataType::boolean, DataType::int16,  DataType::uint16,
                          DataType::int32,   DataType::uint32, DataType::float32,
                          DataType::bcd16,   DataType::bcd32,  DataType::string,
                          DataType::int64,   DataType::uint64, DataType::float64};
  const auto fitting = [&](Unit unit, std::uint32_t bits) {
    std::string words;
    for (const DataType type : all) {
      const Point point{.address = {"A", {0, 0, bits}, unit, true}, .type = type, .length = 4};
      if (span_of(point)) words += std::string(to_string(type)) + " ";
    }
    return words;
  };
  EXPECT_EQ(fitting(Unit::bit, 1), "bool ");
  EXPECT_EQ(fitting(Unit::word_bit, 1), "bool ");
  EXPECT_EQ(fitting(Unit::word, 16),
            "int16 uint16 int32 uint32 float32 bcd16 bcd32 string int64 uint64 float64 ");
  EXPECT_EQ(fitting(Unit::dword, 32), "int32 ");
  EXPECT_EQ(fitting(Unit::long_index, 32), "int32 uint32 ");
  EXPECT_EQ(fitting(Unit::long_count, 32), "int32 uint32 ");
  EXPECT_EQ(fitting(Unit::bit_group, 8), "int16 uint16 bcd16 ");
  EXPECT_EQ(fitting(Unit::bit_group, 16), "int16 uint16 bcd16 ");
  EXPECT_EQ(fitting(Unit::bit_group, 20), "int32 ");
  EXPECT_EQ(fitting(Unit::bit_group, 32), "int32 ");
}

TEST(Point, ARefusedTypeNamesTheRightOne) {
  EXPECT_EQ(test::error_of(span_of(group_point(8, DataType::int16))).text,
            "K8M0 cannot be read as int16; its type must be int32");
}

TEST(Point, OccupiesAllItsElements) {
  EXPECT_EQ(span_of(word_point(DataType::int32, 3))->bits, 96U);
  Point point = word_point(DataType::string, 2);
  point.length = 5;
  EXPECT_EQ(span_of(point)->bits, 96U);
  point.length = 0;
  test::expect_says(span_of(point).error().text, "length");
  test::expect_says(span_of(word_point(DataType::int16, 0)).error().text, "at least 1");
  Point far = word_point(DataType::int32, 65535);
  far.address.span.first_bit = 0xFFFFFF00;
  test::expect_says(span_of(far).error().text, "too long");
}

// ---- reading ----------------------------------------------------------------------------------

TEST(Unpack, WordsAreLowByteFirstAndDoubleWordsLowWordFirst) {
  EXPECT_EQ(read(word_point(DataType::int16), "34 12"), whole(0x1234));
  EXPECT_EQ(read(word_point(DataType::int16), "FE FF"), whole(-2));
  EXPECT_EQ(read(word_point(DataType::uint16), "FE FF"), whole(65534));
  EXPECT_EQ(read(word_point(DataType::int32), "78 56 34 12"), whole(0x12345678));
  EXPECT_EQ(read(word_point(DataType::int32), "FE FF FF FF"), whole(-2));
  EXPECT_EQ(read(word_point(DataType::uint32), "FE FF FF FF"), whole(4294967294));
}

TEST(Unpack, TheFourOrdersPutTheirFirstLetterFirst) {
  // The value 12345678h as stored in two words of the device; the image has the low byte first.
  const std::pair<ByteOrder, const char*> cases[] = {{ByteOrder::abcd, "34 12 78 56"},
                                                     {ByteOrder::cdab, "78 56 34 12"},
                                                     {ByteOrder::badc, "12 34 56 78"},
                                                     {ByteOrder::dcba, "56 78 12 34"}};
  for (const auto& [order, image] : cases) {
    Point point = word_point(DataType::int32);
    point.order = order;
    EXPECT_EQ(read(point, image), whole(0x12345678)) << to_string(order);
    EXPECT_EQ(written(point, whole(0x12345678)), image) << to_string(order);
  }
}

TEST(Unpack, SwappedBytesAreSwappedInSixteenBitsToo) {
  Point point = word_point(DataType::uint16);
  point.order = ByteOrder::badc;
  EXPECT_EQ(read(point, "12 34"), whole(0x1234));
  EXPECT_EQ(written(point, whole(0x1234)), "12 34");
  point.order = ByteOrder::abcd;
  EXPECT_EQ(read(point, "34 12"), whole(0x1234));
}

TEST(Unpack, AFloatHasTheByteOrderOfItsPointInBothDirections) {
  // 23.4 is 41 BB 33 33, and 0.15625 is 3E 20 00 00.
  const std::pair<ByteOrder, std::pair<const char*, const char*>> orders[] = {
      {ByteOrder::abcd, {"BB 41 33 33", "20 3E 00 00"}},
      {ByteOrder::cdab, {"33 33 BB 41", "00 00 20 3E"}},
      {ByteOrder::badc, {"41 BB 33 33", "3E 20 00 00"}},
      {ByteOrder::dcba, {"33 33 41 BB", "00 00 3E 20"}},
  };
  for (const auto& [order, images] : orders) {
    Point point = word_point(DataType::float32);
    point.order = order;
    EXPECT_EQ(read(point, images.first), real(23.4)) << to_string(order);
    EXPECT_EQ(read(point, images.second), real(0.15625)) << to_string(order);
    EXPECT_EQ(written(point, real(23.4)), images.first) << to_string(order);
    EXPECT_EQ(written(point, real(0.15625)), images.second) << to_string(order);
  }
}

struct FourWords {
  ByteOrder order;
  const char* integer;  ///< 0x0123456789ABCDEF
  const char* pi;       ///< 0x400921FB54442D18, IEEE 754
};
// The four words of a value, each low byte first, written out by hand.
constexpr FourWords kFourWords[] = {
    {ByteOrder::abcd, "23 01 67 45 AB 89 EF CD", "09 40 FB 21 44 54 18 2D"},
    {ByteOrder::cdab, "EF CD AB 89 67 45 23 01", "18 2D 44 54 FB 21 09 40"},
    {ByteOrder::badc, "01 23 45 67 89 AB CD EF", "40 09 21 FB 54 44 2D 18"},
    {ByteOrder::dcba, "CD EF 89 AB 45 67 01 23", "2D 18 54 44 21 FB 40 09"},
};

TEST(Unpack, ValuesOfFourWordsHaveTheFourOrdersInBothDirections) {
  const auto spaced = [](const char* image) { return to_hex(hex(image)); };
  for (const FourWords& c : kFourWords) {
    for (const DataType type : {DataType::int64, DataType::uint64}) {
      Point point = word_point(type);
      point.order = c.order;
      EXPECT_EQ(read(point, c.integer), whole(81985529216486895)) << to_string(c.order);
      EXPECT_EQ(written(point, whole(81985529216486895)), spaced(c.integer));
    }
    Point point = word_point(DataType::float64);
    point.order = c.order;
    EXPECT_EQ(read(point, c.pi), real(3.141592653589793)) << to_string(c.order);
    EXPECT_EQ(written(point, real(3.141592653589793)), spaced(c.pi));
  }
}

TEST(Unpack, SixtyFourBitsHaveTheirWholeRange) {
  const Point with_sign = word_point(DataType::int64);
  const Point without = word_point(DataType::uint64);
  EXPECT_EQ(span_of(with_sign)->bits, 64U);
  EXPECT_EQ(read(with_sign, "FF FF FF FF FF FF FF FF"), whole(-1));
  EXPECT_EQ(read(with_sign, "00 00 00 00 00 00 00 80"),
            whole(std::numeric_limits<std::int64_t>::min()));
  EXPECT_EQ(read(without, "FF FF FF FF FF FF FF FF"), large("18446744073709551615"));
  EXPECT_EQ(read(without, "00 00 00 00 00 00 00 80"), large("9223372036854775808"));
  EXPECT_EQ(read(without, "FF FF FF FF FF FF FF 7F"), whole(9223372036854775807));
  const Value two =
      read(word_point(DataType::uint64, 2), "01 00 00 00 00 00 00 00 FF FF FF FF FF FF FF FF");
  EXPECT_EQ(two.items,
            (Scalars{Scalar(std::int64_t{1}), Scalar(BigInteger{"18446744073709551615"})}));
  EXPECT_FALSE(unpack(word_point(DataType::float64), hex("00 00 00 00 00 00 F8 7F"), 0)) << "NaN";
}

TEST(Unpack, AScaledIntegerBeyondTwoToThe53IsExact) {
  // 0x2BDC545D6B4B87 Wh
  EXPECT_EQ(read(scaled_point(DataType::uint64, 0.001, 0), "87 4B 6B 5D 54 DC 2B 00"),
            real(12345678901234.567));
  const char* const most = "FF FF FF FF FF FF FF FF";
  EXPECT_EQ(read(scaled_point(DataType::uint64, 10, 5), most), large("184467440737095516155"));
  EXPECT_EQ(read(scaled_point(DataType::uint64, 0.1, 0), most), whole(1844674407370955162));
  EXPECT_EQ(read(scaled_point(DataType::int32, 1e7, 1), "FF FF FF 7F"), whole(21474836470000001));
  EXPECT_EQ(read(scaled_point(DataType::int32, -1e10, 0), "FF FF FF 7F"),
            large("-21474836470000000000"));
  EXPECT_EQ(read(scaled_point(DataType::int16, 1e300, 0), "01 00").items.size(), 1U);
  // Up to this value the result is the decimal number, as before.
  EXPECT_EQ(read(scaled_point(DataType::int32, 1e6, 0), "FF FF FF 7F"), real(2147483647000000));
}

TEST(Unpack, AScaledIntegerIsTheDecimalNumberItLooksLike) {
  EXPECT_EQ(read(scaled_point(DataType::int16, 0.1, 0), "EA 00"), real(23.4));
  EXPECT_EQ(read(scaled_point(DataType::int16, 0.05, -273.15), "01 00"), real(-273.1));
  EXPECT_EQ(read(scaled_point(DataType::int16, 1e-7, 0), "03 00"), real(3e-7));
  EXPECT_EQ(read(scaled_point(DataType::int16, 100, 0), "03 00"), real(300));
  EXPECT_EQ(read(scaled_point(DataType::int16, 1, 0.5), "03 00"), real(3.5));
  EXPECT_EQ(read(scaled_point(DataType::uint32, 0.001, 0), "FF FF FF FF"), real(4294967.295));
  for (int raw = 0; raw < 65536; raw += 7) {
    const Bytes image{static_cast<std::uint8_t>(raw), static_cast<std::uint8_t>(raw >> 8)};
    const auto value = unpack(scaled_point(DataType::uint16, 0.1, 0), image, 0);
    ASSERT_EQ(std::get<double>(value->items[0]), raw / 10.0);
  }
}

TEST(Unpack, AScaleWithMoreDigitsThanADoubleIsNotRounded) {
  EXPECT_EQ(read(scaled_point(DataType::int16, 1.0 / 3.0, 0), "03 00"), real(1.0));
  EXPECT_EQ(read(scaled_point(DataType::int16, 1e-20, 0), "01 00"), real(1e-20));
}

TEST(Unpack, AFloatIsTheShortestDecimalThatMeansIt) {
  EXPECT_EQ(read(word_point(DataType::float32), "33 33 BB 41"), real(23.4));
  EXPECT_EQ(read(word_point(DataType::float32), "00 00 00 80"), real(-0.0));
  EXPECT_EQ(read(scaled_point(DataType::float32, 0.1, 0), "33 33 BB 41"), real(2.34));
}

TEST(Unpack, WhatIsNoNumberIsAnError) {
  const auto why = [](const Point& point, const char* image) {
    const Error error = test::error_of(unpack(point, hex(image), 0));
    EXPECT_EQ(error.code, ErrorCode::bad_request);
    return error.text;
  };
  EXPECT_EQ(why(word_point(DataType::float32), "00 00 C0 7F"), "7FC00000 is NaN");
  EXPECT_EQ(why(word_point(DataType::float32), "00 00 80 7F"), "7F800000 is infinite");
  EXPECT_EQ(why(word_point(DataType::float32), "00 00 80 FF"), "FF800000 is infinite");
  EXPECT_EQ(why(word_point(DataType::bcd16), "3A 12"), "123A is not BCD");
  EXPECT_EQ(why(word_point(DataType::bcd32), "78 56 34 F2"), "F2345678 is not BCD");
  EXPECT_EQ(why(group_point(2, DataType::bcd16), "A1"), "A1 is not BCD");
  EXPECT_EQ(why(scaled_point(DataType::int16, 1e308, 0), "FF 7F"), "scaled value is not finite");
  EXPECT_EQ(why(scaled_point(DataType::float32, 1e308, 0), "00 00 80 4F"),
            "scaled value is not finite");
}

TEST(Unpack, BcdDigitsAreDecimalDigits) {
  EXPECT_EQ(read(word_point(DataType::bcd16), "34 12"), whole(1234));
  EXPECT_EQ(read(word_point(DataType::bcd32), "78 56 34 12"), whole(12345678));
  EXPECT_EQ(read(group_point(2, DataType::bcd16), "42"), whole(42));
}

TEST(Unpack, GroupsAreUnsignedUntilTheyFillTheirType) {
  EXPECT_EQ(read(group_point(1, DataType::int16), "FF"), whole(15));
  EXPECT_EQ(read(group_point(2, DataType::int16), "FF"), whole(255));
  EXPECT_EQ(read(group_point(3, DataType::int16), "FF FF"), whole(4095));
  EXPECT_EQ(read(group_point(4, DataType::int16), "FF FF"), whole(-1));
  EXPECT_EQ(read(group_point(4, DataType::uint16), "FF FF"), whole(65535));
  EXPECT_EQ(read(group_point(5, DataType::int32), "FF FF FF"), whole(0xFFFFF));
  EXPECT_EQ(read(group_point(7, DataType::int32), "FF FF FF FF"), whole(0xFFFFFFF));
  EXPECT_EQ(read(group_point(8, DataType::int32), "FF FF FF FF"), whole(-1));
}

TEST(Unpack, BitsAreTakenFromWhereTheyLie) {
  Point point{.address = {"M101", {2, 101, 1}, Unit::bit, true}, .type = DataType::boolean};
  EXPECT_EQ(*unpack(point, hex("20"), 96), flag(true));
  EXPECT_EQ(*unpack(point, hex("DF"), 96), flag(false));
  point.count = 5;
  point.is_array = true;
  EXPECT_EQ(
      *unpack(point, hex("20 02"), 96),
      Value::array({Scalar(true), Scalar(false), Scalar(false), Scalar(false), Scalar(true)}));
  Point group = group_point(8, DataType::int32);
  group.address.span.first_bit = 5;
  EXPECT_EQ(*unpack(group, hex("E0 FF FF FF 1F"), 0), whole(-1));
}

TEST(Unpack, APointThatIsNotWhollyInTheImageIsUnsupported) {
  Point point = word_point(DataType::int32);
  point.address.span.first_bit = 32;
  for (const auto& [image, first] : {std::pair(hex("00 00 00"), 32U),
                                     {hex("00 00 00 00"), 48U},
                                     {Bytes{}, 32U},
                                     {hex("00 00 00 00"), 16U}}) {
    EXPECT_EQ(test::error_of(unpack(point, image, first)).code, ErrorCode::unsupported);
  }
  EXPECT_FALSE(unpack(group_point(8, DataType::int16), hex("00 00 00 00"), 0));
}

TEST(Unpack, TextIsTwoCharactersToAWordAndStopsAtNul) {
  Point point = word_point(DataType::string);
  point.length = 6;
  EXPECT_EQ(read(point, "41 42 43 00 45 46"), text("ABC"));
  EXPECT_EQ(read(point, "41 42 43 44 45 46"), text("ABCDEF"));
  EXPECT_EQ(read(point, "00 42 43 44 45 46"), text(""));
  EXPECT_EQ(read(point, "B0 43 FC 00 00 00"), text("\u00B0C\u00FC"));
  point.order = ByteOrder::abcd;
  EXPECT_EQ(read(point, "42 41 44 43 46 45"), text("ABCDEF"));
  point.length = 5;
  EXPECT_EQ(read(point, "42 41 44 43 46 45"), text("ABCDE"));
}

TEST(Unpack, AnArrayHasAllItsElements) {
  EXPECT_EQ(
      read(word_point(DataType::int16, 3), "01 00 02 00 FF FF"),
      Value::array({Scalar(std::int64_t{1}), Scalar(std::int64_t{2}), Scalar(std::int64_t{-1})}));
  EXPECT_FALSE(unpack(word_point(DataType::bcd16, 2), hex("01 00 0A 00"), 0));
}

// ---- writing ----------------------------------------------------------------------------------

TEST(Pack, NumbersBecomeTheirImage) {
  EXPECT_EQ(written(word_point(DataType::int16), whole(0x15AB)), "AB 15");
  EXPECT_EQ(written(word_point(DataType::int16), whole(-1)), "FF FF");
  EXPECT_EQ(written(word_point(DataType::uint16), whole(65535)), "FF FF");
  EXPECT_EQ(written(word_point(DataType::uint32), whole(4294967295)), "FF FF FF FF");
  EXPECT_EQ(written(word_point(DataType::float32), real(23.4)), "33 33 BB 41");
  EXPECT_EQ(written(word_point(DataType::float32), whole(1)), "00 00 80 3F");
  EXPECT_EQ(written(scaled_point(DataType::float32, 0.5, 1), whole(1)), "00 00 00 00");
  EXPECT_EQ(written(word_point(DataType::bcd16), whole(1234)), "34 12");
  EXPECT_EQ(written(word_point(DataType::bcd32), whole(12345678)), "78 56 34 12");
  EXPECT_EQ(written(group_point(3, DataType::int16), whole(4095)), "FF 0F");
  EXPECT_EQ(written(group_point(2, DataType::bcd16), whole(42)), "42");
  EXPECT_EQ(written(group_point(8, DataType::int32), whole(-2)), "FE FF FF FF");
  EXPECT_EQ(
      written(word_point(DataType::int16, 2), Value::array({Scalar(std::int64_t{1}), Scalar(2.0)})),
      "01 00 02 00");
}

TEST(Pack, LargestFloatIsTakenAsItIsPublished) {
  const Point point = word_point(DataType::float32);
  EXPECT_EQ(read(point, "FF FF 7F 7F"), real(3.4028235e38));
  for (const double largest : {3.4028235e38, 3.4028234663852886e38, 3.40282356e38}) {
    EXPECT_EQ(written(point, real(largest)), "FF FF 7F 7F");
    EXPECT_EQ(written(point, real(-largest)), "FF FF 7F FF");
  }
  EXPECT_EQ(fault(point, real(3.4028236e38)), PackFault::out_of_range);
  EXPECT_EQ(value_range(point)->greatest, 3.4028235e38);
}

TEST(Pack, IntegersBeyondTwoToThe53MayBeTexts) {
  const Point point = word_point(DataType::uint64);
  EXPECT_EQ(written(point, text("18446744073709551615")), "FF FF FF FF FF FF FF FF");
  EXPECT_EQ(written(point, large("18446744073709551615")), "FF FF FF FF FF FF FF FF");
  EXPECT_EQ(written(point, text("50")), "32 00 00 00 00 00 00 00");
  EXPECT_EQ(written(word_point(DataType::int64), text("-9223372036854775808")),
            "00 00 00 00 00 00 00 80");
  EXPECT_EQ(written(word_point(DataType::int64), whole(-2)), "FE FF FF FF FF FF FF FF");
  // (9007199254740993 - 1) / 4 = 0x8000000000000
  EXPECT_EQ(written(scaled_point(DataType::int64, 4, 1), text("9007199254740993")),
            "00 00 00 00 00 00 08 00");
  EXPECT_EQ(written(scaled_point(DataType::int64, 0.001, 0), real(12345678901234.5)),
            "44 4B 6B 5D 54 DC 2B 00");
  for (const char* no : {"18446744073709551616", "-1"})
    EXPECT_EQ(fault(point, text(no)), PackFault::out_of_range) << no;
  EXPECT_EQ(fault(point, real(18446744073709551616.0)), PackFault::out_of_range);
  EXPECT_EQ(fault(point, real(1e300)), PackFault::out_of_range);
  for (const char* no : {"", "-", "1e5", "0x10", "007", " 1", "1.0", "+1"})
    EXPECT_EQ(fault(point, text(no)), PackFault::bad_value) << no;
  EXPECT_EQ(fault(word_point(DataType::int16), text("50")), PackFault::bad_value);
  EXPECT_EQ(fault(word_point(DataType::int16), text("9007199254740993")), PackFault::bad_value);
  EXPECT_EQ(fault(scaled_point(DataType::int16, 2, 0), text("9007199254740993")),
            PackFault::out_of_range);
  EXPECT_EQ(fault(scaled_point(DataType::int16, 2, 0), text("50")), PackFault::bad_value);
  EXPECT_EQ(fault(word_point(DataType::float64), text("9007199254740993")), PackFault::bad_value);
  const auto refused = pack(point, text("18446744073709551616"));
  EXPECT_EQ(refused.error().text,
            "18446744073709551616 is raw 18446744073709551616; uint64 holds 0 to "
            "18446744073709551615");
}

TEST(Pack, ValuesOf64BitsAreComparedExactly) {
  EXPECT_TRUE(shows(whole(9007199254740993), text("9007199254740993")));
  EXPECT_FALSE(shows(whole(9007199254740993), real(9007199254740992)));
  EXPECT_FALSE(shows(whole(9007199254740993), whole(9007199254740992)));
  EXPECT_TRUE(shows(large("18446744073709551615"), large("18446744073709551615")));
  EXPECT_FALSE(shows(large("18446744073709551615"), large("18446744073709551614")));
  EXPECT_FALSE(shows(large("18446744073709551615"), real(18446744073709551616.0)));
  EXPECT_FALSE(shows(whole(5), text("five")));
  EXPECT_TRUE(check_kind(word_point(DataType::int64), text("9007199254740993")));
}

TEST(Pack, RawIsTheNearestIntegerAndTiesGoAwayFromZero) {
  EXPECT_EQ(written(word_point(DataType::int16), real(1.5)), "02 00");
  EXPECT_EQ(written(word_point(DataType::int16), real(-1.5)), "FE FF");
  EXPECT_EQ(written(word_point(DataType::int16), real(1.49)), "01 00");
  const Point tenth = scaled_point(DataType::int16, 0.1, 0);
  EXPECT_EQ(written(tenth, real(23.4)), "EA 00");
  EXPECT_EQ(written(tenth, real(23.45)), "EB 00");  // binary 234.49999999999997, decimal 234.5
  EXPECT_EQ(written(tenth, real(23.44)), "EA 00");
  EXPECT_EQ(written(scaled_point(DataType::int16, 0.1, 20), real(23.4)), "22 00");
  EXPECT_EQ(written(scaled_point(DataType::uint32, 1e-9, 0), real(4.294967295)), "FF FF FF FF");
}

TEST(Pack, EveryRawValueComesBackThroughItsUnits) {
  for (const auto& [scale, offset] :
       {std::pair(0.1, 0.0), {0.05, -273.15}, {1.0 / 3, 7.0}, {-2.0, 1.0}}) {
    const Point point = scaled_point(DataType::int16, scale, offset);
    for (int raw = -32768; raw < 32768; raw += 13) {
      const Bytes image{static_cast<std::uint8_t>(raw), static_cast<std::uint8_t>(raw >> 8)};
      ASSERT_EQ(*pack(point, *unpack(point, image, 0)), image) << raw << " x " << scale;
    }
  }
}

TEST(Pack, LargeRawValueComesBackThroughItsUnits) {
  for (const double scale : {0.1, 0.05, 0.001}) {
    const Point point = scaled_point(DataType::int64, scale, 0);
    // From 2^52 on, some neighbours have the same double.
    for (std::int64_t raw = (std::int64_t{1} << 52) - 1; raw > std::int64_t{1} << 51;
         raw -= raw / 99) {
      Bytes image;
      for (int shift = 0; shift < 64; shift += 8)
        image.push_back(static_cast<std::uint8_t>(raw >> shift));
      ASSERT_EQ(*pack(point, *unpack(point, image, 0)), image) << raw << " x " << scale;
    }
  }
  // 2^52 - 7
  EXPECT_EQ(read(scaled_point(DataType::int64, 0.1, 0), "F9 FF FF FF FF FF 0F 00"),
            real(450359962737048.9));
}

TEST(Pack, AValueOutsideTheRawRangeIsOutOfRange) {
  const std::pair<Point, Value> cases[] = {
      {word_point(DataType::int16), whole(32768)},
      {word_point(DataType::int16), whole(-32769)},
      {word_point(DataType::int16), real(32767.5)},
      {word_point(DataType::uint16), whole(-1)},
      {word_point(DataType::uint16), whole(65536)},
      {word_point(DataType::int32), whole(2147483648)},
      {word_point(DataType::uint32), whole(4294967296)},
      {word_point(DataType::uint32), real(1e300)},
      {word_point(DataType::bcd16), whole(10000)},
      {word_point(DataType::bcd16), whole(-1)},
      {word_point(DataType::bcd32), whole(100000000)},
      {word_point(DataType::float32), real(1e39)},
      {group_point(1, DataType::int16), whole(16)},
      {group_point(3, DataType::int16), whole(-1)},
      {group_point(4, DataType::int16), whole(32768)},
      {group_point(5, DataType::int32), whole(1 << 20)},
      {group_point(2, DataType::bcd16), whole(100)},
      {scaled_point(DataType::int16, 0.1, 0), whole(3277)},
      {scaled_point(DataType::int16, 1e-300, 0), real(1e300)},
      {scaled_point(DataType::float32, 1e-300, 0), real(1e300)},
  };
  for (const auto& [point, value] : cases)
    EXPECT_EQ(fault(point, value), PackFault::out_of_range) << to_string(point.type);
}

TEST(Pack, FaultyElementOfAnArrayIsNamed) {
  const Point three = word_point(DataType::int16, 3);
  const auto why = [&](const Scalar& second) {
    return pack(three, Value::array({Scalar(std::int64_t{1}), second, Scalar(std::int64_t{3})}))
        .error()
        .text;
  };
  test::expect_says(why(std::string("2")), "element 2: int16 takes a number");
  test::expect_says(why(std::int64_t{32768}), "element 2: 32768 is raw 32768");
  EXPECT_FALSE(pack(word_point(DataType::int16), text("2")).error().text.starts_with("element"));
}

TEST(Pack, AValueOfTheWrongKindIsABadValue) {
  const double inf = std::numeric_limits<double>::infinity();
  const std::pair<Point, Value> cases[] = {
      {word_point(DataType::int16), text("5")},
      {word_point(DataType::int16), flag(true)},
      {word_point(DataType::int16), real(inf)},
      {word_point(DataType::float32), real(std::nan(""))},
      {word_point(DataType::float32), text("1")},
      {word_point(DataType::int16), Value::array({Scalar(std::int64_t{1})})},
      {word_point(DataType::int16), Value{}},
      {word_point(DataType::int16, 2), whole(1)},
      {word_point(DataType::int16, 2), Value::array({Scalar(std::int64_t{1})})},
      {group_point(8, DataType::int16), whole(1)},
  };
  for (const auto& [point, value] : cases)
    EXPECT_EQ(fault(point, value), PackFault::bad_value) << to_string(point.type);
}

// Forms and flows send a number as text, and the other way round.
TEST(Pack, AWrongKindSaysWhatToSendInstead) {
  Point bit;
  bit.address = {"M0", {2, 0, 1}, Unit::bit, true};
  bit.type = DataType::boolean;
  Point label = word_point(DataType::string);
  label.length = 5;
  const Point word = word_point(DataType::int16);
  struct Case {
    Point point;
    Value value;
    std::string error;
  };
  const std::string long_text(33, '5');
  for (const Case& each :
       {Case{word, text("50"), R"(int16 takes a number: send the number 50, not the text "50")"},
        Case{word, text(" -2.5 "),
             R"(int16 takes a number: send the number -2.5, not the text " -2.5 ")"},
        Case{word_point(DataType::float64), text("9007199254740993"),
             "float64 takes a number: send the number 9007199254740993, not the text "
             R"("9007199254740993")"},
        Case{word, text("007"), R"(int16 takes a number: send the number 7, not the text "007")"},
        Case{word_point(DataType::int64), text("-007"),
             "int64 takes a number, or a text without leading zeros or spaces: "
             R"("-7", not "-007")"},
        Case{word_point(DataType::uint64), text(" 9007199254740993 "),
             "uint64 takes a number, or a text without leading zeros or spaces: "
             R"("9007199254740993", not " 9007199254740993 ")"},
        Case{word_point(DataType::int64), text("7.5"),
             R"(int64 takes a number: send the number 7.5, not the text "7.5")"},
        Case{word, text("fifty"), R"(int16 takes a number, not the text "fifty")"},
        Case{word, text("23,5"), R"(int16 takes a number, not the text "23,5")"},
        Case{word, text("inf"), R"(int16 takes a number, not the text "inf")"},
        Case{word, text(""), R"(int16 takes a number, not the text "")"},
        Case{word, text(long_text.c_str()), "int16 takes a number, not a text"},
        Case{word, text("5\n"), "int16 takes a number, not a text"},
        Case{word, flag(true), "int16 takes a number: send 1, not true"},
        Case{bit, text("true"),
             R"(bool takes true, false, 1 or 0: send true without quotes, not the text "true")"},
        Case{bit, text("1"),
             R"(bool takes true, false, 1 or 0: send the number 1, not the text "1")"},
        Case{bit, whole(2), "bool takes true, false, 1 or 0"},
        Case{word, Value::array({}), "an array without elements"},
        Case{label, whole(5), R"(string takes a text: send "5" in quotes, not a number)"},
        Case{label, real(2.5), R"(string takes a text: send "2.5" in quotes, not a number)"},
        Case{label, flag(true), "string takes a text: send it in quotes"}}) {
    EXPECT_EQ(test::error_of(pack(each.point, each.value)).text, each.error);
  }
}

TEST(Pack, ANumberWithAPointBeyondAnExactDoubleIsRefused) {
  const Point wide = word_point(DataType::int64);
  EXPECT_EQ(written(wide, real(9007199254740991)), written(wide, whole(9007199254740991)));
  for (const double number : {9007199254740992.0, -9007199254740996.0, 1e18}) {
    const PackError refused = test::error_of(pack(wide, real(number)));
    EXPECT_EQ(refused.fault, PackFault::bad_value) << number;
    EXPECT_NE(refused.text.find("without a point"), std::string::npos) << refused.text;
  }
  EXPECT_EQ(fault(wide, real(1e19)), PackFault::out_of_range);
}

TEST(Pack, ANumberThatAFloatWouldMakeZeroIsOutOfRange) {
  const Point single = word_point(DataType::float32);
  EXPECT_NE(written(single, real(1e-45)), written(single, real(0)));
  EXPECT_TRUE(pack(single, real(-0.0)));
  for (const double number : {1e-50, -1e-50})
    EXPECT_EQ(fault(single, real(number)), PackFault::out_of_range);
  EXPECT_EQ(fault(scaled_point(DataType::float64, 1e300, 0), real(1e-300)),
            PackFault::out_of_range);
}

TEST(Pack, AWrongKindAnywhereComesBeforeARangeAnywhere) {
  EXPECT_EQ(fault(word_point(DataType::int16, 2),
                  Value::array({Scalar(std::int64_t{99999}), Scalar(std::string("x"))})),
            PackFault::bad_value);
}

TEST(Pack, ABoolIsAlsoZeroOrOne) {
  const Point point{.address = {"M0", {2, 0, 1}, Unit::bit, true}, .type = DataType::boolean};
  for (const Value& on : {flag(true), whole(1), real(1.0)}) EXPECT_EQ(written(point, on), "01");
  for (const Value& off : {flag(false), whole(0), real(0.0)}) EXPECT_EQ(written(point, off), "00");
  for (const Value& wrong : {whole(2), whole(-1), real(0.5), text("true")})
    EXPECT_EQ(fault(point, wrong), PackFault::bad_value);
}

TEST(Pack, TextIsPaddedWithNulAndMustFit) {
  Point point = word_point(DataType::string);
  point.length = 5;
  EXPECT_EQ(written(point, text("ABC")), "41 42 43 00 00 00");
  EXPECT_EQ(written(point, text("ABCDE")), "41 42 43 44 45 00");
  EXPECT_EQ(written(point, text("")), "00 00 00 00 00 00");
  EXPECT_EQ(written(point, text("\u00B0C\u00FF")), "B0 43 FF 00 00 00");
  EXPECT_EQ(fault(point, text("ABCDEF")), PackFault::out_of_range);
  EXPECT_EQ(fault(point, whole(5)), PackFault::bad_value);
  for (const char* wrong : {"\u20AC", "\xFF", "\xC3", "\xC3(", "\xC4\x80", "\x80"})
    EXPECT_EQ(fault(point, text(wrong)), PackFault::bad_value);
  EXPECT_EQ(fault(point, Value(Scalar(std::string("A\0B", 3)))), PackFault::bad_value);
  point.order = ByteOrder::abcd;
  EXPECT_EQ(written(point, text("ABC")), "42 41 00 43 00 00");
}

TEST(Units, AreFiniteAndOnlyForNumbers) {
  Point point = word_point(DataType::int16);
  EXPECT_FALSE(set_units(point, 0, 0));
  EXPECT_FALSE(set_units(point, std::nan(""), 0));
  EXPECT_FALSE(set_units(point, 1, std::numeric_limits<double>::infinity()));
  Point words = word_point(DataType::string);
  EXPECT_FALSE(set_units(words, 0.1, 0));
  EXPECT_TRUE(set_units(words, 1, 0));
  Point bit = word_point(DataType::boolean);
  EXPECT_FALSE(set_units(bit, 1, 5));
  ASSERT_TRUE(set_units(point, 0.25, 100.5));
  EXPECT_EQ(point.decimals, 2);
  // More decimals than a signed byte counts.
  for (const double tiny : {1e-200, 1e-256, 1e-312}) {
    ASSERT_TRUE(set_units(point, tiny, 0));
    EXPECT_GT(point.decimals, 17) << tiny;
  }
}

// ---- images -----------------------------------------------------------------------------------

TEST(Image, BitsAreExtractedAndReadAsZeroPastTheEnd) {
  EXPECT_EQ(to_hex(extract_bits(hex("AB CD"), 4, 8)), "DA");
  EXPECT_EQ(to_hex(extract_bits(hex("AB CD"), 8, 16)), "CD 00");
  EXPECT_EQ(to_hex(extract_bits(hex("FF FF"), 3, 11)), "FF 07");
  EXPECT_TRUE(extract_bits(hex("AB"), 0, 0).empty());
}

TEST(Image, BitsAreInsertedWithoutTouchingTheirNeighbours) {
  Bytes image = hex("00 00 FF");
  insert_bits(image, 4, hex("FF"), 8);
  EXPECT_EQ(to_hex(image), "F0 0F FF");
  insert_bits(image, 15, hex("00 00"), 9);
  EXPECT_EQ(to_hex(image), "F0 0F 00");
  insert_bits(image, 0, hex("34 12"), 16);
  EXPECT_EQ(to_hex(image), "34 12 00");
}

}  // namespace
}  // namespace fxagent
