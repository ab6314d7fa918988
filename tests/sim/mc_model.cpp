// The models whose own ports use 3E, 4E, 3C and 4C.
// Sources: default parameters from the FX5 and MELSEC device tables, as far as known here; the
// ranges of a real PLC depend on its parameters. Type names and codes of Q and iQ-R as printed and
// as captured; those of FX5 and L are from general product knowledge.
#include "tests/sim/model.h"

namespace fxsim {
namespace {

struct Row {
  Kind kind;
  unsigned count;  // counted from 0
};

Model make_model(std::string_view name, Family family, std::string_view type_name,
                 std::uint16_t type_code, const std::vector<Row>& rows) {
  Model model{name, ExtendedSet::none, 0, 0, {}, family, type_name, type_code};
  for (const auto& [kind, count] : rows)
    model.ranges[static_cast<std::size_t>(kind)] = {{0, count - 1}};
  return model;
}

std::vector<Row> joined(std::vector<Row> rows, const std::vector<Row>& more) {
  rows.insert(rows.end(), more.begin(), more.end());
  return rows;
}

/// Timers, retentive timers and counters, each with contact, coil and value.
std::vector<Row> timers(unsigned t, unsigned st, unsigned c) {
  return {{Kind::t_contact, t},   {Kind::t_coil, t},   {Kind::t_value, t},
          {Kind::st_contact, st}, {Kind::st_coil, st}, {Kind::st_value, st},
          {Kind::c_contact, c},   {Kind::c_coil, c},   {Kind::c_value, c}};
}

std::vector<Row> iq_f_rows() {
  return joined(timers(512, 16, 256), {{Kind::x, 1024},
                                       {Kind::y, 1024},
                                       {Kind::m, 7680},
                                       {Kind::l, 7680},
                                       {Kind::f, 128},
                                       {Kind::b, 256},
                                       {Kind::sb, 512},
                                       {Kind::s, 4096},
                                       {Kind::sm, 10000},
                                       {Kind::sd, 12000},
                                       {Kind::d, 8000},
                                       {Kind::w, 512},
                                       {Kind::sw, 512},
                                       {Kind::r, 32768},
                                       {Kind::z, 20},
                                       {Kind::lz, 2},
                                       {Kind::lc_contact, 64},
                                       {Kind::lc_coil, 64},
                                       {Kind::lc_value, 64}});
}

std::vector<Row> q_l_rows() {
  return joined(timers(2048, 2048, 1024), {{Kind::hex_x, 0x2000},
                                           {Kind::hex_y, 0x2000},
                                           {Kind::m, 8192},
                                           {Kind::l, 8192},
                                           {Kind::f, 2048},
                                           {Kind::v, 2048},
                                           {Kind::b, 0x2000},
                                           {Kind::sb, 0x800},
                                           {Kind::s, 8192},
                                           {Kind::sm, 2048},
                                           {Kind::sd, 2048},
                                           {Kind::d, 12288},
                                           {Kind::w, 0x2000},
                                           {Kind::sw, 0x800},
                                           {Kind::r, 32768},
                                           {Kind::zr, 4'184'064},
                                           {Kind::z, 20}});
}

std::vector<Row> iq_r_rows() {
  return joined(timers(1024, 1024, 512),
                {{Kind::hex_x, 0x3000},   {Kind::hex_y, 0x3000},     {Kind::m, 12288},
                 {Kind::l, 8192},         {Kind::f, 2048},           {Kind::v, 2048},
                 {Kind::b, 0x2000},       {Kind::sb, 0x800},         {Kind::s, 8192},
                 {Kind::sm, 4096},        {Kind::sd, 4096},          {Kind::d, 18432},
                 {Kind::w, 0x2000},       {Kind::sw, 0x800},         {Kind::r, 32768},
                 {Kind::zr, 4'184'064},   {Kind::rd, 524'288},       {Kind::z, 20},
                 {Kind::lz, 2},           {Kind::lt_contact, 1024},  {Kind::lt_coil, 1024},
                 {Kind::lt_value, 1024},  {Kind::lst_contact, 1024}, {Kind::lst_coil, 1024},
                 {Kind::lst_value, 1024}, {Kind::lc_contact, 512},   {Kind::lc_coil, 512},
                 {Kind::lc_value, 512}});
}

const std::vector<Model>& models() {
  static const std::vector<Model> all = {
      make_model("FX5U", Family::iq_f, "FX5U-32MR/ES", 0x4A21, iq_f_rows()),
      make_model("FX5UC", Family::iq_f, "FX5UC-32MT/D", 0x4A91, iq_f_rows()),
      make_model("FX5UJ", Family::iq_f, "FX5UJ-24MR/ES", 0x4B0D, iq_f_rows()),
      make_model("FX5S", Family::iq_f, "FX5S-30MR/ES", 0x4B59, iq_f_rows()),
      make_model("Q", Family::q_l, "Q02UCPU", 0x0263, q_l_rows()),
      make_model("L", Family::q_l, "L26CPU-BT", 0x0542, q_l_rows()),
      make_model("iQ-R", Family::iq_r, "R120PCPU", 0x4844, iq_r_rows()),
  };
  return all;
}

}  // namespace

const Model* find_mc_model(std::string_view name) {
  for (const auto& model : models())
    if (model.name == name) return &model;
  return nullptr;
}

std::string mc_model_names() {
  std::string names;
  for (const auto& model : models()) names.append(names.empty() ? "" : " ").append(model.name);
  return names;
}

}  // namespace fxsim
