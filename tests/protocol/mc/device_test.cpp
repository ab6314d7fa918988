#include "protocol/mc/device.h"

#include <gtest/gtest.h>

#include "protocol/catalog.h"
#include "tests/support/says.h"

namespace fxagent::mc {
namespace {

using test::error_of;
using test::expect_says;

Address address(Model model, std::string_view text, std::optional<DataType> type = {}) {
  const auto parsed = parse_address(model, text, type);
  EXPECT_TRUE(parsed.has_value()) << text << ": " << (parsed ? "" : parsed.error().text);
  return parsed.value_or(Address{});
}

std::string refusal(Model model, std::string_view text, std::optional<DataType> type = {}) {
  SCOPED_TRACE(text);
  const Error error = error_of(parse_address(model, text, type));
  EXPECT_EQ(error.code, ErrorCode::bad_request);
  return error.text;
}

std::string range_refusal(std::string_view text, Model model = Model::fx5u) {
  SCOPED_TRACE(text);
  return error_of(parse_range(model, text)).text;
}

constexpr Model kAll[] = {Model::unknown, Model::unknown_fx, Model::fx3u,    Model::fx3g,
                          Model::fx5u,    Model::fx5uj,      Model::fx5s,    Model::q,
                          Model::l,       Model::iq_r,       Model::q_by_1e, Model::l_by_1e};

TEST(McDevice, NamesBecomePlacesInTheirSpace) {
  struct Case {
    Model model;
    const char* text;
    const char* canonical;
    Span span;
    Unit unit;
  };
  const Case cases[] = {
      {Model::fx5u, "X17", "X17", {id(Space::x), 15, 1}, Unit::bit},
      {Model::q, "X17", "X17", {id(Space::x), 0x17, 1}, Unit::bit},
      {Model::fx5u, "Y100", "Y100", {id(Space::y), 64, 1}, Unit::bit},
      {Model::iq_r, "Y1F", "Y1F", {id(Space::y), 31, 1}, Unit::bit},
      {Model::iq_r, "y0a0", "YA0", {id(Space::y), 0xA0, 1}, Unit::bit},
      {Model::unknown, "X7", "X7", {id(Space::x), 7, 1}, Unit::bit},
      {Model::l, "DX1F", "DX1F", {id(Space::dx), 31, 1}, Unit::bit},
      {Model::fx5u, "M32767", "M32767", {id(Space::m), 32767, 1}, Unit::bit},
      {Model::fx5u, "M8000", "M8000", {id(Space::m), 8000, 1}, Unit::bit},
      {Model::fx3u, "M8000", "M8000", {id(Space::special_m), 0, 1}, Unit::bit},
      {Model::fx3u, "D8010", "D8010", {id(Space::special_d), 160, 16}, Unit::word},
      {Model::fx5u, "L100", "L100", {id(Space::l), 100, 1}, Unit::bit},
      {Model::fx5u, "F7", "F7", {id(Space::f), 7, 1}, Unit::bit},
      {Model::q, "V7", "V7", {id(Space::v), 7, 1}, Unit::bit},
      {Model::fx5u, "BF", "BF", {id(Space::b), 15, 1}, Unit::bit},
      {Model::q, "BB0", "BB0", {id(Space::b), 0xB0, 1}, Unit::bit},
      {Model::fx5u, "SB1F", "SB1F", {id(Space::sb), 31, 1}, Unit::bit},
      {Model::fx5u, "S10", "S10", {id(Space::s), 10, 1}, Unit::bit},
      {Model::fx5u, "SM400", "SM400", {id(Space::sm), 400, 1}, Unit::bit},
      {Model::fx5u, "SD203", "SD203", {id(Space::sd), 203 * 16, 16}, Unit::word},
      {Model::fx5u, "D7999", "D7999", {id(Space::d), 7999 * 16, 16}, Unit::word},
      {Model::fx5u, "W1FF", "W1FF", {id(Space::w), 0x1FF * 16, 16}, Unit::word},
      {Model::q, "SWFF", "SWFF", {id(Space::sw), 0xFF * 16, 16}, Unit::word},
      {Model::fx5u, "R100", "R100", {id(Space::r), 1600, 16}, Unit::word},
      {Model::q, "ZR100000", "ZR100000", {id(Space::zr), 1600000, 16}, Unit::word},
      {Model::q, "Z19", "Z19", {id(Space::z), 19 * 16, 16}, Unit::word},
      {Model::iq_r, "RD5", "RD5", {id(Space::rd), 80, 16}, Unit::word},
      {Model::q, "TS5", "TS5", {id(Space::ts), 5, 1}, Unit::bit},
      {Model::q, "TC5", "TC5", {id(Space::tc), 5, 1}, Unit::bit},
      {Model::q, "TN5", "TN5", {id(Space::tn), 80, 16}, Unit::word},
      {Model::fx5u, "STS5", "STS5", {id(Space::sts), 5, 1}, Unit::bit},
      {Model::fx5u, "STC5", "STC5", {id(Space::stc), 5, 1}, Unit::bit},
      {Model::fx5u, "STN5", "STN5", {id(Space::stn), 80, 16}, Unit::word},
      {Model::fx5u, "CS5", "CS5", {id(Space::cs), 5, 1}, Unit::bit},
      {Model::fx5u, "CC5", "CC5", {id(Space::cc), 5, 1}, Unit::bit},
      {Model::fx5u, "CN200", "CN200", {id(Space::cn), 3200, 16}, Unit::word},
      {Model::fx3u, "CN199", "CN199", {id(Space::cn), 199 * 16, 16}, Unit::word},
      {Model::fx3u, "CN200", "CN200", {id(Space::cn32), 0, 32}, Unit::dword},
      {Model::fx3u, "CN255", "CN255", {id(Space::cn32), 55 * 32, 32}, Unit::dword},
      {Model::fx3u, "CS255", "CS255", {id(Space::cs), 255, 1}, Unit::bit},
      {Model::fx5u, "LCS5", "LCS5", {id(Space::lcs), 5, 1}, Unit::bit},
      {Model::fx5u, "LCN5", "LCN5", {id(Space::lcn), 160, 32}, Unit::long_count},
      {Model::iq_r, "LTN5", "LTN5", {id(Space::ltn), 160, 32}, Unit::long_count},
      {Model::iq_r, "LSTN5", "LSTN5", {id(Space::lstn), 160, 32}, Unit::long_count},
      {Model::fx5u, "LZ1", "LZ1", {id(Space::lz), 32, 32}, Unit::long_index},
      {Model::fx5u, "D100.F", "D100.F", {id(Space::d), 1615, 1}, Unit::word_bit},
      {Model::q, "W1F.a", "W1F.A", {id(Space::w), 31 * 16 + 10, 1}, Unit::word_bit},
      {Model::q, "ZR1.0", "ZR1.0", {id(Space::zr), 16, 1}, Unit::word_bit},
      {Model::fx5u, "SD0.1", "SD0.1", {id(Space::sd), 1, 1}, Unit::word_bit},
      {Model::fx5u, "K4M0", "K4M0", {id(Space::m), 0, 16}, Unit::bit_group},
      {Model::fx5u, "K1Y10", "K1Y10", {id(Space::y), 8, 4}, Unit::bit_group},
      {Model::q, "k2y10", "K2Y10", {id(Space::y), 16, 8}, Unit::bit_group},
      {Model::q, "K8BF0", "K8BF0", {id(Space::b), 0xF0, 32}, Unit::bit_group},
      {Model::fx3u, "K8M8000", "K8M8000", {id(Space::special_m), 0, 32}, Unit::bit_group},
  };
  for (const Case& c : cases) {
    const Address a = address(c.model, c.text);
    EXPECT_EQ(a.text, c.canonical);
    EXPECT_EQ(a.span, c.span) << c.text;
    EXPECT_EQ(a.unit, c.unit) << c.text;
    EXPECT_EQ(a.writable, c.unit != Unit::word_bit) << c.text;
    EXPECT_EQ(device_name(c.model, a.span).substr(0, 1), a.unit == Unit::bit_group
                                                             ? std::string(1, c.canonical[2])
                                                             : std::string(1, c.canonical[0]));
  }
}

TEST(McDevice, TimersAndCountersAreTheContactAsBoolAndTheValueOtherwise) {
  EXPECT_EQ(address(Model::fx5u, "T5", DataType::boolean).text, "TS5");
  EXPECT_EQ(address(Model::fx5u, "T5", DataType::int16).text, "TN5");
  EXPECT_EQ(address(Model::fx5u, "ST5", DataType::boolean).text, "STS5");
  EXPECT_EQ(address(Model::fx5u, "st5").text, "STN5");
  EXPECT_EQ(address(Model::q, "C5").text, "CN5");
  EXPECT_EQ(address(Model::fx5u, "LC5").text, "LCN5");
  EXPECT_EQ(address(Model::fx5u, "LC5", DataType::boolean).text, "LCS5");
  EXPECT_EQ(address(Model::iq_r, "LT5").text, "LTN5");
  expect_says(refusal(Model::iq_r, "LST5", DataType::boolean), "contact of a long timer");
  for (const char* text : {"T5", "c005", "ST0", "LC1"}) EXPECT_TRUE(needs_type(text)) << text;
  for (const char* text : {"TN5", "TS5", "D5", "LT5", "K4M0", "Q5", ""})
    EXPECT_FALSE(needs_type(text)) << text;
}

TEST(McDevice, LongCountersAndTimersCountFrom0WhereNoTypeIsNamed) {
  const auto types = [](Model model, std::string_view text) {
    Point point{.address = address(model, text)};
    std::string words(to_string(default_type(point.address)));
    for (const DataType type : {DataType::int32, DataType::uint32, DataType::float32}) {
      point.type = type;
      if (span_of(point)) words.append(" ").append(to_string(type));
    }
    return words;
  };
  for (const char* text : {"LCN5", "LC5", "LTN5", "LSTN5"})
    EXPECT_EQ(types(Model::iq_r, text), "uint32 int32 uint32") << text;
  EXPECT_EQ(types(Model::fx5u, "LCN5"), "uint32 int32 uint32");
  EXPECT_EQ(types(Model::fx5u, "LZ0"), "int32 int32 uint32");
  EXPECT_EQ(types(Model::fx3u, "CN200"), "int32 int32");
}

TEST(McDevice, ARefusedTypeOfALongCounterNamesThoseThatItHas) {
  Point point{.address = address(Model::fx5u, "LCN5"), .type = DataType::float32};
  EXPECT_EQ(span_of(point).error().text,
            "LCN5 cannot be read as float32; its type must be uint32 or int32");
  point.address = address(Model::fx5u, "LZ0");
  EXPECT_EQ(span_of(point).error().text,
            "LZ0 cannot be read as float32; its type must be int32 or uint32");
}

TEST(McDevice, XAndYAreOctalOnFxHexadecimalElsewhereAndUnknownUntilTheModelIs) {
  EXPECT_EQ(refusal(Model::fx5u, "X8"),
            "X8 does not exist: X of FX5U is numbered in octal, after X7 comes X10");
  EXPECT_EQ(refusal(Model::fx3u, "Y1F"),
            "Y1F does not exist: Y of FX3U is numbered in octal, after Y17 comes Y20");
  EXPECT_EQ(ascii_base_of(Model::fx5s, Space::x), 8U);
  EXPECT_EQ(ascii_base_of(Model::fx5s, Space::b), 16U);
  EXPECT_EQ(ascii_base_of(Model::q, Space::y), 16U);
  EXPECT_EQ(device_name(Model::q, Space::zr, 10), "ZR10");
  for (const char* text : {"X8", "X10", "Y1F", "K4X10"})
    expect_says(refusal(Model::unknown, text), "`model` must be set");
  EXPECT_EQ(address(Model::unknown, "Y007").text, "Y7");
  EXPECT_EQ(address(Model::unknown_fx, "X17").span.first_bit, 15U);
}

TEST(McDevice, NonsenseIsRefusedWithTheFormsThatExist) {
  for (const char* text : {"", "Q5", "100", "D1OO", " D1", "D1 ", "-1", "D", "D-1", "M1F", "LTS5"})
    expect_says(refusal(Model::fx5u, text), "the forms are");
  expect_says(refusal(Model::q, "D12345678901"), "too large");
  for (const char* text : {"D100.G", "D100.", "D100.10", "M100.1", "K4D100.1", "TN5.0"})
    expect_says(refusal(Model::fx5u, text), "D100.0 to D100.F");
  for (const char* text : {"K0M0", "K9M0", "K10M0"})
    expect_says(refusal(Model::fx5u, text), "K1 to K8");
  for (const char* text : {"K4D0", "K4TS0", "K4CN0", "K4T0"})
    expect_says(refusal(Model::fx5u, text), "a group is made of");
}

TEST(McDevice, ARefusalQuotesTheNameAsItWasWritten) {
  const std::pair<const char*, std::string_view> cases[] = {
      {"q5", "'q5' is not a device of the MC protocol"},
      {"k9m0", "k9m0: "},
      {"d1.g", "'d1.g': "},
      {"k4d0", "k4d0: "},
      {"x8", "x8 does not exist: X of FX5U is numbered in octal"}};
  for (const auto& [text, beginning] : cases) {
    const std::string said = refusal(Model::fx5u, text);
    EXPECT_TRUE(said.starts_with(beginning)) << said;
  }
  for (const char* text : {"m100-k4m0", "t0-t5", "m0-d5", "m9-m0"}) {
    EXPECT_TRUE(range_refusal(text).starts_with(text)) << range_refusal(text);
  }
}

TEST(McDevice, TheNameBeyondTheLastIsRefused) {
  struct Case {
    Model model;
    const char* last;
    const char* beyond;
  };
  const Case cases[] = {
      {Model::fx3u, "D7999", "D8512"},       {Model::fx3u, "T511", "T512"},
      {Model::fx3u, "M7679", "M7680"},       {Model::fx5uj, "SD11999", "SD12000"},
      {Model::fx5s, "M32767", "M32768"},     {Model::fx5u, "LC1023", "LC1024"},
      {Model::l, "SM2047", "SM2048"},        {Model::unknown, "SD11999", "SD12000"},
      {Model::fx5u, "K4M32752", "K4M32756"},
  };
  for (const Case& c : cases) {
    address(c.model, c.last);
    expect_says(refusal(c.model, c.beyond), "does not exist");
  }
}

// A number that overflows 32 bits must not become a small one.
TEST(McDevice, NumbersThatNoSpaceHasAreNeverOthers) {
  struct Case {
    Model model;
    const char* name;
  };
  for (const Case& c : {Case{Model::fx5u, "LCN134217733"}, Case{Model::iq_r, "LTN134217728"},
                        Case{Model::iq_r, "LSTN134217728"}, Case{Model::fx5u, "LZ134217728"},
                        Case{Model::fx3u, "CN134217928"}, Case{Model::iq_r, "LCN268435455"},
                        Case{Model::iq_r, "D268435455"}, Case{Model::iq_r, "K8M268435455"}}) {
    expect_says(refusal(c.model, c.name), "does not exist");
    EXPECT_FALSE(parse_range(c.model, c.name)) << c.name;
  }
  EXPECT_FALSE(parse_range(Model::fx5u, "LCN0-LCN134217727"));
  EXPECT_FALSE(parse_range(Model::iq_r, "LTN0-LTN134217728"));
}

TEST(McDevice, ARefusalNamesTheModelAndItsRanges) {
  EXPECT_EQ(refusal(Model::fx3u, "M7680"),
            "M7680 does not exist: FX3U has M0-M7679 and M8000-M8511");
  EXPECT_EQ(refusal(Model::fx5u, "D8000"), "D8000 does not exist: FX5U has D0-D7999");
  EXPECT_EQ(refusal(Model::fx5u, "ZR0"), "ZR0 does not exist: FX5U has no ZR");
  EXPECT_EQ(refusal(Model::fx3u, "LZ0"), "LZ0 does not exist: FX3U has no LZ");
  expect_says(refusal(Model::unknown, "SD12000"), "the widest model has SD0-SD11999");
}

TEST(McDevice, EveryDeviceIsReadBackFromItsOwnName) {
  for (const Model model : kAll) {
    for (std::uint16_t i = 0; i < kSpaces; ++i) {
      const auto space = static_cast<Space>(i);
      const auto runs = numbers_of(model, space);
      if (runs.empty()) continue;
      const Numbers numbers = runs.front();
      const std::uint32_t step = (numbers.last - numbers.first) / 500 + 1;
      for (std::uint32_t n = numbers.first; n <= numbers.last; n += step) {
        const std::string name = device_name(model, space, n);
        const auto parsed = parse_address(model, name, std::nullopt);
        if (!parsed && model == Model::unknown && (space == Space::x || space == Space::y)) break;
        ASSERT_TRUE(parsed) << name << " " << parsed.error().text;
        ASSERT_EQ(parsed->span, span_of(space, {n, n})) << name;
        ASSERT_EQ(device_name(model, parsed->span), parsed->text);
      }
    }
  }
}

// Codes: SH-080008 for 3E and C frames, in ASCII also those of iQ-R; JY997D45801 for 1E.
// Last devices: JY997D45801 (FX3U and FX3G by 1E), and the performance tables of the FX5 user's
// manual (application), the QnUCPU user's manual and the MELSEC iQ-R CPU module user's manual.
TEST(McDevice, EachKindHasTheCodesAndTheLastDeviceOfTheManuals) {
  struct Kind {
    Space space;
    const char* letters;
    int binary;
    const char* ascii;
    const char* long_ascii;
    int one_e;
    const char* last[5];  // FX3U, FX3G, FX5, Q and L, iQ-R; empty: not available
  };
  const Kind kinds[] = {
      {Space::x, "X", 0x9C, "X*", "X***", 0x5820, {"377", "177", "1777", "1FFF", "2FFF"}},
      {Space::y, "Y", 0x9D, "Y*", "Y***", 0x5920, {"377", "177", "1777", "1FFF", "2FFF"}},
      {Space::dx, "DX", 0xA2, "DX", "DX**", 0, {"", "", "", "FFF", "2FFF"}},
      {Space::dy, "DY", 0xA3, "DY", "DY**", 0, {"", "", "", "FFF", "2FFF"}},
      {Space::m, "M", 0x90, "M*", "M***", 0x4D20, {"7679", "7679", "32767", "61439", "161882111"}},
      {Space::special_m, "M", 0x90, "M*", "", 0x4D20, {"8511", "8511", "", "", ""}},
      {Space::l, "L", 0x92, "L*", "L***", 0, {"", "", "32767", "32767", "32767"}},
      {Space::f, "F", 0x93, "F*", "F***", 0x4620, {"", "", "32767", "32767", "32767"}},
      {Space::v, "V", 0x94, "V*", "V***", 0, {"", "", "", "32767", "32767"}},
      {Space::b, "B", 0xA0, "B*", "B***", 0x4220, {"", "", "7FFF", "EFFF", "9A61FFF"}},
      {Space::sb, "SB", 0xA1, "SB", "SB**", 0, {"", "", "7FFF", "7FFF", "9A61FFF"}},
      {Space::s, "S", 0x98, "S*", "S***", 0x5320, {"4095", "4095", "4095", "8191", "16383"}},
      {Space::sm, "SM", 0x91, "SM", "SM**", 0, {"", "", "9999", "2047", "4095"}},
      {Space::ts, "TS", 0xC1, "TS", "TS**", 0x5453, {"511", "319", "1023", "32767", "8993439"}},
      {Space::tc, "TC", 0xC0, "TC", "TC**", 0x5443, {"511", "319", "1023", "32767", "8993439"}},
      {Space::tn, "TN", 0xC2, "TN", "TN**", 0x544E, {"511", "319", "1023", "32767", "8993439"}},
      {Space::sts, "STS", 0xC7, "SS", "STS*", 0, {"", "", "1023", "32767", "8993439"}},
      {Space::stc, "STC", 0xC6, "SC", "STC*", 0, {"", "", "1023", "32767", "8993439"}},
      {Space::stn, "STN", 0xC8, "SN", "STN*", 0, {"", "", "1023", "32767", "8993439"}},
      {Space::cs, "CS", 0xC4, "CS", "CS**", 0x4353, {"255", "255", "1023", "32767", "8993439"}},
      {Space::cc, "CC", 0xC3, "CC", "CC**", 0x4343, {"255", "255", "1023", "32767", "8993439"}},
      {Space::cn, "CN", 0xC5, "CN", "CN**", 0x434E, {"199", "199", "1023", "32767", "8993439"}},
      {Space::cn32, "CN", 0xC5, "CN", "", 0x434E, {"255", "255", "", "", ""}},
      {Space::lcs, "LCS", 0x55, "", "LCS*", 0, {"", "", "1023", "", "4761119"}},
      {Space::lcc, "LCC", 0x54, "", "LCC*", 0, {"", "", "1023", "", "4761119"}},
      {Space::lcn, "LCN", 0x56, "", "LCN*", 0, {"", "", "1023", "", "4761119"}},
      {Space::ltn, "LTN", 0x52, "", "LTN*", 0, {"", "", "", "", "2529407"}},
      {Space::lstn, "LSTN", 0x5A, "", "LSTN", 0, {"", "", "", "", "2529407"}},
      {Space::d, "D", 0xA8, "D*", "D***", 0x4420, {"7999", "7999", "7999", "4184063", "10117631"}},
      {Space::special_d, "D", 0xA8, "D*", "", 0x4420, {"8511", "8511", "", "", ""}},
      {Space::w, "W", 0xB4, "W*", "W***", 0x5720, {"", "", "7FFF", "3FD7FF", "9A61FF"}},
      {Space::sw, "SW", 0xB5, "SW", "SW**", 0, {"", "", "7FFF", "7FFF", "9A61FF"}},
      {Space::sd, "SD", 0xA9, "SD", "SD**", 0, {"", "", "11999", "2047", "4095"}},
      {Space::r, "R", 0xAF, "R*", "R***", 0x5220, {"32767", "23999", "32767", "32767", "32767"}},
      {Space::zr, "ZR", 0xB0, "ZR", "ZR**", 0, {"", "", "", "4184063", "10027007"}},
      {Space::rd, "RD", 0x2C, "", "RD**", 0, {"", "", "", "", "524287"}},
      {Space::z, "Z", 0xCC, "Z*", "Z***", 0, {"", "", "23", "19", "23"}},
      {Space::lz, "LZ", 0x62, "", "LZ**", 0, {"", "", "11", "", "11"}},
  };
  constexpr Model kModels[] = {Model::fx3u, Model::fx3g, Model::fx5u, Model::q, Model::iq_r};
  ASSERT_EQ(std::size(kinds), kSpaces);
  for (const Kind& kind : kinds) {
    const std::string letters = kind.letters;
    EXPECT_EQ(kind_of(kind.space).letters, letters);
    EXPECT_EQ(kind_of(kind.space).binary, kind.binary) << letters;
    EXPECT_EQ(kind_of(kind.space).ascii, kind.ascii) << letters;
    EXPECT_EQ(kind_of(kind.space).one_e, kind.one_e) << letters;
    if (*kind.long_ascii != '\0') {  // otherwise a code identifies the previous space
      EXPECT_EQ(space_coded(static_cast<std::uint8_t>(kind.binary)), kind.space) << letters;
      EXPECT_EQ(space_coded(std::string_view(kind.long_ascii)), kind.space) << letters;
      if (*kind.ascii != '\0') {
        EXPECT_EQ(space_coded(std::string_view(kind.ascii)), kind.space) << letters;
      }
      if (kind.one_e != 0) {
        EXPECT_EQ(space_coded_1e(static_cast<std::uint16_t>(kind.one_e)), kind.space) << letters;
      }
    }
    for (std::size_t i = 0; i < std::size(kModels); ++i) {
      const std::string name = letters + kind.last[i];
      const auto runs = numbers_of(kModels[i], kind.space);
      ASSERT_EQ(runs.empty(), *kind.last[i] == '\0') << to_string(kModels[i]) << name;
      if (runs.empty()) continue;
      const std::uint32_t number = runs.front().last;
      EXPECT_EQ(device_name(kModels[i], kind.space, number), name) << to_string(kModels[i]);
      const Span last = span_of(kind.space, {number, number});
      EXPECT_EQ(address(kModels[i], name).span, last) << name;
      EXPECT_FALSE(check_range(kModels[i], {last.space, last.first_bit, last.bits + 1})) << name;
    }
  }
}

TEST(McDevice, CodesOfNothingAreNone) {
  EXPECT_EQ(space_coded(std::uint8_t{0x87}), std::nullopt);
  for (const char* none : {"", "Q*", "D", "D**", "ST**", "D*10"})
    EXPECT_EQ(space_coded(std::string_view(none)), std::nullopt) << none;
  EXPECT_EQ(space_coded_1e(0), std::nullopt);
}

TEST(McDevice, ModelNamesAreKnownByTheirExactSpelling) {
  for (const ProtocolInfo& protocol : catalog()) {
    for (const std::string_view name : protocol.models) {
      ASSERT_TRUE(model_named(name)) << name;
      EXPECT_EQ(to_string(*model_named(name)), name);
    }
    for (const std::string_view name : protocol.kin) EXPECT_TRUE(model_named(name)) << name;
  }
  EXPECT_EQ(to_string(*model_named("FX5UC")), "FX5U");
  EXPECT_EQ(to_string(*model_named("FX3UC")), "FX3U");
  EXPECT_EQ(model_named("auto"), std::nullopt);
  EXPECT_EQ(to_string(Model::unknown), "");
  EXPECT_EQ(to_string(Model::unknown_fx), "");
  EXPECT_EQ(series_of(Model::fx5uj), Series::iq_f);
  EXPECT_EQ(series_of(Model::l), Series::q_l);
}

TEST(McDeviceRange, CoversBothEndsAndSaysWhatIsWrong) {
  EXPECT_EQ(parse_range(Model::fx5u, "M100-M199"), (Span{id(Space::m), 100, 100}));
  EXPECT_EQ(parse_range(Model::fx5u, "Y0..Y17"), (Span{id(Space::y), 0, 16}));
  EXPECT_EQ(parse_range(Model::q, "W0-W1F"), (Span{id(Space::w), 0, 32 * 16}));
  EXPECT_EQ(parse_range(Model::q, "W0 .. 1F"), (Span{id(Space::w), 0, 32 * 16}));
  EXPECT_EQ(parse_range(Model::q, "WA0-100"), (Span{id(Space::w), 0xA0 * 16, 97 * 16}));
  expect_says(error_of(parse_range(Model::q, "XA0-10")).text, "ends before it begins");
  EXPECT_EQ(parse_range(Model::fx3u, "CN200-CN210"), (Span{id(Space::cn32), 0, 352}));
  EXPECT_EQ(parse_range(Model::iq_r, "LTN5"), (Span{id(Space::ltn), 160, 32}));
  expect_says(range_refusal("M100-D199"), "one kind");
  expect_says(range_refusal("M7000-M8010", Model::fx3u), "one kind");
  expect_says(range_refusal("M199-M100"), "ends before it begins");
  expect_says(range_refusal("T0-T9"), "TN for the values or TS for the contacts");
  expect_says(range_refusal("LT0", Model::iq_r), "LTN for the values");
  expect_says(range_refusal("K4M0-K4M16"), "plain device");
  expect_says(range_refusal("D0.1"), "plain device");
  expect_says(range_refusal("M100-"), "the forms are");
  expect_says(range_refusal("D0-D8000"), "does not exist");
  expect_says(range_refusal("M8030-M8040", Model::fx3u), "cannot be written by address");
  expect_says(range_refusal("SM8037"), "cannot be written by address");
}

TEST(McDeviceRange, SpansThatRunPastTheLastDeviceAreNamed) {
  EXPECT_TRUE(check_range(Model::fx5u, {id(Space::d), 7999 * 16, 16}));
  EXPECT_EQ(error_of(check_range(Model::fx5u, {id(Space::d), 7999 * 16, 32})).text,
            "D7999-D8000: D8000 does not exist: FX5U has D0-D7999");
  EXPECT_FALSE(check_range(Model::fx5u, {id(Space::d), 8000 * 16, 16}));
  EXPECT_FALSE(check_range(Model::fx5u, {id(Space::zr), 0, 16}));
  EXPECT_FALSE(check_range(Model::fx5u, {kSpaces, 0, 1}));
  EXPECT_FALSE(check_range(Model::iq_r, {id(Space::d), 0xFFFFFFF0, 0xFFFFFFFF}));
  EXPECT_EQ(device_name(Model::q, {99, 0, 1}), "space 99");
}

TEST(McDeviceWrite, AnyBitsOfABitDeviceAndWholeDevicesOfOthers) {
  EXPECT_TRUE(check_write(Model::fx5u, {id(Space::m), 3, 5}));
  EXPECT_TRUE(check_write(Model::fx5u, {id(Space::d), 16, 32}));
  EXPECT_TRUE(check_write(Model::fx5u, {id(Space::lcn), 32, 32}));
  EXPECT_FALSE(check_write(Model::fx5u, {id(Space::d), 3, 1}));
  EXPECT_FALSE(check_write(Model::fx5u, {id(Space::lcn), 16, 16}));
  EXPECT_FALSE(check_write(Model::fx5u, {id(Space::m), 3, 0}));
  EXPECT_FALSE(check_write(Model::fx3u, {id(Space::special_m), 30, 5}));
  EXPECT_FALSE(check_write(Model::fx5u, {id(Space::sm), 8034, 1}));
  EXPECT_TRUE(check_write(Model::fx5u, {id(Space::m), 8034, 1}));
  EXPECT_FALSE(check_write(Model::fx5u, {id(Space::m), 32760, 16}));
}

TEST(McDeviceWrite, RelaysThatStartAndStopAnFxAreNeverWritten) {
  constexpr std::uint32_t kRunMode = 34;  // M8034 to M8037; on FX5 SM8034 to SM8037
  for (std::uint32_t i = kRunMode - 1; i <= kRunMode + 4; ++i) {
    const bool may = i < kRunMode || i == kRunMode + 4;
    EXPECT_EQ(check_write(Model::fx3u, {id(Space::special_m), i, 1}).has_value(), may) << i;
    EXPECT_EQ(check_write(Model::fx5u, {id(Space::sm), 8000 + i, 1}).has_value(), may) << i;
  }
}

}  // namespace
}  // namespace fxagent::mc
