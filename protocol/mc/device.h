// The devices of Mitsubishi PLCs: places in their memory, such as the input X1F, the relay M100,
// the register D100 and the timer value STN5. The letters name the kind of memory, the number the
// place in it. Has the devices of each model, their names, and their codes in frames, for the
// protocols of MC and of FX (fx/device.h).
// Sources: SH-080008 (device codes), JY997D56001 (FX5), JY997D45801 and JY997D18101 (FX3G, FX3U),
// JY992D69901, 7.7.2 (FX0N to FX2N). FX3S is from product knowledge and unverified. The parameters
// of a Q, L or iQ-R set the number of devices of a kind; here is the largest number possible.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "protocol/value/point.h"
#include "protocol/value/result.h"

namespace fxagent::mc {

// ---- models ------------------------------------------------------------------------------------

enum class Model : std::uint8_t {
  unknown,     ///< any model with 3E, 4E or C frames: the widest
  unknown_fx,  ///< an FX up to the FX3: treated as FX3U, the widest
  fx0n,
  fx1s,
  fx1n,
  fx2n,
  fx3s,
  fx3g,
  fx3u,
  fx5u,
  fx5uj,
  fx5s,
  q,
  l,
  iq_r,
  q_by_1e,  ///< the devices of a Q or L that 1E frames reach
  l_by_1e,
};
/// Returns "FX5U" or "iQ-R"; empty for an unknown model.
std::string_view to_string(Model model);
/// Finds a model by its name or by that of its kin: "FX3UC" is an FX3U. nullopt: another name.
std::optional<Model> model_named(std::string_view name);
/// Returns the model as 1E frames see it: a Q or L has only the devices of an A series PLC, and an
/// unknown model is an FX3.
Model seen_by_1e(Model model);

/// The series decides numbering, codes and limits.
enum class Series : std::uint8_t {
  unknown,
  fx,   ///< FX0N to FX3S, which have no MC frames
  fx3,  ///< FX3G and FX3U
  iq_f,
  q_l,
  iq_r,
};
Series series_of(Model model);
bool is_fx(Model model);  ///< FX0N to FX3U

// ---- names -------------------------------------------------------------------------------------

// See the functions of AddressSpace with these names. Device names may be in lower case and have
// leading zeros. X and Y are numbered in octal on an FX and in hexadecimal on others: above 7 they
// are refused while the model is unknown.
Result<Address> parse_address(Model model, std::string_view text, std::optional<DataType> type);
bool needs_type(std::string_view text);
Result<Span> parse_range(Model model, std::string_view text);
Result<void> check_range(Model model, const Span& span);
/// Accepts any bits of a bit device and whole devices of other kinds, but never M8034-M8037 and
/// M8118 of an FX up to the FX3 and SM8034-SM8037 of an FX5: they switch RUN and STOP or all
/// outputs, or open the program memory.
Result<void> check_write(Model model, const Span& span);
/// Returns the name of the device that contains the span's first bit: "Y17", "M8000", "W1F".
std::string device_name(Model model, const Span& span);

// ---- memory ------------------------------------------------------------------------------------

/// Kinds of device memory. M8000 up and D8000 up of an FX up to the FX3 are separate memory, and
/// its CN200-CN255 are 32 bits wide: each is a space that counts from its first device.
enum class Space : std::uint16_t {
  x,   ///< inputs
  y,   ///< outputs
  dx,  ///< the same two, read directly from the modules
  dy,
  m,          ///< relays: bits of the PLC's program, like L, F, V, B and S
  special_m,  ///< M8000 up of an FX
  l,
  f,
  v,
  b,
  sb,
  s,
  sm,  ///< state of the PLC itself, like SD
  ts,  ///< contacts, coils and values of timers, retentive timers and counters
  tc,
  tn,
  sts,
  stc,
  stn,
  cs,
  cc,
  cn,
  cn32,  ///< CN200 up of an FX
  lcs,
  lcc,
  lcn,  ///< 32 bits, like the next two and LZ
  ltn,
  lstn,
  d,          ///< registers: words of the PLC's program, like W, R, ZR and RD
  special_d,  ///< D8000 up of an FX
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

/// Device numbers, both ends inclusive. X17 of an FX is number 15.
struct Numbers {
  std::uint32_t first = 0;
  std::uint32_t last = 0;
};
/// Returns the numbers of a model in a space: one run, or two (counter contacts of FX0N and FX1S);
/// none if the model lacks the kind. An unknown model has the largest number of all models.
std::vector<Numbers> numbers_of(Model model, Space space);
bool has_device(Model model, Space space, std::uint32_t number);
/// Returns the bits of `numbers` in their space.
Span span_of(Space space, Numbers numbers);
std::string device_name(Model model, Space space, std::uint32_t number);

// ---- codes in frames ---------------------------------------------------------------------------

enum class Numbering : std::uint8_t { decimal, hexadecimal, octal_on_fx };
struct DeviceKind {
  std::string_view letters;  ///< "STN"; padded with blanks or asterisks also the ASCII code of iQ-R
  std::uint8_t binary = 0;   ///< code in 3E, 4E, 3C and 4C frames
  std::string_view ascii;    ///< two characters; empty if only the long names of iQ-R exist
  std::uint16_t one_e = 0;   ///< two letters, the first in the high byte; 0: 1E has none
  Numbering numbering = Numbering::decimal;
  std::uint32_t bits = 1;          ///< bits of one device: 1, 16 or 32
  std::uint32_t first_number = 0;  ///< number of the device at bit 0 of the space
  Unit number_unit = Unit::word;   ///< unit of one device that is not a bit
};
const DeviceKind& kind_of(Space space);
/// Bits of one device of a Span's space.
inline std::uint32_t width_of(std::uint16_t space) {
  return kind_of(static_cast<Space>(space)).bits;
}
/// Return the kind for a code of 3E and C frames, or of 1E; nullopt: no such code. In 1E, M8000 up,
/// D8000 up and CN32 have the codes of M, D and CN, which are returned.
std::optional<Space> space_coded(std::uint8_t binary);
std::optional<Space> space_coded(std::string_view ascii);
std::optional<Space> space_coded_1e(std::uint16_t one_e);
/// Returns the base of device numbers in ASCII code: 8, 10 or 16. Names have the same, except that
/// those of ZR are decimal. 16 for X and Y of an unknown model.
std::uint32_t ascii_base_of(Model model, Space space);

}  // namespace fxagent::mc
