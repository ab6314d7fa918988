#include "tests/sim/model.h"

#include <charconv>

namespace fxsim {
namespace {

constexpr unsigned kSpecialBase = 8000;  // M8000 and D8000 begin separate rows
constexpr unsigned kFirst32BitCounter = 200;

struct Prefix {
  std::string_view text;
  Kind kind;
  int radix;
};

// Longer names come before shorter ones, so that "TN5" does not match a one-letter name.
constexpr auto kPrefixes = std::to_array<Prefix>({
    {"LSTS", Kind::lst_contact, 10},
    {"LSTC", Kind::lst_coil, 10},
    {"LSTN", Kind::lst_value, 10},
    {"co:", Kind::coil, 10},
    {"di:", Kind::discrete_input, 10},
    {"hr:", Kind::holding_register, 10},
    {"ir:", Kind::input_register, 10},
    {"STS", Kind::st_contact, 10},
    {"STC", Kind::st_coil, 10},
    {"STN", Kind::st_value, 10},
    {"LTS", Kind::lt_contact, 10},
    {"LTC", Kind::lt_coil, 10},
    {"LTN", Kind::lt_value, 10},
    {"LCS", Kind::lc_contact, 10},
    {"LCC", Kind::lc_coil, 10},
    {"LCN", Kind::lc_value, 10},
    {"TS", Kind::t_contact, 10},
    {"TC", Kind::t_coil, 10},
    {"TN", Kind::t_value, 10},
    {"CS", Kind::c_contact, 10},
    {"CC", Kind::c_coil, 10},
    {"CN", Kind::c_value, 10},
    {"LZ", Kind::lz, 10},
    {"ZR", Kind::zr, 10},
    {"RD", Kind::rd, 10},
    {"SB", Kind::sb, 16},
    {"SW", Kind::sw, 16},
    {"SM", Kind::sm, 10},
    {"SD", Kind::sd, 10},
    {"X", Kind::x, 8},
    {"Y", Kind::y, 8},
    {"X", Kind::hex_x, 16},
    {"Y", Kind::hex_y, 16},
    {"M", Kind::m, 10},
    {"S", Kind::s, 10},
    {"D", Kind::d, 10},
    {"R", Kind::r, 10},
    {"L", Kind::l, 10},
    {"F", Kind::f, 10},
    {"V", Kind::v, 10},
    {"B", Kind::b, 16},
    {"W", Kind::w, 16},
    {"Z", Kind::z, 10},
});

/// True if the family does not number its X and Y like this kind.
bool counts_otherwise(Kind kind, Family family) {
  const bool hex = family == Family::q_l || family == Family::iq_r;
  if (kind == Kind::x || kind == Kind::y) return hex;
  return (kind == Kind::hex_x || kind == Kind::hex_y) && !hex;
}

struct Sizes {
  unsigned x, y, m, special, s, t, d;  // counts from 0
  unsigned r = 0;
};

Model make_model(std::string_view name, ExtendedSet extended, std::uint16_t type_word,
                 std::uint16_t extended_type_word, Sizes sizes, Range counters16,
                 Range counters32) {
  Model model{name, extended, type_word, extended_type_word, {}, Family::fx};
  const auto put = [&model](Kind kind, std::vector<Range> ranges) {
    model.ranges[static_cast<std::size_t>(kind)] = std::move(ranges);
  };
  put(Kind::s, {{0, sizes.s - 1}});
  put(Kind::x, {{0, sizes.x - 1}});
  put(Kind::y, {{0, sizes.y - 1}});
  put(Kind::m, {{0, sizes.m - 1}});
  put(Kind::special_m, {{0, sizes.special - 1}});
  put(Kind::special_d, {{0, sizes.special - 1}});
  put(Kind::d, {{0, sizes.d - 1}});
  if (sizes.r > 0) put(Kind::r, {{0, sizes.r - 1}});
  for (const auto kind : {Kind::t_contact, Kind::t_coil, Kind::t_value})
    put(kind, {{0, sizes.t - 1}});
  for (const auto kind : {Kind::c_contact, Kind::c_coil}) put(kind, {counters16, counters32});
  put(Kind::c_value, {counters16});
  put(Kind::c_value32,
      {{counters32.first - kFirst32BitCounter, counters32.last - kFirst32BitCounter}});
  return model;
}

const std::vector<Model>& models() {
  // D8001/D8101: FX1S to FX2N and FX3G as captured; FX3U as in two emulators. FX0N and FX3S are
  // made up, as is the 0 in D8101 of FX0N, FX1S and FX1N.
  static const std::vector<Model> all = {
      make_model("FX0N", ExtendedSet::none, 20100, 0, {128, 128, 512, 256, 128, 64, 256}, {0, 31},
                 {235, 254}),
      make_model("FX1S", ExtendedSet::none, 22210, 0, {16, 14, 512, 256, 128, 64, 256}, {0, 31},
                 {235, 255}),
      make_model("FX1N", ExtendedSet::fx1n_fx2n, 26210, 0, {128, 128, 1536, 256, 1000, 256, 8000},
                 {0, 199}, {200, 255}),
      make_model("FX2N", ExtendedSet::fx1n_fx2n, 24310, 24310,
                 {184, 184, 3072, 256, 1000, 256, 8000}, {0, 199}, {200, 255}),
      make_model("FX3S", ExtendedSet::fx3, 28100, 28100, {128, 128, 1536, 512, 256, 138, 3000},
                 {0, 199}, {200, 255}),
      make_model("FX3G", ExtendedSet::fx3, 26231, 26231,
                 {128, 128, 7680, 512, 4096, 320, 8000, 24000}, {0, 199}, {200, 255}),
      make_model("FX3U", ExtendedSet::fx3, 24232, 16232,
                 {256, 256, 7680, 512, 4096, 512, 8000, 32768}, {0, 199}, {200, 255}),
  };
  return all;
}

}  // namespace

unsigned width(Kind kind) {
  switch (kind) {
    case Kind::t_value:
    case Kind::c_value:
    case Kind::d:
    case Kind::special_d:
    case Kind::r:
    case Kind::holding_register:
    case Kind::input_register:
    case Kind::w:
    case Kind::sw:
    case Kind::sd:
    case Kind::z:
    case Kind::zr:
    case Kind::rd:
    case Kind::st_value:
      return 16;
    case Kind::c_value32:
    case Kind::lt_value:
    case Kind::lst_value:
    case Kind::lc_value:
    case Kind::lz:
      return 32;
    default:
      return 1;
  }
}

const Model* find_model(std::string_view name) {
  for (const auto& model : models())
    if (model.name == name) return &model;
  return nullptr;
}

const Model& modbus_model() {
  static const Model model = [] {
    Model made{"Modbus", ExtendedSet::none, 0, 0, {}, Family::modbus};
    for (const auto kind :
         {Kind::coil, Kind::discrete_input, Kind::holding_register, Kind::input_register})
      made.ranges[static_cast<std::size_t>(kind)] = {{0, 0xFFFF}};
    return made;
  }();
  return model;
}

std::string model_names() {
  std::string names;
  for (const auto& model : models()) names.append(names.empty() ? "" : " ").append(model.name);
  return names;
}

Device fx_device(Kind kind, unsigned number) {
  if (kind == Kind::c_value && number >= kFirst32BitCounter)
    return {Kind::c_value32, number - kFirst32BitCounter};
  if (kind == Kind::m && number >= kSpecialBase) return {Kind::special_m, number - kSpecialBase};
  if (kind == Kind::d && number >= kSpecialBase) return {Kind::special_d, number - kSpecialBase};
  return {kind, number};
}

std::optional<Device> parse_device(std::string_view text, Family family) {
  for (const auto& prefix : kPrefixes) {
    if (!text.starts_with(prefix.text) || counts_otherwise(prefix.kind, family)) continue;
    const auto digits = text.substr(prefix.text.size());
    unsigned number = 0;
    const auto* end = digits.data() + digits.size();
    const auto [rest, error] = std::from_chars(digits.data(), end, number, prefix.radix);
    if (digits.empty() || error != std::errc{} || rest != end) return std::nullopt;
    return family == Family::fx ? fx_device(prefix.kind, number) : Device{prefix.kind, number};
  }
  return std::nullopt;
}

std::string device_name(Device device) {
  unsigned number = device.number;
  auto kind = device.kind;
  if (kind == Kind::special_m || kind == Kind::special_d) {
    number += kSpecialBase;
    kind = kind == Kind::special_m ? Kind::m : Kind::d;
  } else if (kind == Kind::c_value32) {
    number += kFirst32BitCounter;
    kind = Kind::c_value;
  }
  for (const auto& prefix : kPrefixes) {
    if (prefix.kind != kind) continue;
    std::array<char, 16> digits{};
    const auto end =
        std::to_chars(digits.data(), digits.data() + digits.size(), number, prefix.radix).ptr;
    return std::string(prefix.text) + std::string(digits.data(), end);
  }
  return {};
}

}  // namespace fxsim
