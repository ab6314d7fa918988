#include "agent/uplink/sparkplug/typed_value.h"

#include <gtest/gtest.h>

#include "tests/agent/uplink/sparkplug/bytes.h"

namespace fxagent::sparkplug {
namespace {

using test::bytes;

struct Row {
  Type type;
  std::string bytes;
  std::string json;
  Scalars items;
};

/// Examples of Sparkplug 3.0, section 6.4.16; the last bits of the booleans are free there. In our
/// JSON an integer beyond 2^53 is a text.
std::vector<Row> examples() {
  return {
      {Type::int16_array, bytes("D0 8A 30 75"), "[-30000,30000]",
       Scalars{std::int64_t{-30000}, std::int64_t{30000}}},
      {Type::int32_array, bytes("FF FF FF FF FA AF CB 12"), "[-1,315338746]",
       Scalars{std::int64_t{-1}, std::int64_t{315338746}}},
      {Type::int64_array, bytes("CE 06 72 AC 18 9C BA C4 C4 BA 9C 18 AC 72 06 CE"),
       R"(["-4270929666821191986","-3601064768563266876"])",
       Scalars{std::int64_t{-4270929666821191986}, std::int64_t{-3601064768563266876}}},
      {Type::uint16_array, bytes("1E 00 88 CC"), "[30,52360]",
       Scalars{std::int64_t{30}, std::int64_t{52360}}},
      {Type::uint32_array, bytes("34 00 00 00 49 FB 55 C4"), "[52,3293969225]",
       Scalars{std::int64_t{52}, std::int64_t{3293969225}}},
      {Type::uint64_array, bytes("34 00 00 00 00 00 00 00 D9 9E 02 D1 B2 76 37 E4"),
       R"([52,"16444743074749521625"])",
       Scalars{std::int64_t{52}, BigInteger{"16444743074749521625"}}},
      {Type::real32_array, bytes("A4 70 9D 3F 98 AE B2 42"), "[1.23,89.341]", {1.23, 89.341}},
      {Type::real64_array, bytes("D7 A2 05 68 5B B5 28 40 8E 17 1C 6F 4C F7 8F 40"),
       "[12.354213,1022.9123213]", Scalars{12.354213, 1022.9123213}},
      {Type::boolean_array, bytes("0C 00 00 00 34 D0"),
       "[false,false,true,true,false,true,false,false,true,true,false,true]",
       Scalars{false, false, true, true, false, true, false, false, true, true, false, true}},
      {Type::string_array, bytes("41 42 43 00 68 65 6C 6C 6F 00"), R"(["ABC","hello"])",
       Scalars{std::string("ABC"), std::string("hello")}},
  };
}

TEST(SparkplugTypedValue, ArraysHaveTheBytesOfTheSpecification) {
  for (const Row& row : examples()) {
    const TypedValue value = typed(Value::array(row.items), row.type);
    ASSERT_TRUE(std::holds_alternative<Packed>(value)) << row.json;
    EXPECT_EQ(std::get<Packed>(value).bytes, row.bytes) << row.json;
    EXPECT_EQ(json_of(Packed{row.bytes}, row.type), row.json);
  }
}

TEST(SparkplugTypedValue, BytesThatAreNoArrayOfTheTypeHaveNoValue) {
  for (const auto& [type, text] :
       {std::pair(Type::int16_array, "01 02 03"), std::pair(Type::real64_array, "01 02 03 04"),
        std::pair(Type::boolean_array, "01 00 00"),
        std::pair(Type::boolean_array, "09 00 00 00 FF"),
        std::pair(Type::boolean_array, "FF FF FF FF FF"),
        std::pair(Type::boolean_array, "01 00 00 00 80 80"), std::pair(Type::string_array, "41 42"),
        std::pair(Type::int16, "01 02"), std::pair(Type::string, "41 00")})
    EXPECT_EQ(json_of(Packed{bytes(text)}, type), std::nullopt) << text;
  EXPECT_EQ(json_of(Packed{}, Type::int16_array), "[]");
  EXPECT_EQ(json_of(TypedValue(), Type::int16), std::nullopt);
}

TEST(SparkplugTypedValue, ReceivedIntegerBeyondTwoToThe53IsNoText) {
  EXPECT_EQ(json_of(std::uint64_t{18446744073709551611U}, Type::string), "18446744073709551611");
  EXPECT_EQ(json_of(std::int64_t{-9007199254740993}, Type::real64), "-9007199254740993");
}

TEST(SparkplugTypedValue, ValueThatTheTypeCannotHoldIsNone) {
  const auto none = [](const Value& value, Type type) {
    return std::holds_alternative<std::monostate>(typed(value, type));
  };
  EXPECT_TRUE(none(Value(std::string("1")), Type::int16));
  EXPECT_TRUE(none(Value(true), Type::string));
  EXPECT_TRUE(none(Value(1.5), Type::int32));
  EXPECT_TRUE(none(Value(std::int64_t{1}), Type::int16_array));
  EXPECT_TRUE(none(Value::array({std::int64_t{1}}), Type::int16));
  EXPECT_TRUE(none(Value(), Type::int16));
  EXPECT_FALSE(none(Value(std::int64_t{-1}), Type::int16));
}

}  // namespace
}  // namespace fxagent::sparkplug
