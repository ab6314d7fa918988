// The simulated models: the devices of each one, and the device names. A Modbus device is also a
// model: four rows of 65,536.
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
  // iQ-F, Q, L and iQ-R only.
  hex_x,  // X and Y of families that number them in hexadecimal
  hex_y,
  l,
  f,
  v,
  b,
  w,
  sb,
  sw,
  sm,
  sd,
  z,
  zr,
  rd,
  st_contact,
  st_coil,
  st_value,
  lt_contact,
  lt_coil,
  lt_value,
  lst_contact,
  lst_coil,
  lst_value,
  lc_contact,
  lc_coil,
  lc_value,
  lz,
};
inline constexpr std::size_t kKinds = 46;

/// Bits in one device of the kind: 1, 16 or 32.
unsigned width(Kind kind);

struct Range {
  unsigned first;
  unsigned last;  // inclusive
};

/// Devices of a row that answer as if they did not exist.
struct Hole {
  Kind kind;
  Range range;
};

/// The address map of the E commands (E00, E10, E7, E8) on a model.
enum class ExtendedSet : std::uint8_t { none, fx1n_fx2n, fx3 };

/// Models that share device names and MC protocol behaviour.
enum class Family : std::uint8_t { fx, modbus, iq_f, q_l, iq_r };

struct Model {
  std::string_view name;
  ExtendedSet extended;
  std::uint16_t type_word;           // D8001: type and version
  std::uint16_t extended_type_word;  // D8101
  std::array<std::vector<Range>, kKinds> ranges;
  Family family = Family::fx;
  std::string_view type_name{};  // reply to command 0101
  std::uint16_t type_code = 0;

  const std::vector<Range>& of(Kind kind) const { return ranges[static_cast<std::size_t>(kind)]; }
};

/// Returns an FX model, or null if the name is not simulated.
const Model* find_model(std::string_view name);
/// "FX0N FX1S ...", for error texts.
std::string model_names();
/// Returns a model whose own ports use 3E, 4E, 3C and 4C, or null if the name is not simulated.
const Model* find_mc_model(std::string_view name);
std::string mc_model_names();
/// The devices of every Modbus device.
const Model& modbus_model();

struct Device {
  Kind kind;
  unsigned number;  // linear in its row

  bool operator==(const Device&) const = default;
};

/// Returns the device of an FX with this number in its name: M8000, D8000 and CN200 begin rows of
/// their own.
Device fx_device(Kind kind, unsigned number);
/// Parses "X17" (octal), "M8013", "TN5", "TS5", "TC5" (coil), "CN200", "CS0", "CC0", "S20", "D100",
/// "R0"; for a Modbus device "co:0", "di:0", "hr:0" and "ir:0", addresses as on the wire.
/// Families number differently: X and Y are octal on fx and iq_f and hexadecimal elsewhere; M8000,
/// D8000 and CN200 begin rows of their own on fx only.
/// Returns nullopt if the text is not a device name. Does not check that a model has the device.
std::optional<Device> parse_device(std::string_view text, Family family = Family::fx);
std::string device_name(Device device);

}  // namespace fxsim
