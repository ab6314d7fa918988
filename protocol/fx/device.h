// Names of FX devices (X17, M8000, TN5, D100.F, K4M0) and their memory. Shared by the FX protocols;
// each protocol decides which devices it reaches.
// Sources: FX Communication User's Manual JY992D69901, 7.7.2 (ranges of FX0N to FX2N);
// FX3U-ENET manual, device table (FX3G, FX3U). FX3S is from product knowledge and unverified.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "protocol/value/point.h"
#include "protocol/value/result.h"

namespace fxagent::fx {

enum class Model : std::uint8_t { unknown, fx0n, fx1s, fx1n, fx2n, fx3s, fx3g, fx3u };

/// Returns the seven models, in the order of the enumeration.
std::span<const std::string_view> model_names();
/// Returns further names that the config may use: FX3UC and others, which have the memory of the
/// model without the last letter.
std::span<const std::string_view> kin_names();
/// Returns "FX3U"; empty for unknown.
std::string_view to_string(Model model);
/// Returns nullopt if `name` is in neither model_names() nor kin_names().
std::optional<Model> model_named(std::string_view name);

/// The spaces of an FX. M8000 up and D8000 up are separate memory, and CN200-CN255 are 32 bits
/// wide. So each of them is a space that counts from its first device.
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
  /// Coils of timers and counters: named when a frame is explained, never addressed.
  tc,
  cc,
};
inline constexpr std::uint16_t kSpaces = 15;

constexpr std::uint16_t id(Space space) { return static_cast<std::uint16_t>(space); }

struct DeviceKind {
  std::string_view letters;
  Unit unit = Unit::bit;
  std::uint32_t bits = 1;          ///< bits of one device
  std::uint32_t first_number = 0;  ///< number of the device at bit 0 of the space
  bool octal = false;
};
const DeviceKind& kind_of(Space space);

/// Device numbers, both ends inclusive; X17 is number 15.
struct Numbers {
  std::uint32_t first = 0;
  std::uint32_t last = 0;
};
/// Returns the numbers of a model in a space: one run, or two (counter contacts of FX0N and FX1S);
/// none if the model lacks the kind. An unknown model has the numbers of the widest, the FX3U.
std::vector<Numbers> numbers_of(Model model, Space space);

/// Returns the bits of `numbers` in their space.
Span span_of(Space space, Numbers numbers);
/// Returns "Y17", "M8000", "CN200".
std::string device_name(Space space, std::uint32_t number);
/// Returns the name of the device that contains the span's first bit.
std::string device_name(const Span& span);

// As the functions of AddressSpace with these names. Names may be in lower case and have leading
// zeros.
Result<Address> parse_address(Model model, std::string_view text, std::optional<DataType> type);
bool needs_type(std::string_view text);
Result<Span> parse_range(Model model, std::string_view text);
Result<void> check_range(Model model, const Span& span);
/// Accepts a single bit, whole bytes of a bit device, and whole words, but never M8034-M8037 and
/// M8118.
Result<void> check_write(Model model, const Span& span);

}  // namespace fxagent::fx
