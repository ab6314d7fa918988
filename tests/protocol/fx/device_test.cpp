#include "protocol/fx/device.h"

#include <gtest/gtest.h>

#include "protocol/catalog.h"
#include "tests/support/says.h"

namespace fxagent::fx {
namespace {

using test::error_of;
using test::expect_says;

Address address(std::string_view text, Model model = Model::fx3u,
                std::optional<DataType> type = {}) {
  const auto parsed = fx::parse_address(model, text, type);
  EXPECT_TRUE(parsed.has_value()) << text << ": " << (parsed ? "" : parsed.error().text);
  return parsed.value_or(Address{});
}

std::string refusal(std::string_view text, Model model = Model::fx3u) {
  SCOPED_TRACE(text);
  const Error error = error_of(fx::parse_address(model, text, std::nullopt));
  EXPECT_EQ(error.code, ErrorCode::bad_request);
  return error.text;
}

std::string range_refusal(std::string_view text, Model model = Model::fx3u) {
  SCOPED_TRACE(text);
  return error_of(fx::parse_range(model, text)).text;
}

TEST(Device, NamesBecomePlacesInTheirSpace) {
  struct Case {
    const char* text;
    const char* canonical;
    Span span;
    Unit unit;
  };
  const Case cases[] = {
      {"X0", "X0", {id(Space::x), 0, 1}, Unit::bit},
      {"X17", "X17", {id(Space::x), 15, 1}, Unit::bit},
      {"Y100", "Y100", {id(Space::y), 64, 1}, Unit::bit},
      {"Y377", "Y377", {id(Space::y), 255, 1}, Unit::bit},
      {"M7679", "M7679", {id(Space::m), 7679, 1}, Unit::bit},
      {"M8000", "M8000", {id(Space::special_m), 0, 1}, Unit::bit},
      {"S4095", "S4095", {id(Space::s), 4095, 1}, Unit::bit},
      {"TS5", "TS5", {id(Space::ts), 5, 1}, Unit::bit},
      {"TN5", "TN5", {id(Space::tn), 80, 16}, Unit::word},
      {"CS255", "CS255", {id(Space::cs), 255, 1}, Unit::bit},
      {"CN199", "CN199", {id(Space::cn), 199 * 16, 16}, Unit::word},
      {"CN200", "CN200", {id(Space::cn32), 0, 32}, Unit::dword},
      {"CN255", "CN255", {id(Space::cn32), 55 * 32, 32}, Unit::dword},
      {"D7999", "D7999", {id(Space::d), 7999 * 16, 16}, Unit::word},
      {"D8010", "D8010", {id(Space::special_d), 160, 16}, Unit::word},
      {"D100.F", "D100.F", {id(Space::d), 1615, 1}, Unit::word_bit},
      {"R100.F", "R100.F", {id(Space::r), 1615, 1}, Unit::word_bit},
      {"D8000.0", "D8000.0", {id(Space::special_d), 0, 1}, Unit::word_bit},
      {"K4M0", "K4M0", {id(Space::m), 0, 16}, Unit::bit_group},
      {"K1Y10", "K1Y10", {id(Space::y), 8, 4}, Unit::bit_group},
      {"K8M8000", "K8M8000", {id(Space::special_m), 0, 32}, Unit::bit_group},
      {"K2S20", "K2S20", {id(Space::s), 20, 8}, Unit::bit_group},
      {"k3x0", "K3X0", {id(Space::x), 0, 12}, Unit::bit_group},
      {"d0100.f", "D100.F", {id(Space::d), 1615, 1}, Unit::word_bit},
      {"m000", "M0", {id(Space::m), 0, 1}, Unit::bit},
      {"y007", "Y7", {id(Space::y), 7, 1}, Unit::bit},
  };
  for (const Case& c : cases) {
    const Address a = address(c.text);
    EXPECT_EQ(a.text, c.canonical);
    EXPECT_EQ(a.span, c.span) << c.text;
    EXPECT_EQ(a.unit, c.unit) << c.text;
    EXPECT_EQ(a.writable, c.unit != Unit::word_bit) << c.text;
  }
}

TEST(Device, TAndCAreTheContactAsBoolAndTheValueOtherwise) {
  EXPECT_EQ(address("T5", Model::fx3u, DataType::boolean).text, "TS5");
  EXPECT_EQ(address("T5", Model::fx3u, DataType::int16).text, "TN5");
  EXPECT_EQ(address("C5").text, "CN5");
  EXPECT_EQ(address("C200", Model::fx3u, DataType::int32).unit, Unit::dword);
  EXPECT_EQ(address("c235", Model::fx3u, DataType::boolean).text, "CS235");
  EXPECT_TRUE(needs_type("T5"));
  EXPECT_TRUE(needs_type("c005"));
  for (const char* text : {"TN5", "TS5", "D5", "CN200", "K4M0", "Q5", ""})
    EXPECT_FALSE(needs_type(text)) << text;
}

TEST(Device, ANumberThatIsNotOctalNamesItsNeighbours) {
  EXPECT_EQ(refusal("X8"), "X8 does not exist: X of FX3U is numbered in octal, after X7 comes X10");
  EXPECT_EQ(refusal("Y19"),
            "Y19 does not exist: Y of FX3U is numbered in octal, after Y17 comes Y20");
  EXPECT_EQ(refusal("X80"),
            "X80 does not exist: X of FX3U is numbered in octal, after X77 comes X100");
  EXPECT_EQ(refusal("K4Y8"),
            "K4Y8 does not exist: Y of FX3U is numbered in octal, after Y7 comes Y10");
}

TEST(Device, NonsenseIsRefusedWithTheFormsThatExist) {
  for (const char* text : {"", "Q5", "100", "TC5", "D1OO", " D1", "D1 ", "-1"})
    expect_says(refusal(text), "FX device");
  expect_says(refusal("D-1"), "no device number");
  expect_says(refusal("D"), "no device number");
  expect_says(refusal("D1234567890"), "too large");
  for (const char* text : {"D100.G", "D100.", "D100.10", "M100.1", "K4D100.1"})
    expect_says(refusal(text), "D100.0 to D100.F");
  for (const char* text : {"K0M0", "K9M0", "K10M0"}) expect_says(refusal(text), "K1 to K8");
  for (const char* text : {"K4D0", "K4TS0", "K4CN0", "K4T0"})
    expect_says(refusal(text), "X, Y, M or S");
}

TEST(Device, ARefusalQuotesTheNameAsItWasWritten) {
  EXPECT_TRUE(refusal("dd1").starts_with("'dd1' is not an FX device")) << refusal("dd1");
  EXPECT_EQ(refusal("x8"), "x8 does not exist: X of FX3U is numbered in octal, after X7 comes X10");
  EXPECT_EQ(refusal("D20o"),
            "'D20o' is not an FX device: after the number comes 'o'; a bit of a word is D100.0 to "
            "D100.F");
  EXPECT_EQ(refusal("d"), "'d' has no device number");
  EXPECT_EQ(refusal("k4d0"), "k4d0: a group is made of X, Y, M or S");
  EXPECT_TRUE(refusal("k9m0").starts_with("k9m0: ")) << refusal("k9m0");
  EXPECT_TRUE(refusal("d1234567890").starts_with("d1234567890: ")) << refusal("d1234567890");
  EXPECT_TRUE(refusal("d100.g").starts_with("'d100.g' ")) << refusal("d100.g");
  for (const char* text : {"m100-k4m0", "t0-t5", "m0-d5", "m9-m0"}) {
    EXPECT_TRUE(range_refusal(text).starts_with(text)) << range_refusal(text);
  }
}

TEST(Device, EachModelHasItsLastDeviceAndNotTheNext) {
  struct Case {
    Model model;
    const char* last;
    const char* beyond;
  };
  const Case cases[] = {
      {Model::fx0n, "X177", "X200"},         {Model::fx0n, "M511", "M512"},
      {Model::fx0n, "S127", "S128"},         {Model::fx0n, "TN63", "TN64"},
      {Model::fx0n, "CN31", "CN32"},         {Model::fx0n, "CN235", "CN234"},
      {Model::fx0n, "CN254", "CN255"},       {Model::fx0n, "CS31", "CS32"},
      {Model::fx0n, "CS235", "CS234"},       {Model::fx0n, "D255", "D256"},
      {Model::fx0n, "D8255", "D8256"},       {Model::fx1s, "X17", "X20"},
      {Model::fx1s, "Y15", "Y16"},           {Model::fx1s, "CN255", "CN256"},
      {Model::fx1n, "M1535", "M1536"},       {Model::fx1n, "S999", "S1000"},
      {Model::fx1n, "T255", "T256"},         {Model::fx1n, "D7999", "D9000"},
      {Model::fx2n, "X267", "X270"},         {Model::fx2n, "M3071", "M3072"},
      {Model::fx2n, "M8255", "M8256"},       {Model::fx3s, "M1535", "M1536"},
      {Model::fx3s, "S255", "S256"},         {Model::fx3s, "TS137", "TS138"},
      {Model::fx3s, "D2999", "D3000"},       {Model::fx3s, "M8511", "M8512"},
      {Model::fx3g, "T319", "T320"},         {Model::fx3g, "Y177", "Y200"},
      {Model::fx3u, "Y377", "Y400"},         {Model::fx3u, "M7679", "M7680"},
      {Model::fx3u, "T511", "T512"},         {Model::fx3u, "CN199", "CN256"},
      {Model::unknown_fx, "M7679", "M7680"}, {Model::unknown_fx, "T511", "D8512"},
      {Model::fx3g, "R23999", "R24000"},     {Model::fx3u, "R32767", "R32768"},
      {Model::fx1s, "K3Y0", "K4Y0"},         {Model::fx0n, "K4M496", "K4M500"},
  };
  for (const Case& c : cases) {
    address(c.last, c.model);
    expect_says(refusal(c.beyond, c.model), "does not exist");
  }
}

TEST(Device, ARefusalNamesTheModelAndItsRanges) {
  EXPECT_EQ(refusal("M7680"), "M7680 does not exist: FX3U has M0-M7679 and M8000-M8511");
  EXPECT_EQ(refusal("X20", Model::fx1s), "X20 does not exist: FX1S has X0-X17");
  EXPECT_EQ(refusal("CS40", Model::fx0n), "CS40 does not exist: FX0N has CS0-CS31 and CS235-CS254");
  EXPECT_EQ(refusal("R0", Model::fx2n), "R0 does not exist: FX2N has no R");
  EXPECT_EQ(refusal("Y400", Model::unknown_fx),
            "Y400 does not exist: the widest model (FX3U) has Y0-Y377");
}

TEST(Device, EveryDeviceOfEveryModelIsReadBackFromItsOwnName) {
  for (const std::string_view name : find_protocol("fx-computer-link")->models) {
    const Model model = *model_named(name);
    EXPECT_EQ(to_string(model), name);
    for (std::uint16_t i = 0; i < kSpaces; ++i) {
      if (!is_addressed(i)) continue;
      const auto space = static_cast<Space>(i);
      for (const Numbers& run : numbers_of(model, space)) {
        for (std::uint32_t n = run.first; n <= run.last; ++n) {
          const auto parsed = fx::parse_address(model, device_name(space, n), std::nullopt);
          ASSERT_TRUE(parsed) << device_name(space, n) << " " << parsed.error().text;
          ASSERT_EQ(parsed->span, span_of(space, {n, n}));
          ASSERT_EQ(device_name(parsed->span), parsed->text);
        }
      }
    }
  }
}

TEST(Device, CoilsShareTheNumbersOfTheirTimersAndCounters) {
  EXPECT_EQ(numbers_of(Model::fx3u, Space::tc).begin()->last, 511U);
  EXPECT_EQ(numbers_of(Model::fx0n, Space::cc).size(), 2U);
  EXPECT_EQ(device_name(Space::tc, 5), "TC5");
  EXPECT_EQ(device_name({99, 0, 1}), "space 99");
}

TEST(Device, ModelNamesAreKnownByTheirExactSpelling) {
  EXPECT_EQ(find_protocol("fx-computer-link")->models.size(), 7U);
  EXPECT_EQ(model_named("FX3U"), Model::fx3u);
  EXPECT_EQ(model_named("auto"), std::nullopt);
  EXPECT_EQ(to_string(Model::unknown_fx), "");
}

Span range(std::string_view text, Model model = Model::fx3u) {
  const auto parsed = fx::parse_range(model, text);
  EXPECT_TRUE(parsed.has_value()) << text << ": " << (parsed ? "" : parsed.error().text);
  return parsed.value_or(Span{});
}

TEST(DeviceRange, CoversBothEnds) {
  EXPECT_EQ(range("M100-M199"), (Span{id(Space::m), 100, 100}));
  EXPECT_EQ(range("M100-199"), (Span{id(Space::m), 100, 100}));
  EXPECT_EQ(range("M100 - M199"), (Span{id(Space::m), 100, 100}));
  EXPECT_EQ(range("TN0..9"), (Span{id(Space::tn), 0, 160}));
  EXPECT_EQ(range("Y0-Y17"), (Span{id(Space::y), 0, 16}));
  EXPECT_EQ(range("d100-D199"), (Span{id(Space::d), 1600, 1600}));
  EXPECT_EQ(range("CN200-CN210"), (Span{id(Space::cn32), 0, 352}));
  EXPECT_EQ(range("TN0-TN9"), (Span{id(Space::tn), 0, 160}));
  EXPECT_EQ(range("D5"), (Span{id(Space::d), 80, 16}));
  EXPECT_EQ(range("M8038-M8117"), (Span{id(Space::special_m), 38, 80}));
}

TEST(DeviceRange, SaysWhatIsWrongWithIt) {
  expect_says(range_refusal("K4M0-15"), "one plain device");
  expect_says(range_refusal("M100-"), "''");
  expect_says(range_refusal("M100-D199"), "one kind");
  expect_says(range_refusal("M7000-M8010"), "one kind");
  expect_says(range_refusal("CN190-CN210"), "one kind");
  expect_says(range_refusal("M199-M100"), "ends before it begins");
  expect_says(range_refusal("T0-T9"), "TN for the values or TS");
  expect_says(range_refusal("C5"), "CN for the values or CS");
  expect_says(range_refusal("K4M0-K4M16"), "plain device");
  expect_says(range_refusal("D0.1"), "plain device");
  expect_says(range_refusal("Y0-Y8"), "octal");
  expect_says(range_refusal("M100-"), "FX device");
  expect_says(range_refusal("M100-Q199"), "FX device");
  expect_says(range_refusal("D0-D9000"), "does not exist");
  expect_says(range_refusal("CS0-CS254", Model::fx0n), "CS32 does not exist");
}

TEST(DeviceRange, NeverHoldsWhatStartsOrStopsThePlc) {
  for (const char* text : {"M8034", "M8037", "M8000-M8100", "M8036-M8050", "M8118", "M8100-M8200"})
    expect_says(range_refusal(text), "M8034-M8037 and M8118");
}

bool may_write(const Span& span, Model model = Model::fx3u) {
  return fx::check_write(model, span).has_value();
}

TEST(DeviceWrite, TakesSingleBitsWholeBytesAndWholeWords) {
  EXPECT_TRUE(may_write({id(Space::m), 3, 1}));
  EXPECT_TRUE(may_write({id(Space::m), 8, 16}));
  EXPECT_FALSE(may_write({id(Space::m), 3, 16}));
  EXPECT_FALSE(may_write({id(Space::m), 0, 12}));
  EXPECT_TRUE(may_write({id(Space::d), 1600, 32}));
  EXPECT_FALSE(may_write({id(Space::d), 1615, 1}));
  EXPECT_TRUE(may_write({id(Space::cn32), 32, 32}));
  EXPECT_FALSE(may_write({id(Space::cn32), 16, 32}));
  EXPECT_FALSE(may_write({id(Space::cn32), 0, 16}));
  EXPECT_FALSE(may_write({id(Space::d), 0, 0}));
}

TEST(DeviceWrite, StopsAtTheModelsLastDevice) {
  EXPECT_TRUE(may_write({id(Space::d), 255 * 16, 16}, Model::fx0n));
  EXPECT_FALSE(may_write({id(Space::d), 255 * 16, 32}, Model::fx0n));
  EXPECT_FALSE(may_write({id(Space::y), 8, 8}, Model::fx1s));  // Y16 and Y17 do not exist
  EXPECT_FALSE(may_write({id(Space::tc), 0, 1}));
  EXPECT_FALSE(may_write({99, 0, 1}));
}

TEST(DeviceRange, WhatLeavesItsRangeSaysSoOfTheWhole) {
  const auto why = [](Model model, const Span& span) {
    return error_of(fx::check_range(model, span)).text;
  };
  // D8000 exists, but not as the successor of D7999.
  EXPECT_EQ(why(Model::fx3u, {id(Space::d), 7999 * 16, 32}),
            "D7999-D8000 does not exist as one range: FX3U has D0-D7999 and D8000-D8511");
  EXPECT_EQ(why(Model::fx3u, {id(Space::cn), 198 * 16, 64}),
            "CN198-CN201 does not exist as one range: FX3U has CN0-CN199 and CN200-CN255");
  EXPECT_EQ(why(Model::fx3s, {id(Space::d), 2999 * 16, 32}),
            "D2999-D3000: D3000 does not exist: FX3S has D0-D2999 and D8000-D8511");
  EXPECT_EQ(why(Model::fx3u, {id(Space::m), 7672, 16}),
            "M7672-M7687: M7680 does not exist: FX3U has M0-M7679 and M8000-M8511");
  EXPECT_EQ(why(Model::fx3u, {id(Space::d), 9000 * 16, 16}),
            "D9000 does not exist: FX3U has D0-D7999 and D8000-D8511");
}

TEST(DeviceWrite, NeverTouchesWhatStartsOrStopsThePlc) {
  for (const std::uint32_t bit : {34U, 35U, 36U, 37U, 118U})
    EXPECT_FALSE(may_write({id(Space::special_m), bit, 1})) << bit;
  EXPECT_TRUE(may_write({id(Space::special_m), 33, 1}));
  EXPECT_TRUE(may_write({id(Space::special_m), 38, 1}));
  EXPECT_TRUE(may_write({id(Space::m), 34, 1}));
  EXPECT_FALSE(may_write({id(Space::special_m), 32, 8}));
  EXPECT_FALSE(may_write({id(Space::special_m), 112, 16}));
  EXPECT_TRUE(may_write({id(Space::special_m), 40, 72}));
}

}  // namespace
}  // namespace fxagent::fx
