#include "protocol/fx/device.h"

#include <algorithm>
#include <array>

#include "protocol/letter_case.h"
#include "protocol/range_ends.h"

namespace fxagent::fx {
namespace {

constexpr std::array<std::string_view, 12> kLetters = {"X", "Y", "M",  "S",  "D",  "R",
                                                       "T", "C", "TN", "TS", "CN", "CS"};
constexpr std::string_view kForms = "X0 Y0 (octal) M0 S0 D0 R0 TN0 TS0 CN0 CS0, T0 C0, D0.F, K4M0";

bool is_digit(char c) { return c >= '0' && c <= '9'; }

/// Returns the letters of a name in capitals, without those of a group. Checks that the name is
/// that of an FX device; mc::parse_address() reads it. Error: bad_request.
Result<std::string> letters_in(std::string_view text) {
  const std::string name(text);
  const std::string in_capitals = upper(text);
  std::string_view rest = in_capitals;
  const bool is_group = rest.size() >= 3 && rest[0] == 'K' && is_digit(rest[1]);
  if (is_group) rest.remove_prefix(std::min(rest.find_first_not_of("0123456789", 1), rest.size()));
  std::string letters(rest.begin(),
                      std::ranges::find_if_not(rest, [](char c) { return c >= 'A' && c <= 'Z'; }));
  if (std::ranges::find(kLetters, letters) == kLetters.end())
    return refuse("'" + name + "' is not an FX device; the forms are " + std::string(kForms));
  rest.remove_prefix(letters.size());
  if (rest.empty() || !is_digit(rest[0])) return refuse("'" + name + "' has no device number");
  rest.remove_prefix(std::min(rest.find_first_not_of("0123456789"), rest.size()));
  const bool is_bit = rest.size() == 2 && rest[0] == '.' && !is_group &&
                      hex_digit(static_cast<std::uint8_t>(rest[1])) >= 0 &&
                      (letters == "D" || letters == "R");
  if (!rest.empty() && !is_bit)
    return refuse("'" + name + "' is not an FX device: after the number comes '" +
                  std::string(text.substr(text.size() - rest.size())) +
                  "'; a bit of a word is D100.0 to D100.F");
  return letters;
}

}  // namespace

std::optional<Model> model_named(std::string_view name) {
  const auto known = mc::model_named(name);
  return known && mc::is_fx(*known) ? known : std::nullopt;
}

bool is_addressed(std::uint16_t space) {
  return space < kSpaces && space != id(Space::tc) && space != id(Space::cc) &&
         !numbers_of(Model::unknown_fx, static_cast<Space>(space)).empty();
}

std::string device_name(Space space, std::uint32_t number) {
  return mc::device_name(Model::unknown_fx, space, number);
}

std::string device_name(const Span& span) { return mc::device_name(Model::unknown_fx, span); }

Result<Address> parse_address(Model model, std::string_view text, std::optional<DataType> type) {
  return letters_in(text).and_then(
      [&](const std::string&) { return mc::parse_address(model, text, type); });
}

bool needs_type(std::string_view text) { return letters_in(text) && mc::needs_type(text); }

Result<Span> parse_range(Model model, std::string_view text) {
  const RangeEnds ends = range_ends(text);
  const auto first = letters_in(ends.first);
  if (!first) return fail(first);
  const auto last = letters_in(last_end(ends, *first));
  if (!last) return fail(last);
  return mc::parse_range(model, text);
}

Result<void> check_range(Model model, const Span& span) {
  if (!is_addressed(span.space))
    return refuse(device_name(span) + " is not in the memory of an FX");
  return mc::check_range(model, span);
}

Result<void> check_write(Model model, const Span& span) {
  if (const auto present = fx::check_range(model, span); !present) return present;
  if (const auto allowed = mc::check_write(model, span); !allowed) return allowed;
  const bool is_bits = width_of(span.space) == 1;
  if (is_bits && span.bits != 1 && (span.first_bit % 8 != 0 || span.bits % 8 != 0))
    return refuse(
        device_name(span) + ": a write of several bits must begin at a multiple of 8, such as " +
        device_name({span.space, span.first_bit / 8 * 8, 1}) +
        ", and fill whole bytes, or it would change the bits next to them. Write single bits "
        "instead, in a list of targets");
  return {};
}

}  // namespace fxagent::fx
