#include "protocol/fx/device.h"

#include <algorithm>
#include <array>

#include "protocol/letter_case.h"
#include "protocol/range_ends.h"

namespace fxagent::fx {
namespace {

constexpr std::array<std::string_view, 7> kModelNames = {"FX0N", "FX1S", "FX1N", "FX2N",
                                                         "FX3S", "FX3G", "FX3U"};

// Compact forms of other models, and the one with Ethernet, in the order of kKin.
constexpr std::array<std::string_view, 5> kKinNames = {"FX1NC", "FX2NC", "FX3GC", "FX3GE", "FX3UC"};
constexpr std::array<Model, kKinNames.size()> kKin = {Model::fx1n, Model::fx2n, Model::fx3g,
                                                      Model::fx3g, Model::fx3u};

constexpr std::array<DeviceKind, kSpaces> kKinds = {{
    {"X", Unit::bit, 1, 0, true},
    {"Y", Unit::bit, 1, 0, true},
    {"M", Unit::bit, 1, 0, false},
    {"M", Unit::bit, 1, 8000, false},
    {"S", Unit::bit, 1, 0, false},
    {"TS", Unit::bit, 1, 0, false},
    {"TN", Unit::word, 16, 0, false},
    {"CS", Unit::bit, 1, 0, false},
    {"CN", Unit::word, 16, 0, false},
    {"CN", Unit::dword, 32, 200, false},
    {"D", Unit::word, 16, 0, false},
    {"D", Unit::word, 16, 8000, false},
    {"R", Unit::word, 16, 0, false},
    {"TC", Unit::bit, 1, 0, false},
    {"CC", Unit::bit, 1, 0, false},
}};

/// Last number of each kind, and the run of 32-bit counters.
struct Limits {
  std::uint32_t x = 0, y = 0, m = 0, special = 0, s = 0, t = 0, c = 0;
  std::uint32_t c32_first = 0, c32_last = 0, d = 0;
  std::uint32_t r = 0;  // 0: no extension registers
};

constexpr std::array<Limits, 7> kLimits = {{
    {0177, 0177, 511, 8255, 127, 63, 31, 235, 254, 255},              // FX0N
    {017, 015, 511, 8255, 127, 63, 31, 235, 255, 255},                // FX1S
    {0177, 0177, 1535, 8255, 999, 255, 199, 200, 255, 7999},          // FX1N
    {0267, 0267, 3071, 8255, 999, 255, 199, 200, 255, 7999},          // FX2N
    {0177, 0177, 1535, 8511, 255, 137, 199, 200, 255, 2999},          // FX3S
    {0177, 0177, 7679, 8511, 4095, 319, 199, 200, 255, 7999, 23999},  // FX3G
    {0377, 0377, 7679, 8511, 4095, 511, 199, 200, 255, 7999, 32767},  // FX3U
}};

// In the order of Space. Contacts and coils of counters have the run of 32-bit counters, too.
constexpr std::array<std::uint32_t Limits::*, kSpaces> kLast = {
    &Limits::x, &Limits::y,       &Limits::m, &Limits::special, &Limits::s,
    &Limits::t, &Limits::t,       &Limits::c, &Limits::c,       &Limits::c32_last,
    &Limits::d, &Limits::special, &Limits::r, &Limits::t,       &Limits::c};

// Devices that start and stop the PLC or open its program memory. RUN and STOP have requests of
// their own; a write that reached one of these as a side effect would stop a plant.
constexpr std::array<Numbers, 2> kNeverWritten = {{{8034, 8037}, {8118, 8118}}};

constexpr std::string_view kForms = "X0 Y0 (octal) M0 S0 D0 R0 TN0 TS0 CN0 CS0, T0 C0, D0.F, K4M0";

bool is_digit(char c) { return c >= '0' && c <= '9'; }

std::string_view model_text(Model model) {
  return model == Model::unknown ? "the widest model (FX3U)" : to_string(model);
}

/// Returns the ranges of all devices with these letters: "M0-M7679 and M8000-M8511".
std::string ranges_text(Model model, std::string_view letters) {
  std::string text;
  for (std::uint16_t i = 0; i < kSpaces; ++i) {
    const auto space = static_cast<Space>(i);
    if (kind_of(space).letters != letters) continue;
    for (const Numbers& run : numbers_of(model, space)) {
      if (!text.empty()) text += " and ";
      text += device_name(space, run.first) + "-" + device_name(space, run.last);
    }
  }
  return text;
}

/// Returns the error for a number that is not octal, with its neighbours that are: "after Y17 comes
/// Y20".
std::string not_octal(std::string_view name, std::string_view letters, std::string_view digits) {
  const auto bad = digits.find_first_of("89");
  std::uint32_t before = 0;
  for (std::size_t i = 0; i < digits.size(); ++i)
    before = before * 8 + (i < bad ? static_cast<std::uint32_t>(digits[i] - '0') : 7);
  const std::string head(letters);
  return std::string(name) + " does not exist: " + head + " is numbered in octal, after " + head +
         digits_of(before, 8) + " comes " + head + digits_of(before + 1, 8);
}

/// Parts of a name: letters, number, and what surrounds them. Not checked against a model.
struct Parts {
  int group = 0;        // K1-K8; 0: none
  std::string letters;  // X Y M S D T C TN TS CN CS
  std::uint32_t number = 0;
  std::optional<std::uint32_t> word_bit;
};

Result<std::uint32_t> parse_number(std::string_view name, std::string_view letters,
                                   std::string_view digits) {
  while (digits.size() > 1 && digits.front() == '0') digits.remove_prefix(1);
  if (digits.size() > 6) return refuse(std::string(name) + ": the number is too large");
  const bool octal = letters == "X" || letters == "Y";
  if (octal && digits.find_first_of("89") != std::string_view::npos)
    return refuse(not_octal(name, letters, digits));
  std::uint32_t number = 0;
  for (const char c : digits)
    number = number * (octal ? 8U : 10U) + static_cast<std::uint32_t>(c - '0');
  return number;
}

Result<Parts> take_apart(std::string_view text) {
  const std::string name(text);
  const std::string in_capitals = upper(text);
  std::string_view rest = in_capitals;
  Parts parts;
  if (rest.size() >= 3 && rest[0] == 'K' && is_digit(rest[1])) {
    parts.group = rest[1] - '0';
    if (parts.group < 1 || parts.group > 8 || is_digit(rest[2]))
      return refuse(name + ": a group is K1 to K8 (4 to 32 bits) and a bit device, as in K4M0");
    rest.remove_prefix(2);
  }
  std::size_t letters = 0;
  while (letters < rest.size() && rest[letters] >= 'A' && rest[letters] <= 'Z') ++letters;
  parts.letters = rest.substr(0, letters);
  constexpr std::array<std::string_view, 12> kLetters = {"X", "Y", "M",  "S",  "D",  "R",
                                                         "T", "C", "TN", "TS", "CN", "CS"};
  if (std::ranges::find(kLetters, parts.letters) == kLetters.end())
    return refuse("'" + name + "' is not an FX device; the forms are " + std::string(kForms));
  rest.remove_prefix(letters);
  std::size_t digits = 0;
  while (digits < rest.size() && is_digit(rest[digits])) ++digits;
  if (digits == 0) return refuse("'" + name + "' has no device number");
  const auto number = parse_number(name, parts.letters, rest.substr(0, digits));
  if (!number) return fail(number);
  parts.number = *number;
  rest.remove_prefix(digits);
  if (rest.empty()) return parts;
  const int bit =
      rest.size() == 2 && rest[0] == '.' ? hex_digit(static_cast<std::uint8_t>(rest[1])) : -1;
  if (bit < 0 || (parts.letters != "D" && parts.letters != "R") || parts.group != 0)
    return refuse("'" + name + "' is not an FX device: after the number comes '" +
                  std::string(text.substr(text.size() - rest.size())) +
                  "'; a bit of a word is D100.0 to D100.F");
  parts.word_bit = static_cast<std::uint32_t>(bit);
  return parts;
}

/// Returns the space of a plain device. T and C already have their second letter.
Space space_of(std::string_view letters, std::uint32_t number) {
  Space found = Space::d;
  for (std::uint16_t i = 0; i < kSpaces; ++i)
    if (kKinds[i].letters == letters && kKinds[i].first_number <= number)
      found = static_cast<Space>(i);
  return found;
}

tl::unexpected<Error> missing(Model model, const std::string& name, std::string_view letters) {
  const std::string ranges = ranges_text(model, letters);
  return refuse(name + " does not exist: " + std::string(model_text(model)) + " has " +
                (ranges.empty() ? "no " + std::string(letters) : ranges));
}

/// Returns the error for a span that begins inside the model's devices and leaves them at device
/// `number`.
tl::unexpected<Error> leaves(Model model, const Span& span, std::uint32_t number) {
  const auto space = static_cast<Space>(span.space);
  const DeviceKind& kind = kind_of(space);
  const std::string next = device_name(space, number);
  const std::string both = device_name(span) + "-" +
                           device_name(space, kind.first_number + (span.end_bit() - 1) / kind.bits);
  for (std::uint16_t i = 0; i < kSpaces; ++i) {
    const auto other = static_cast<Space>(i);
    if (kind_of(other).letters != kind.letters) continue;
    for (const Numbers& run : numbers_of(model, other))
      if (run.first <= number && number <= run.last)
        return refuse(both + " does not exist as one range: " + std::string(model_text(model)) +
                      " has " + ranges_text(model, kind.letters));
  }
  return missing(model, both + ": " + next, kind.letters);
}

/// Fails with bad_request if the span contains a device that is never written.
Result<void> check_forbidden(const Span& span) {
  for (const Numbers& numbers : kNeverWritten)
    if (overlap(span, span_of(Space::special_m, numbers)))
      return refuse(
          "M8034-M8037 and M8118 cannot be written by address; use the commands run and stop");
  return {};
}

}  // namespace

std::span<const std::string_view> model_names() { return kModelNames; }

std::span<const std::string_view> kin_names() { return kKinNames; }

std::string_view to_string(Model model) {
  return model == Model::unknown ? std::string_view{}
                                 : kModelNames[static_cast<std::size_t>(model) - 1];
}

std::optional<Model> model_named(std::string_view name) {
  const auto found = std::find(kModelNames.begin(), kModelNames.end(), name);
  if (found != kModelNames.end()) return static_cast<Model>(found - kModelNames.begin() + 1);
  const auto kin = std::find(kKinNames.begin(), kKinNames.end(), name);
  if (kin == kKinNames.end()) return std::nullopt;
  return kKin[static_cast<std::size_t>(kin - kKinNames.begin())];
}

const DeviceKind& kind_of(Space space) { return kKinds[id(space)]; }

std::vector<Numbers> numbers_of(Model model, Space space) {
  const Model known = model == Model::unknown ? Model::fx3u : model;
  const Limits& limits = kLimits[static_cast<std::size_t>(known) - 1];
  const std::uint32_t last = limits.*kLast[id(space)];
  if (space == Space::r && last == 0) return {};
  if (space == Space::cn32) return {{limits.c32_first, last}};
  if (space != Space::cs && space != Space::cc) return {{kind_of(space).first_number, last}};
  if (last + 1 == limits.c32_first) return {{0, limits.c32_last}};
  return {{0, last}, {limits.c32_first, limits.c32_last}};
}

Span span_of(Space space, Numbers numbers) {
  const DeviceKind& kind = kind_of(space);
  return {id(space), (numbers.first - kind.first_number) * kind.bits,
          (numbers.last - numbers.first + 1) * kind.bits};
}

std::string device_name(Space space, std::uint32_t number) {
  const DeviceKind& kind = kind_of(space);
  return std::string(kind.letters) + digits_of(number, kind.octal ? 8 : 10);
}

std::string device_name(const Span& span) {
  if (span.space >= kSpaces) return "space " + std::to_string(span.space);
  const auto space = static_cast<Space>(span.space);
  const DeviceKind& kind = kind_of(space);
  return device_name(space, kind.first_number + span.first_bit / kind.bits);
}

Result<Address> parse_address(Model model, std::string_view text, std::optional<DataType> type) {
  auto taken = take_apart(text);
  if (!taken) return fail(taken);
  Parts& parts = *taken;
  if (parts.letters == "T" || parts.letters == "C")
    parts.letters += type == DataType::boolean ? 'S' : 'N';
  const Space space = space_of(parts.letters, parts.number);
  const DeviceKind& kind = kind_of(space);

  Address address;
  address.text = device_name(space, parts.number);
  address.unit = kind.unit;
  Numbers numbers{parts.number, parts.number};
  if (parts.group != 0) {
    const bool groupable = space == Space::x || space == Space::y || space == Space::m ||
                           space == Space::special_m || space == Space::s;
    if (!groupable) return refuse(std::string(text) + ": a group is made of X, Y, M or S");
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
  return parts && parts->group == 0 && (parts->letters == "T" || parts->letters == "C");
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
    if (parts->letters == "T" || parts->letters == "C")
      return refuse(std::string(text) + " is ambiguous: write " + parts->letters +
                    "N for the values or " + parts->letters + "S for the contacts");
    const Space here = space_of(parts->letters, parts->number);
    if (const auto present = check_range(model, span_of(here, {parts->number, parts->number}));
        !present)
      return fail(present);
    if (!space) {
      space = here;
      numbers.first = parts->number;
    }
    if (*space != here)
      return refuse(std::string(text) +
                    ": both ends must be of one kind (specials from 8000 and 32-bit "
                    "counters from CN200 are kinds of their own)");
    numbers.last = parts->number;
  }
  if (numbers.last < numbers.first)
    return refuse(std::string(text) + ": the range ends before it begins");
  const Span span = span_of(*space, numbers);
  if (const auto allowed = check_range(model, span); !allowed) return fail(allowed);
  if (const auto allowed = check_forbidden(span); !allowed) return fail(allowed);
  return span;
}

Result<void> check_range(Model model, const Span& span) {
  if (span.space >= id(Space::tc))
    return refuse(device_name(span) + " is not in the memory of an FX");
  const auto space = static_cast<Space>(span.space);
  const DeviceKind& kind = kind_of(space);
  const auto runs = numbers_of(model, space);
  std::uint64_t bit = span.first_bit;
  const std::uint64_t end = bit + span.bits;
  while (bit < end) {
    const auto number = static_cast<std::uint32_t>(kind.first_number + bit / kind.bits);
    const auto run = std::find_if(runs.begin(), runs.end(), [&](const Numbers& candidate) {
      return candidate.first <= number && number <= candidate.last;
    });
    if (run == runs.end())
      return bit == span.first_bit ? missing(model, device_name(space, number), kind.letters)
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
  if (kind.bits == 1) {
    if (span.bits != 1 && (span.first_bit % 8 != 0 || span.bits % 8 != 0))
      return refuse(
          device_name(span) + ": a write of several bits must begin at a multiple of 8, such as " +
          device_name({span.space, span.first_bit / 8 * 8, 1}) +
          ", and fill whole bytes, or it would change the bits next to them. Write single bits "
          "instead, in a list of targets");
  } else if (span.first_bit % kind.bits != 0 || span.bits % kind.bits != 0) {
    return refuse(device_name(span) + ": only whole words can be written");
  }
  return {};
}

}  // namespace fxagent::fx
