// Names of devices in the MC protocol (X1F, ZR100, STN5, SM400, D100.F, K4M0), the memory they
// stand for and the codes that the frames have for them. Shared by 1E, 3E, 4E and the C frames.
// Sources: SH-080008 (device codes), JY997D56001 (FX5), JY997D45801 and JY997D18101 (FX3 by 1E).
// How many of a kind a Q, L or iQ-R has is set in its parameters: here is the most that it could
// have.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "protocol/point.h"
#include "protocol/result.h"

namespace fxagent::mc {

enum class Model : std::uint8_t {
  unknown,      ///< any that speaks 3E, 4E or C frames: the widest
  unknown_fx3,  ///< an FX3 behind its Ethernet module: as FX3U
  fx3u,
  fx3g,
  fx5u,
  fx5uj,
  fx5s,
  q,
  l,
  iq_r,
  q_by_1e,  ///< what 1E frames reach of a Q or L
  l_by_1e,
};

/// What numbers, codes and limits go by.
enum class Series : std::uint8_t { unknown, fx3, iq_f, q_l, iq_r };
Series series_of(Model model);

/// Models with 3E, 4E and C frames, and those with 1E; each with further names for them.
std::span<const std::string_view> model_names();
std::span<const std::string_view> kin_names();
std::span<const std::string_view> one_e_model_names();
std::span<const std::string_view> one_e_kin_names();
/// "FX5U", "iQ-R"; empty where it is unknown.
std::string_view to_string(Model model);
/// Of all four lists above; nullopt for any other name.
std::optional<Model> model_named(std::string_view name);
/// The model as 1E frames see it: those of Q and L have the devices of an A series PLC alone.
Model seen_by_1e(Model model);

/// The kinds of device memory. M8000 up and D8000 up of an FX3 are memory of their own, and its
/// CN200-CN255 are 32 bits wide: each is a space that counts from its first device.
enum class Space : std::uint16_t {
  x,
  y,
  dx,
  dy,
  m,
  special_m,  ///< M8000 up of an FX3
  l,
  f,
  v,
  b,
  sb,
  s,
  sm,
  ts,  ///< contacts, coils and values of timers, retentive timers and counters
  tc,
  tn,
  sts,
  stc,
  stn,
  cs,
  cc,
  cn,
  cn32,  ///< CN200 up of an FX3
  lcs,
  lcc,
  lcn,  ///< 32 bits, as are the next two and LZ
  ltn,
  lstn,
  d,
  special_d,  ///< D8000 up of an FX3
  w,
  sw,
  sd,
  r,
  zr,
  rd,
  z,
  lz,
};
inline constexpr std::uint16_t kSpaces = 38;

constexpr std::uint16_t id(Space space) { return static_cast<std::uint16_t>(space); }

enum class Numbering : std::uint8_t { decimal, hexadecimal, octal_on_fx };

struct DeviceKind {
  std::string_view letters;  ///< "STN"; behind blanks or asterisks also the code of iQ-R in ASCII
  std::uint8_t binary = 0;   ///< code of 3E, 4E, 3C and 4C
  std::string_view ascii;    ///< two characters; empty where only the long ones of iQ-R exist
  std::uint16_t one_e = 0;   ///< two letters, the first one in the high byte; 0: 1E has none
  Numbering numbering = Numbering::decimal;
  std::uint32_t bits = 1;          ///< of one device: 1, 16 or 32
  std::uint32_t first_number = 0;  ///< the device at bit 0 of the space
};
const DeviceKind& kind_of(Space space);
/// The kind behind a code of 3E and C frames; of 1E, where CN32 and M8000 up have the codes of CN
/// and M. nullopt: no such code.
std::optional<Space> space_coded(std::uint8_t binary);
std::optional<Space> space_coded(std::string_view ascii);
std::optional<Space> space_coded_1e(std::uint16_t one_e);
/// 8, 10 or 16; of X and Y of an unknown model 16.
std::uint32_t base_of(Model model, Space space);

/// Device numbers, both ends included; X17 of an FX is number 15.
struct Numbers {
  std::uint32_t first = 0;
  std::uint32_t last = 0;
};
/// nullopt where the model has none of the kind. An unknown model has the most of all of them.
std::optional<Numbers> numbers_of(Model model, Space space);

/// The bits of `numbers` in their space.
Span span_of(Space space, Numbers numbers);
/// "Y17", "M8000", "W1F".
std::string device_name(Model model, Space space, std::uint32_t number);
/// The name of the device that holds the span's first bit.
std::string device_name(Model model, const Span& span);

/// Reads a name; lower case and leading zeros are accepted. T5, ST5, C5 and LC5 are the contact
/// where `type` is bool and the value otherwise. bad_request: no such name, digits of another base,
/// a number that the model lacks; or X or Y above 7 where the model is unknown, for nobody can tell
/// the base.
Result<Address> parse_address(Model model, std::string_view text, std::optional<DataType> type);
/// True for T5, ST5, C5 and LC5, which name a contact and a value.
bool needs_type(std::string_view text);
/// "M100-M199", "W0..W1F" or one device, for an allow list. bad_request: as parse_address; the ends
/// are of two kinds; T, ST, C or LC without N, S or C; or the range holds a device that is never
/// written.
Result<Span> parse_range(Model model, std::string_view text);
/// Whether the model has every device of `span`; bad_request names the first that it lacks.
Result<void> check_range(Model model, const Span& span);
/// Whether a write may replace exactly these bits: any bits of a bit device, whole devices of the
/// others. bad_request otherwise, where the model lacks some of them, and for what switches RUN and
/// STOP or all outputs (M8034-M8037 and M8118 of an FX3, SM8034-SM8037 of an FX5).
Result<void> check_write(Model model, const Span& span);

}  // namespace fxagent::mc
