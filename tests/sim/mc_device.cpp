#include "tests/sim/mc_device.h"

#include <algorithm>
#include <array>

namespace fxsim {
namespace {

constexpr unsigned kPointsPerWord = 16;

struct Row {
  std::uint8_t code;
  std::string_view letters;       // two, padded with *
  std::string_view long_letters;  // iQ-R, four
  Kind kind;                      // X and Y: numbered as on iQ-F
};

// LT, LST and RD have only names of four letters. DX and DY are the same points as X and Y.
constexpr auto kRows = std::to_array<Row>({
    {0x9C, "X*", "X***", Kind::x},          {0x9D, "Y*", "Y***", Kind::y},
    {0xA2, "DX", "DX**", Kind::hex_x},      {0xA3, "DY", "DY**", Kind::hex_y},
    {0x90, "M*", "M***", Kind::m},          {0x92, "L*", "L***", Kind::l},
    {0x93, "F*", "F***", Kind::f},          {0x94, "V*", "V***", Kind::v},
    {0xA0, "B*", "B***", Kind::b},          {0xA1, "SB", "SB**", Kind::sb},
    {0xA8, "D*", "D***", Kind::d},          {0xB4, "W*", "W***", Kind::w},
    {0xAF, "R*", "R***", Kind::r},          {0xB0, "ZR", "ZR**", Kind::zr},
    {0x91, "SM", "SM**", Kind::sm},         {0xA9, "SD", "SD**", Kind::sd},
    {0xB5, "SW", "SW**", Kind::sw},         {0xC1, "TS", "TS**", Kind::t_contact},
    {0xC0, "TC", "TC**", Kind::t_coil},     {0xC2, "TN", "TN**", Kind::t_value},
    {0xC7, "SS", "STS*", Kind::st_contact}, {0xC6, "SC", "STC*", Kind::st_coil},
    {0xC8, "SN", "STN*", Kind::st_value},   {0xC4, "CS", "CS**", Kind::c_contact},
    {0xC3, "CC", "CC**", Kind::c_coil},     {0xC5, "CN", "CN**", Kind::c_value},
    {0x98, "S*", "S***", Kind::s},          {0xCC, "Z*", "Z***", Kind::z},
    {0x51, "", "LTS*", Kind::lt_contact},   {0x50, "", "LTC*", Kind::lt_coil},
    {0x52, "", "LTN*", Kind::lt_value},     {0x59, "", "LSTS", Kind::lst_contact},
    {0x58, "", "LSTC", Kind::lst_coil},     {0x5A, "", "LSTN", Kind::lst_value},
    {0x55, "", "LCS*", Kind::lc_contact},   {0x54, "", "LCC*", Kind::lc_coil},
    {0x56, "", "LCN*", Kind::lc_value},     {0x62, "LZ", "LZ**", Kind::lz},
    {0x2C, "RD", "RD**", Kind::rd},
});

std::optional<Kind> kind_for(const Row& row, Family family) {
  if (family == Family::iq_f)
    return row.kind == Kind::hex_x || row.kind == Kind::hex_y ? std::nullopt
                                                              : std::optional(row.kind);
  if (row.kind == Kind::x) return Kind::hex_x;
  if (row.kind == Kind::y) return Kind::hex_y;
  return row.kind;
}

Device behind(Device device, unsigned by) { return {device.kind, device.number + by}; }

}  // namespace

std::optional<Kind> mc_kind_of_code(std::uint32_t code, Family family) {
  const auto row = std::ranges::find(kRows, code, &Row::code);
  return row == kRows.end() ? std::nullopt : kind_for(*row, family);
}

std::optional<Kind> mc_kind_of_letters(std::string_view letters, bool long_names, Family family) {
  const auto row = long_names ? std::ranges::find(kRows, letters, &Row::long_letters)
                              : std::ranges::find(kRows, letters, &Row::letters);
  return row == kRows.end() ? std::nullopt : kind_for(*row, family);
}

unsigned mc_base_of(Kind kind) {
  switch (kind) {
    case Kind::x:
    case Kind::y:
      return 8;
    case Kind::hex_x:
    case Kind::hex_y:
    case Kind::b:
    case Kind::w:
    case Kind::sb:
    case Kind::sw:
    case Kind::zr:
      return 16;
    default:
      return 10;
  }
}

bool is_bit(Kind kind) { return width(kind) == 1; }

bool has_row(const DeviceMemory& memory, Device first, std::uint64_t count) {
  return std::ranges::any_of(memory.model().of(first.kind), [&](const Range& range) {
    return first.number >= range.first && first.number + count <= std::uint64_t{range.last} + 1;
  });
}

std::uint32_t word_at(const DeviceMemory& memory, Device head) {
  if (!is_bit(head.kind)) return memory.get(head) & 0xFFFFU;
  std::uint32_t word = 0;
  for (unsigned i = 0; i < kPointsPerWord; ++i) word |= memory.get(behind(head, i)) << i;
  return word;
}

void set_word_at(Plc& plc, Device head, std::uint32_t value) {
  if (!is_bit(head.kind)) {
    plc.write(head, value);
    return;
  }
  for (unsigned i = 0; i < kPointsPerWord; ++i) plc.write(behind(head, i), (value >> i) & 1U);
}

std::uint32_t double_at(const DeviceMemory& memory, Device head) {
  if (width(head.kind) == 32) return memory.get(head);
  const auto step = is_bit(head.kind) ? kPointsPerWord : 1U;
  return word_at(memory, head) | word_at(memory, behind(head, step)) << 16U;
}

void set_double_at(Plc& plc, Device head, std::uint32_t value) {
  if (width(head.kind) == 32) {
    plc.write(head, value);
    return;
  }
  set_word_at(plc, head, value & 0xFFFFU);
  set_word_at(plc, behind(head, is_bit(head.kind) ? kPointsPerWord : 1U), value >> 16U);
}

}  // namespace fxsim
