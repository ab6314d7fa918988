// The simulated FX models: which devices each one has, and how a device is named.
// A Modbus device counts as a model too: four rows of 65,536.
// Source: MELSEC FX programming manuals' device tables; FX0N, FX1S and FX3S are from general
// product knowledge. Nothing here was checked against a genuine PLC.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace fxsim {

/// One row of devices. Numbers inside a row are linear and start at the row's own zero:
/// X17 is x 15, M8013 is special_m 13, D8001 is special_d 1, CN235 is c_value32 35.
enum class Kind : std::uint8_t {
  s,
  x,
  y,
  t_contact,
  t_coil,
  t_value,
  m,
  special_m,
  c_contact,
  c_coil,
  c_value,
  c_value32,
  d,
  special_d,
  r,  // extension registers, FX3
  coil,
  discrete_input,
  holding_register,
  input_register,
};
inline constexpr std::size_t kKinds = 19;

/// Bits in one device of the kind: 1, 16 or 32.
unsigned width(Kind kind);

struct Range {
  unsigned first;
  unsigned last;  // inclusive
};

/// What the E commands (E00, E10, E7, E8) address on a model.
enum class ExtendedSet : std::uint8_t { none, fx1n_fx2n, fx3 };

struct Model {
  std::string_view name;
  ExtendedSet extended;
  std::uint16_t type_word;           // D8001: type and version
  std::uint16_t extended_type_word;  // D8101
  std::array<std::vector<Range>, kKinds> ranges;

  const std::vector<Range>& of(Kind kind) const { return ranges[static_cast<std::size_t>(kind)]; }
};

/// Null for a name that is not simulated.
const Model* find_model(std::string_view name);
/// "FX0N FX1S ...", for error texts.
std::string model_names();
/// What every Modbus device has.
const Model& modbus_model();

struct Device {
  Kind kind;
  unsigned number;  // linear in its row

  bool operator==(const Device&) const = default;
};

/// "X17" (octal), "M8013", "TN5", "TS5", "TC5" (coil), "CN200", "CS0", "CC0", "S20", "D100", "R0";
/// of a Modbus device "co:0", "di:0", "hr:0" and "ir:0", addresses as on the wire.
/// Nothing if it is no device name; whether a model has the device is not asked here.
std::optional<Device> parse_device(std::string_view text);
std::string device_name(Device device);

}  // namespace fxsim
