// Names of FX devices (X17, M8000, TN5, D100.F, K4M0) and the memory they stand for.
// Shared by the protocols of the FX series; which device a protocol reaches is its own to say.
// Sources: FX Communication User's Manual JY992D69901, 7.7.2 (ranges of FX0N to FX2N);
// FX3U-ENET manual, device table (FX3G, FX3U). FX3S is from product knowledge and unverified.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "protocol/point.h"
#include "protocol/result.h"

namespace fxagent::fx {

enum class Model : std::uint8_t { unknown, fx0n, fx1s, fx1n, fx2n, fx3s, fx3g, fx3u };

/// The seven models, in the order of the enumeration.
std::span<const std::string_view> model_names();
/// Further names the config may use: FX3UC and others, which have the memory of the model without
/// the last letter.
std::span<const std::string_view> kin_names();
/// "FX3U"; empty for unknown.
std::string_view to_string(Model model);
/// nullopt where `name` is none of model_names() and kin_names().
std::optional<Model> model_named(std::string_view name);

/// The spaces of an FX. M8000 up and D8000 up are memory of their own, and CN200-CN255 are 32 bits
/// wide, so each of them is a space that counts from its first device.
enum class Space : std::uint16_t {
  x,
  y,
  m,
  special_m,
  s,
  ts,    ///< timer contacts
  tn,    ///< timer values
  cs,    ///< counter contacts
  cn,    ///< counter values, 16 bits: CN0-CN199
  cn32,  ///< counter values, 32 bits: CN200-CN255
  d,
  special_d,
  r,  ///< extension registers of FX3G and FX3U
  tc,
  cc,  ///< coils of timers and counters: named when a frame is explained, never addressed
};
inline constexpr std::uint16_t kSpaces = 15;

constexpr std::uint16_t id(Space space) { return static_cast<std::uint16_t>(space); }

struct DeviceKind {
  std::string_view letters;
  Unit unit = Unit::bit;
  std::uint32_t bits = 1;          ///< of one device
  std::uint32_t first_number = 0;  ///< the device at bit 0 of the space
  bool octal = false;
};
const DeviceKind& kind_of(Space space);

/// Device numbers, both ends included; X17 is number 15.
struct Numbers {
  std::uint32_t first = 0;
  std::uint32_t last = 0;
};
/// The numbers that a model has in a space: one run, or two (counter contacts of FX0N and FX1S).
struct NumberRuns {
  std::array<Numbers, 2> runs{};
  std::size_t count = 0;
  const Numbers* begin() const { return runs.data(); }
  const Numbers* end() const { return runs.data() + count; }
};
/// None where the model lacks the kind. An unknown model has what the widest one has: FX3U.
NumberRuns numbers_of(Model model, Space space);

/// The bits of `numbers` in their space.
Span span_of(Space space, Numbers numbers);
/// "Y17", "M8000", "CN200".
std::string device_name(Space space, std::uint32_t number);
/// The name of the device that holds the span's first bit.
std::string device_name(const Span& span);

/// Reads a name; lower case and leading zeros are accepted. T5 and C5 are the contact where `type`
/// is bool and the value otherwise. bad_request: no such name, not octal, or a number that the
/// model lacks.
Result<Address> parse_address(Model model, std::string_view text, std::optional<DataType> type);
/// True for T5 and C5, which name a contact and a value.
bool needs_type(std::string_view text);
/// "M100-M199", "Y0..Y7" or one device, for an allow list. bad_request: as parse_address; the ends
/// are of two kinds; T or C without N or S; or the range holds a device that is never written.
Result<Span> parse_range(Model model, std::string_view text);
/// Whether the model has every device of `span`; bad_request names the first that it lacks.
Result<void> check_range(Model model, const Span& span);
/// Whether a write may replace exactly these bits: a single bit, whole bytes of a bit device, whole
/// words. bad_request otherwise, where the model lacks some of them, and for M8034-M8037 and M8118.
Result<void> check_write(Model model, const Span& span);

}  // namespace fxagent::fx
