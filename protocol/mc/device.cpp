#include "protocol/mc/device.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <span>

#include "protocol/letter_case.h"
#include "protocol/range_ends.h"

namespace fxagent::mc {
namespace {

/// A further name of a model.
struct Kin {
  std::string_view name;
  Model model;
};
constexpr std::array<Kin, 6> kKin = {{{"FX1NC", Model::fx1n},
                                      {"FX2NC", Model::fx2n},
                                      {"FX3GC", Model::fx3g},
                                      {"FX3GE", Model::fx3g},
                                      {"FX3UC", Model::fx3u},
                                      {"FX5UC", Model::fx5u}}};

constexpr auto kDec = Numbering::decimal;
constexpr auto kHex = Numbering::hexadecimal;
constexpr auto kOct = Numbering::octal_on_fx;
constexpr std::uint32_t kSpecial = 8000;
constexpr std::uint32_t kLong = 200;
constexpr std::uint32_t kSmallLong = 235;  // FX0N and FX1S: none between these and the 16-bit ones

// SH-080008 for 3E and C frames, JY997D45801 for 1E; code 98 of S as measured on PLCs.
constexpr std::array<DeviceKind, kSpaces> kKinds = {{
    {"X", 0x9C, "X*", 0x5820, kOct, 1, 0},
    {"Y", 0x9D, "Y*", 0x5920, kOct, 1, 0},
    {"DX", 0xA2, "DX", 0, kHex, 1, 0},
    {"DY", 0xA3, "DY", 0, kHex, 1, 0},
    {"M", 0x90, "M*", 0x4D20, kDec, 1, 0},
    {"M", 0x90, "M*", 0x4D20, kDec, 1, kSpecial},
    {"L", 0x92, "L*", 0, kDec, 1, 0},
    {"F", 0x93, "F*", 0x4620, kDec, 1, 0},
    {"V", 0x94, "V*", 0, kDec, 1, 0},
    {"B", 0xA0, "B*", 0x4220, kHex, 1, 0},
    {"SB", 0xA1, "SB", 0, kHex, 1, 0},
    {"S", 0x98, "S*", 0x5320, kDec, 1, 0},
    {"SM", 0x91, "SM", 0, kDec, 1, 0},
    {"TS", 0xC1, "TS", 0x5453, kDec, 1, 0},
    {"TC", 0xC0, "TC", 0x5443, kDec, 1, 0},
    {"TN", 0xC2, "TN", 0x544E, kDec, 16, 0},
    {"STS", 0xC7, "SS", 0, kDec, 1, 0},
    {"STC", 0xC6, "SC", 0, kDec, 1, 0},
    {"STN", 0xC8, "SN", 0, kDec, 16, 0},
    {"CS", 0xC4, "CS", 0x4353, kDec, 1, 0},
    {"CC", 0xC3, "CC", 0x4343, kDec, 1, 0},
    {"CN", 0xC5, "CN", 0x434E, kDec, 16, 0},
    {"CN", 0xC5, "CN", 0x434E, kDec, 32, kLong, Unit::dword},
    {"LCS", 0x55, "", 0, kDec, 1, 0},
    {"LCC", 0x54, "", 0, kDec, 1, 0},
    {"LCN", 0x56, "", 0, kDec, 32, 0, Unit::long_count},
    {"LTN", 0x52, "", 0, kDec, 32, 0, Unit::long_count},
    {"LSTN", 0x5A, "", 0, kDec, 32, 0, Unit::long_count},
    {"D", 0xA8, "D*", 0x4420, kDec, 16, 0},
    {"D", 0xA8, "D*", 0x4420, kDec, 16, kSpecial},
    {"W", 0xB4, "W*", 0x5720, kHex, 16, 0},
    {"SW", 0xB5, "SW", 0, kHex, 16, 0},
    {"SD", 0xA9, "SD", 0, kDec, 16, 0},
    {"R", 0xAF, "R*", 0x5220, kDec, 16, 0},
    {"ZR", 0xB0, "ZR", 0, kDec, 16, 0},
    {"RD", 0x2C, "", 0, kDec, 16, 0},
    {"Z", 0xCC, "Z*", 0, kDec, 16, 0},
    {"LZ", 0x62, "", 0, kDec, 32, 0, Unit::long_index},
}};

/// Number of devices, including those before the first number of the space.
struct Counts {
  std::uint32_t fx0n = 0, fx1s = 0, fx1n = 0, fx2n = 0, fx3s = 0, fx3g = 0, fx3u = 0;
  std::uint32_t iq_f = 0, q_l = 0, by_1e = 0, iq_r = 0;
};
// FX0N to FX2N: JY992D69901, 7.7.2. FX3G and FX3U: tables of JY997D45801 and JY997D18101. DX and DY
// of Q and L: as ascii_base_of(). The others are from product knowledge, unverified; FX5UJ and FX5S
// have the ranges of the FX5U. An iQ-R has at most 10117632 words of device memory; each count
// assumes that all are of one kind. by_1e: the devices of a Q or L that 1E frames reach, Q03UD(E)
// user's manual, 5.1.2, without D9000 and M9000 up, which 1E maps to SD1000 and SM1000 up; where
// kKinds has no code for 1E it does not count. Columns: FX0N, 1S, 1N, 2N, 3S, 3G, 3U, iQ-F, Q and
// L, these by 1E, iQ-R.
constexpr std::array<Counts, kSpaces> kCounts = {{
    {0200, 020, 0200, 0270, 0200, 0200, 0400, 02000, 0x2000, 0x800, 0x3000},  // X
    {0200, 016, 0200, 0270, 0200, 0200, 0400, 02000, 0x2000, 0x800, 0x3000},  // Y
    {0, 0, 0, 0, 0, 0, 0, 0, 0x1000, 0x1000, 0x3000},                         // DX
    {0, 0, 0, 0, 0, 0, 0, 0, 0x1000, 0x1000, 0x3000},                         // DY
    {512, 512, 1536, 3072, 1536, 7680, 7680, 32768, 61440, 8192, 161882112},  // M
    {8256, 8256, 8256, 8256, 8512, 8512, 8512, 0, 0, 0, 0},                   // M8000
    {0, 0, 0, 0, 0, 0, 0, 32768, 32768, 32768, 32768},                        // L
    {0, 0, 0, 0, 0, 0, 0, 32768, 32768, 2048, 32768},                         // F
    {0, 0, 0, 0, 0, 0, 0, 0, 32768, 32768, 32768},                            // V
    {0, 0, 0, 0, 0, 0, 0, 0x8000, 0xF000, 0x1000, 0x9A62000},                 // B
    {0, 0, 0, 0, 0, 0, 0, 0x8000, 0x8000, 0x8000, 0x9A62000},                 // SB
    {128, 128, 1000, 1000, 256, 4096, 4096, 4096, 8192, 8192, 16384},         // S
    {0, 0, 0, 0, 0, 0, 0, 10000, 2048, 2048, 4096},                           // SM
    {64, 64, 256, 256, 138, 320, 512, 1024, 32768, 2048, 8993440},            // TS
    {64, 64, 256, 256, 138, 320, 512, 1024, 32768, 2048, 8993440},            // TC
    {64, 64, 256, 256, 138, 320, 512, 1024, 32768, 2048, 8993440},            // TN
    {0, 0, 0, 0, 0, 0, 0, 1024, 32768, 32768, 8993440},                       // STS
    {0, 0, 0, 0, 0, 0, 0, 1024, 32768, 32768, 8993440},                       // STC
    {0, 0, 0, 0, 0, 0, 0, 1024, 32768, 32768, 8993440},                       // STN
    {255, 256, 256, 256, 256, 256, 256, 1024, 32768, 1024, 8993440},          // CS
    {255, 256, 256, 256, 256, 256, 256, 1024, 32768, 1024, 8993440},          // CC
    {32, 32, 200, 200, 200, 200, 200, 1024, 32768, 1024, 8993440},            // CN
    {255, 256, 256, 256, 256, 256, 256, 0, 0, 0, 0},                          // CN200
    {0, 0, 0, 0, 0, 0, 0, 1024, 0, 0, 4761120},                               // LCS
    {0, 0, 0, 0, 0, 0, 0, 1024, 0, 0, 4761120},                               // LCC
    {0, 0, 0, 0, 0, 0, 0, 1024, 0, 0, 4761120},                               // LCN
    {0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 2529408},                                  // LTN
    {0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 2529408},                                  // LSTN
    {256, 256, 8000, 8000, 3000, 8000, 8000, 8000, 4184064, 6144, 10117632},  // D
    {8256, 8256, 8256, 8256, 8512, 8512, 8512, 0, 0, 0, 0},                   // D8000
    {0, 0, 0, 0, 0, 0, 0, 0x8000, 4184064, 0x1000, 10117632},                 // W
    {0, 0, 0, 0, 0, 0, 0, 0x8000, 0x8000, 0x8000, 10117632},                  // SW
    {0, 0, 0, 0, 0, 0, 0, 12000, 2048, 2048, 4096},                           // SD
    {0, 0, 0, 0, 0, 24000, 32768, 32768, 32768, 8192, 32768},                 // R
    {0, 0, 0, 0, 0, 0, 0, 0, 4184064, 4184064, 10027008},                     // ZR
    {0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 524288},                                   // RD
    {0, 0, 0, 0, 0, 0, 0, 24, 20, 20, 24},                                    // Z
    {0, 0, 0, 0, 0, 0, 0, 12, 0, 0, 12},                                      // LZ
}};

/// Name and series of each model and its column of the counts, in the order of Model. A model
/// precedes its form reached by 1E.
struct ModelFacts {
  std::string_view name;
  Series series;
  std::uint32_t Counts::*count;
};
constexpr std::array<ModelFacts, 17> kFacts = {{
    {"", Series::unknown, nullptr},  // unknown: the largest count of all
    {"", Series::fx3, &Counts::fx3u},
    {"FX0N", Series::fx, &Counts::fx0n},
    {"FX1S", Series::fx, &Counts::fx1s},
    {"FX1N", Series::fx, &Counts::fx1n},
    {"FX2N", Series::fx, &Counts::fx2n},
    {"FX3S", Series::fx, &Counts::fx3s},
    {"FX3G", Series::fx3, &Counts::fx3g},
    {"FX3U", Series::fx3, &Counts::fx3u},
    {"FX5U", Series::iq_f, &Counts::iq_f},
    {"FX5UJ", Series::iq_f, &Counts::iq_f},
    {"FX5S", Series::iq_f, &Counts::iq_f},
    {"Q", Series::q_l, &Counts::q_l},
    {"L", Series::q_l, &Counts::q_l},
    {"iQ-R", Series::iq_r, &Counts::iq_r},
    {"Q", Series::q_l, &Counts::by_1e},
    {"L", Series::q_l, &Counts::by_1e},
}};
const ModelFacts& facts_of(Model model) { return kFacts[static_cast<std::size_t>(model)]; }

bool is_by_1e(Model model) { return model == Model::q_by_1e || model == Model::l_by_1e; }

std::uint32_t count_of(Model model, Space space) {
  const Counts& counts = kCounts[id(space)];
  if (model == Model::unknown)
    return kind_of(space).first_number != 0 ? 0 : std::max({counts.iq_f, counts.q_l, counts.iq_r});
  return counts.*facts_of(model).count;
}

// Devices that start and stop an FX, switch off its outputs or open its program memory. RUN and
// STOP have requests of their own; a write that reached one of these as a side effect would stop a
// plant.
struct NeverWritten {
  Space space = Space::sm;
  Numbers numbers;
};
constexpr std::array<NeverWritten, 3> kNeverWritten = {{{Space::special_m, {8034, 8037}},
                                                        {Space::special_m, {8118, 8118}},
                                                        {Space::sm, {8034, 8037}}}};

constexpr std::string_view kForms =
    "X0 Y0 M0 L0 F0 V0 B0 S0 SM0 SB0 D0 W0 R0 ZR0 SD0 SW0 Z0, TN0 STN0 CN0 LCN0 LTN0 LSTN0 LZ0, "
    "contacts TS0 STS0 CS0, coils TC0 STC0 CC0, T0 C0, D0.F, K4M0";

std::string model_text(Model model) {
  if (model == Model::unknown_fx) return "the widest model (FX3U)";
  if (model == Model::unknown) return "the widest model";
  const std::string name(to_string(model));
  return is_by_1e(model) ? name + " by 1E frames" : name;
}

/// Returns the ranges of all devices with these letters: "M0-M7679 and M8000-M8511".
std::string ranges_text(Model model, std::string_view letters) {
  std::string text;
  for (std::uint16_t i = 0; i < kSpaces; ++i) {
    const auto space = static_cast<Space>(i);
    if (kind_of(space).letters != letters) continue;
    for (const Numbers& run : numbers_of(model, space)) {
      if (!text.empty()) text += " and ";
      text += device_name(model, space, run.first) + "-" + device_name(model, space, run.last);
    }
  }
  return text;
}

tl::unexpected<Error> missing(Model model, const std::string& name, std::string_view letters) {
  const std::string ranges = ranges_text(model, letters);
  return refuse(name + " does not exist: " + model_text(model) + " has " +
                (ranges.empty() ? "no " + std::string(letters) : ranges));
}

/// Names without the letter that distinguishes contact, coil and value.
constexpr std::array<std::string_view, 6> kBare = {"T", "C", "ST", "LC", "LT", "LST"};
/// Those whose contact can be read.
constexpr std::array<std::string_view, 4> kWithContact = {"T", "C", "ST", "LC"};
/// Words whose bits have names.
constexpr std::array<std::string_view, 7> kWithBits = {"D", "W", "R", "ZR", "SD", "SW", "RD"};
/// Bit devices of groups.
constexpr std::array<std::string_view, 10> kGroupable = {"X", "Y", "M", "L",  "F",
                                                         "V", "B", "S", "SM", "SB"};

bool is_among(std::span<const std::string_view> list, std::string_view letters) {
  return std::ranges::find(list, letters) != list.end();
}

Numbering numbering_of(std::string_view letters) {
  for (const DeviceKind& kind : kKinds)
    if (kind.letters == letters) return kind.numbering;
  return Numbering::decimal;
}

/// Parts of a name: letters, digits, and what surrounds them. Not checked against a model.
struct Parts {
  std::string name;     ///< as given
  int group = 0;        ///< K1-K8; 0: none
  std::string letters;  ///< those of a kind or of kBare
  std::string digits;
  std::optional<std::uint32_t> word_bit;
};

bool all_digits(std::string_view digits, Numbering numbering) {
  return !digits.empty() && std::all_of(digits.begin(), digits.end(), [&](char c) {
    return numbering == Numbering::decimal ? c >= '0' && c <= '9'
                                           : hex_digit(static_cast<std::uint8_t>(c)) >= 0;
  });
}

/// Returns the length of the longest device letters that are followed only by digits: "SB1F" is not
/// an S.
std::size_t letters_in(std::string_view rest) {
  std::size_t longest = 0;
  const auto look = [&](std::string_view letters) {
    if (rest.starts_with(letters) && all_digits(rest.substr(letters.size()), numbering_of(letters)))
      longest = std::max(longest, letters.size());
  };
  for (const DeviceKind& kind : kKinds) look(kind.letters);
  for (const std::string_view letters : kBare) look(letters);
  return longest;
}

Result<Parts> take_apart(std::string_view text) {
  Parts parts;
  parts.name = text;
  const std::string in_capitals = upper(text);
  std::string_view rest = in_capitals;
  if (rest.size() >= 3 && rest[0] == 'K' && rest[1] >= '0' && rest[1] <= '9') {
    parts.group = rest[1] - '0';
    if (parts.group < 1 || parts.group > 8 || (rest[2] >= '0' && rest[2] <= '9'))
      return refuse(parts.name +
                    ": a group is K1 to K8 (4 to 32 bits) and a bit device, as in K4M0");
    rest.remove_prefix(2);
  }
  if (const auto dot = rest.find('.'); dot != std::string_view::npos) {
    const std::string_view bit = rest.substr(dot + 1);
    const int value = bit.size() == 1 ? hex_digit(static_cast<std::uint8_t>(bit[0])) : -1;
    rest = rest.substr(0, dot);
    if (value < 0 || parts.group != 0 || !is_among(kWithBits, rest.substr(0, letters_in(rest))))
      return refuse("'" + parts.name + "': a bit of a word is D100.0 to D100.F");
    parts.word_bit = static_cast<std::uint32_t>(value);
  }
  const std::size_t letters = letters_in(rest);
  if (letters == 0)
    return refuse("'" + parts.name + "' is not a device of the MC protocol; the forms are " +
                  std::string(kForms));
  parts.letters = rest.substr(0, letters);
  parts.digits = rest.substr(letters);
  return parts;
}

/// Returns the error for a number that is not octal, with its neighbours that are: "after Y17 comes
/// Y20".
std::string not_octal(Model model, const Parts& parts) {
  const auto bad = parts.digits.find_first_not_of("01234567");
  std::uint32_t before = 0;
  for (std::size_t i = 0; i < parts.digits.size() && i < 8; ++i)
    before = before * 8 + (i < bad ? static_cast<std::uint32_t>(parts.digits[i] - '0') : 7);
  return parts.name + " does not exist: " + parts.letters + " of " + model_text(model) +
         " is numbered in octal, after " + parts.letters + digits_of(before, 8) + " comes " +
         parts.letters + digits_of(before + 1, 8);
}

std::uint32_t base_of(Model model, Numbering numbering) {
  if (numbering == Numbering::decimal) return 10;
  const bool fx = is_fx(model) || series_of(model) == Series::iq_f;
  return numbering == Numbering::octal_on_fx && fx ? 8 : 16;
}

Result<std::uint32_t> number_in(Model model, const Parts& parts) {
  std::string_view digits = parts.digits;
  while (digits.size() > 1 && digits.front() == '0') digits.remove_prefix(1);
  const Numbering numbering = numbering_of(parts.letters);
  // Both bases agree on the first eight numbers. Beyond them a guess would read other inputs.
  if (numbering == Numbering::octal_on_fx && series_of(model) == Series::unknown &&
      (digits.size() > 1 || digits > "7"))
    return refuse(parts.name +
                  ": X and Y are numbered in octal on an FX5 and in hexadecimal on "
                  "others, so `model` must be set for those above " +
                  parts.letters + "7");
  const std::uint32_t base = base_of(model, numbering);
  if (base == 8 && digits.find_first_not_of("01234567") != std::string_view::npos)
    return refuse(not_octal(model, parts));
  std::uint32_t number = 0;
  const auto [end, error] =
      std::from_chars(digits.data(), digits.data() + digits.size(), number, static_cast<int>(base));
  if (error != std::errc{} || end != digits.data() + digits.size() || number > 0x0FFFFFFF)
    return refuse(parts.name + ": the number is too large");
  return number;
}

/// Returns the space of complete letters. For M, D and CN of an FX up to the FX3 the number
/// decides.
Space space_of(Model model, std::string_view letters, std::uint32_t number) {
  std::optional<Space> found;
  for (std::uint16_t i = 0; i < kSpaces; ++i) {
    const auto space = static_cast<Space>(i);
    const DeviceKind& kind = kind_of(space);
    if (kind.letters != letters) continue;
    if (!found || (is_fx(model) && number >= kind.first_number)) found = space;
  }
  return *found;
}

Result<void> check_forbidden(const Span& span) {
  for (const NeverWritten& never : kNeverWritten)
    if (overlap(span, span_of(never.space, never.numbers)))
      return refuse(
          std::string(never.space == Space::sm ? "SM8034-SM8037" : "M8034-M8037 and M8118") +
          " cannot be written by address; use the commands run and stop");
  return {};
}

/// Check before a number is converted to bits: the bits of a number that no model has may not fit
/// into 32 bits.
Result<void> check_number(Model model, Space space, std::uint32_t number) {
  if (has_device(model, space, number)) return {};
  return missing(model, device_name(model, space, number), kind_of(space).letters);
}

/// Returns the error for a span that begins inside the model's devices and leaves them at device
/// `number`.
tl::unexpected<Error> leaves(Model model, const Span& span, std::uint32_t number) {
  const auto space = static_cast<Space>(span.space);
  const DeviceKind& kind = kind_of(space);
  const std::uint64_t last_bit = std::uint64_t{span.first_bit} + span.bits - 1;
  const auto last = static_cast<std::uint32_t>(kind.first_number + last_bit / kind.bits);
  const std::string both = device_name(model, span) + "-" + device_name(model, space, last);
  for (std::uint16_t i = 0; i < kSpaces; ++i) {
    const auto other = static_cast<Space>(i);
    if (kind_of(other).letters == kind.letters && has_device(model, other, number))
      return refuse(both + " does not exist as one range: " + model_text(model) + " has " +
                    ranges_text(model, kind.letters));
  }
  return missing(model, both + ": " + device_name(model, space, number), kind.letters);
}

bool contains(const Numbers& run, std::uint32_t number) {
  return run.first <= number && number <= run.last;
}

template <class Is>
std::optional<Space> first_space(Is is) {
  for (std::uint16_t i = 0; i < kSpaces; ++i)
    if (is(kKinds[i])) return static_cast<Space>(i);
  return std::nullopt;
}

}  // namespace

Series series_of(Model model) { return facts_of(model).series; }

bool is_fx(Model model) {
  return series_of(model) == Series::fx || series_of(model) == Series::fx3;
}

std::string_view to_string(Model model) { return facts_of(model).name; }

std::optional<Model> model_named(std::string_view name) {
  const auto* found = std::ranges::find(kFacts, name, &ModelFacts::name);
  if (found != kFacts.end() && !name.empty()) return static_cast<Model>(found - kFacts.begin());
  const auto* kin = std::ranges::find(kKin, name, &Kin::name);
  return kin == kKin.end() ? std::nullopt : std::optional(kin->model);
}

Model seen_by_1e(Model model) {
  if (model == Model::unknown) return Model::unknown_fx;
  if (model == Model::q) return Model::q_by_1e;
  return model == Model::l ? Model::l_by_1e : model;
}

const DeviceKind& kind_of(Space space) { return kKinds[id(space)]; }

std::optional<Space> space_coded(std::uint8_t binary) {
  return first_space([&](const DeviceKind& kind) { return kind.binary == binary; });
}

std::optional<Space> space_coded(std::string_view ascii) {
  return first_space([&](const DeviceKind& kind) {
    // Two characters, or the letters padded to four with asterisks.
    if (ascii.size() == 2) return kind.ascii == ascii;
    return ascii.size() == 4 && ascii.starts_with(kind.letters) &&
           ascii.find_first_not_of('*', kind.letters.size()) == std::string_view::npos;
  });
}

std::optional<Space> space_coded_1e(std::uint16_t one_e) {
  return first_space([&](const DeviceKind& kind) { return one_e != 0 && kind.one_e == one_e; });
}

// QnUCPU user's manual (function explanation), table 6.44: devices of the serial communication.
std::uint32_t ascii_base_of(Model model, Space space) {
  return space == Space::zr ? 16 : base_of(model, kind_of(space).numbering);
}

std::vector<Numbers> numbers_of(Model model, Space space) {
  const std::uint32_t count = count_of(model, space);
  const bool is_small = model == Model::fx0n || model == Model::fx1s;
  const std::uint32_t first =
      is_small && space == Space::cn32 ? kSmallLong : kind_of(space).first_number;
  if (count <= first) return {};
  if (is_small && (space == Space::cs || space == Space::cc))
    return {{0, count_of(model, Space::cn) - 1}, {kSmallLong, count - 1}};
  return {{first, count - 1}};
}

bool has_device(Model model, Space space, std::uint32_t number) {
  return std::ranges::any_of(numbers_of(model, space),
                             [&](const Numbers& run) { return contains(run, number); });
}

Span span_of(Space space, Numbers numbers) {
  const DeviceKind& kind = kind_of(space);
  return {id(space), (numbers.first - kind.first_number) * kind.bits,
          (numbers.last - numbers.first + 1) * kind.bits};
}

std::string device_name(Model model, Space space, std::uint32_t number) {
  const DeviceKind& kind = kind_of(space);
  return std::string(kind.letters) + digits_of(number, base_of(model, kind.numbering));
}

std::string device_name(Model model, const Span& span) {
  if (span.space >= kSpaces) return "space " + std::to_string(span.space);
  const auto space = static_cast<Space>(span.space);
  const DeviceKind& kind = kind_of(space);
  return device_name(model, space, kind.first_number + span.first_bit / kind.bits);
}

Result<Address> parse_address(Model model, std::string_view text, std::optional<DataType> type) {
  auto taken = take_apart(text);
  if (!taken) return fail(taken);
  Parts& parts = *taken;
  const auto number = number_in(model, parts);
  if (!number) return fail(number);
  if (is_among(kBare, parts.letters)) {
    const bool contact = type == DataType::boolean;
    if (contact && !is_among(kWithContact, parts.letters))
      return refuse(parts.name + ": the contact of a long timer cannot be read by this protocol");
    parts.letters += contact ? 'S' : 'N';
  }
  const Space space = space_of(model, parts.letters, *number);
  if (const auto present = check_number(model, space, *number); !present) return fail(present);

  Address address;
  address.text = device_name(model, space, *number);
  const DeviceKind& kind = kind_of(space);
  address.unit = kind.bits == 1 ? Unit::bit : kind.number_unit;
  Numbers numbers{*number, *number};
  if (parts.group != 0) {
    if (!is_among(kGroupable, parts.letters))
      return refuse(parts.name + ": a group is made of X, Y, M" +
                    (is_fx(model) ? " or S" : ", L, F, V, B, S, SM or SB"));
    numbers.last += static_cast<std::uint32_t>(parts.group) * 4 - 1;
    address.unit = Unit::bit_group;
    address.text = "K" + std::to_string(parts.group) + address.text;
  }
  address.span = span_of(space, numbers);
  if (const auto present = check_range(model, address.span); !present) return fail(present);
  if (parts.word_bit) {
    address.unit = Unit::word_bit;
    address.writable = false;
    address.span = {id(space), address.span.first_bit + *parts.word_bit, 1};
    address.text = address.text + "." + "0123456789ABCDEF"[*parts.word_bit];
  }
  return address;
}

bool needs_type(std::string_view text) {
  const auto parts = take_apart(text);
  return parts && parts->group == 0 && is_among(kWithContact, parts->letters);
}

Result<Span> parse_range(Model model, std::string_view text) {
  const RangeEnds ends = range_ends(text);
  const auto begin = take_apart(ends.first);
  if (!begin) return fail(begin);
  const std::string last = last_end(ends, begin->letters);
  Numbers numbers;
  std::optional<Space> space;
  for (const std::string_view end : {ends.first, std::string_view(last)}) {
    const auto parts = take_apart(end);
    if (!parts) return fail(parts);
    if (parts->group != 0 || parts->word_bit)
      return refuse(std::string(text) +
                    ": a range goes from one plain device to another, as M100-M199");
    if (is_among(kBare, parts->letters))
      return refuse(
          std::string(text) + " is ambiguous: write " + parts->letters + "N for the values" +
          (is_among(kWithContact, parts->letters) ? " or " + parts->letters + "S for the contacts"
                                                  : std::string()));
    const auto number = number_in(model, *parts);
    if (!number) return fail(number);
    const Space found = space_of(model, parts->letters, *number);
    if (const auto present = check_number(model, found, *number); !present) return fail(present);
    if (space && *space != found)
      return refuse(std::string(text) + ": both ends must be of one kind" +
                    (is_fx(model) ? " (specials from 8000 and 32-bit counters from CN200 are kinds "
                                    "of their own)"
                                  : ""));
    if (!space) numbers.first = *number;
    numbers.last = *number;
    space = found;
  }
  if (numbers.last < numbers.first)
    return refuse(std::string(text) + ": the range ends before it begins");
  const Span span = span_of(*space, numbers);
  if (const auto allowed = check_range(model, span); !allowed) return fail(allowed);
  if (const auto allowed = check_forbidden(span); !allowed) return fail(allowed);
  return span;
}

Result<void> check_range(Model model, const Span& span) {
  if (span.space >= kSpaces)
    return refuse("space " + std::to_string(span.space) + " is not a device");
  const auto space = static_cast<Space>(span.space);
  const DeviceKind& kind = kind_of(space);
  const auto runs = numbers_of(model, space);
  const std::uint64_t end = std::uint64_t{span.first_bit} + span.bits;
  for (std::uint64_t bit = span.first_bit; bit < end;) {
    const auto number = static_cast<std::uint32_t>(kind.first_number + bit / kind.bits);
    const auto run =
        std::ranges::find_if(runs, [&](const Numbers& each) { return contains(each, number); });
    if (run == runs.end())
      return bit == span.first_bit ? missing(model, device_name(model, space, number), kind.letters)
                                   : leaves(model, span, number);
    bit = span_of(space, *run).end_bit();
  }
  return {};
}

Result<void> check_write(Model model, const Span& span) {
  if (span.bits == 0) return refuse("a write of nothing");
  if (auto allowed = check_forbidden(span); !allowed) return allowed;
  if (auto present = check_range(model, span); !present) return present;
  const DeviceKind& kind = kind_of(static_cast<Space>(span.space));
  if (span.first_bit % kind.bits != 0 || span.bits % kind.bits != 0)
    return refuse(device_name(model, span) + ": only whole words can be written");
  return {};
}

}  // namespace fxagent::mc
