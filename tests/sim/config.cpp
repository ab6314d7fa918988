#include "tests/sim/config.h"

#include <algorithm>
#include <charconv>
#include <cstdint>
#include <initializer_list>
#include <limits>
#include <nlohmann/json.hpp>
#include <set>

#include "tests/sim/memory.h"
#include "tests/sim/plant.h"

namespace fxsim {
namespace {

using nlohmann::json;

[[noreturn]] void fail(const std::string& where, const std::string& what) {
  throw ConfigError(where + ": " + what);
}

void expect_keys(const json& object, std::initializer_list<std::string_view> known,
                 const std::string& where) {
  if (!object.is_object()) fail(where, "an object is expected");
  for (const auto& [key, value] : object.items()) {
    if (std::ranges::find(known, key) != known.end()) continue;
    std::string all;
    for (const auto name : known) all.append(all.empty() ? "" : " ").append(name);
    fail(where + "/" + key, "unknown key; known are: " + all);
  }
}

std::int64_t number(const json& object, const char* key, std::int64_t fallback, std::int64_t least,
                    std::int64_t most, const std::string& where) {
  const auto found = object.find(key);
  if (found == object.end()) return fallback;
  const auto range = std::to_string(least) + " to " + std::to_string(most);
  if (!found->is_number_integer())
    fail(where + "/" + key, "an integer from " + range + " is expected");
  const auto value = found->get<std::int64_t>();
  if (value < least || value > most)
    fail(where + "/" + key, std::to_string(value) + " is not in " + range);
  return value;
}

std::chrono::milliseconds duration(const json& object, const char* key, int fallback,
                                   const std::string& where) {
  return std::chrono::milliseconds(number(object, key, fallback, 0, 3'600'000, where));
}

std::string text(const json& object, const char* key, std::string fallback,
                 const std::string& where) {
  const auto found = object.find(key);
  if (found == object.end()) return fallback;
  if (!found->is_string()) fail(where + "/" + key, "a text is expected");
  return found->get<std::string>();
}

bool flag(const json& object, const char* key, bool fallback, const std::string& where) {
  const auto found = object.find(key);
  if (found == object.end()) return fallback;
  if (!found->is_boolean()) fail(where + "/" + key, "true or false is expected");
  return found->get<bool>();
}

std::string required(const json& object, const char* key, const std::string& where) {
  auto value = text(object, key, "", where);
  if (value.empty()) fail(where + "/" + key, "is missing");
  return value;
}

LineSettings parse_line(const json& plc, const std::string& where) {
  LineSettings line;
  line.pty = text(plc, "pty", "", where);
  if (plc.contains("pty") == plc.contains("tcp"))
    fail(where, "exactly one of \"pty\" (a path) and \"tcp\" (a port) is expected");
  if (plc.contains("pty") && line.pty.empty()) fail(where + "/pty", "a path is expected");
  line.tcp = static_cast<std::uint16_t>(number(plc, "tcp", 0, 0, 65535, where));
  line.baud = static_cast<unsigned>(number(plc, "baud", 9600, 0, 1'000'000, where));
  const auto data_bits = number(plc, "data_bits", 7, 7, 8, where);
  const auto stop_bits = number(plc, "stop_bits", 1, 1, 2, where);
  const auto parity = text(plc, "parity", "even", where);
  if (parity != "even" && parity != "odd" && parity != "none")
    fail(where + "/parity", "even, odd or none is expected, not " + parity);
  line.bits_per_character =
      static_cast<unsigned>(1 + data_bits + (parity == "none" ? 0 : 1) + stop_bits);
  line.turnaround = duration(plc, "turnaround_ms", 5, where);
  line.jitter = duration(plc, "jitter_ms", 0, where);
  line.seed = static_cast<std::uint32_t>(
      number(plc, "seed", 1, 0, std::numeric_limits<std::uint32_t>::max(), where));
  return line;
}

void parse_memory(const json& memory, PlcConfig& plc, const std::string& where) {
  if (!memory.is_object()) fail(where, "an object is expected: device name to value");
  const DeviceMemory devices(*plc.model);
  for (const auto& [name, value] : memory.items()) {
    const auto place = where + "/" + name;
    auto device = parse_device_of(*plc.model, name, place);
    const auto values = value.is_array() ? value : json::array({value});
    for (const auto& one : values) {
      if (!devices.has(device))
        fail(place, std::string(plc.model->name) + " has no " + device_name(device));
      plc.memory.emplace_back(device, parse_value(one, device, place));
      ++device.number;
    }
  }
}

PlcConfig parse_plc(const json& object, const std::string& where) {
  expect_keys(
      object,
      {"name", "protocol", "model", "pty", "tcp", "baud", "data_bits", "parity", "stop_bits",
       "turnaround_ms", "jitter_ms", "seed", "plant", "run", "run_switch", "memory", "faults"},
      where);
  PlcConfig plc;
  plc.name = required(object, "name", where);
  plc.protocol = text(object, "protocol", "fx-programming-port", where);
  if (plc.protocol != "fx-programming-port")
    fail(where + "/protocol", "fx-programming-port is expected, not " + plc.protocol);
  const auto model = text(object, "model", "FX3U", where);
  plc.model = find_model(model);
  if (plc.model == nullptr)
    fail(where + "/model", "no model " + model + "; known are: " + model_names());
  plc.line = parse_line(object, where);
  plc.plant = text(object, "plant", "none", where);
  if (!make_plant(plc.plant))
    fail(where + "/plant", "no plant " + plc.plant + "; known are: " + std::string(kPlantNames));
  plc.run = flag(object, "run", true, where);
  plc.run_switch = flag(object, "run_switch", true, where);
  if (const auto memory = object.find("memory"); memory != object.end())
    parse_memory(*memory, plc, where + "/memory");
  if (const auto faults = object.find("faults"); faults != object.end()) {
    if (!faults->is_array()) fail(where + "/faults", "an array is expected");
    for (std::size_t i = 0; i < faults->size(); ++i)
      plc.faults.push_back(parse_fault((*faults)[i], where + "/faults/" + std::to_string(i)));
  }
  return plc;
}

}  // namespace

Device parse_device_of(const Model& model, std::string_view name, const std::string& where) {
  const auto device = parse_device(name);
  if (!device)
    fail(where, "'" + std::string(name) +
                    "' is no device; write X17 Y0 (octal) M0 S0 D0 TN0 TS0 TC0 CN0 CS0 CC0");
  if (!DeviceMemory(model).has(*device))
    fail(where, std::string(model.name) + " has no " + std::string(name));
  return *device;
}

std::uint32_t parse_value(const json& value, Device device, const std::string& where) {
  const auto bits = width(device.kind);
  if (bits == 1 && value.is_boolean()) return value.get<bool>() ? 1 : 0;
  if (!value.is_number_integer()) fail(where, "an integer is expected, not " + value.dump());
  const auto number = value.get<std::int64_t>();
  const std::int64_t most = (std::int64_t{1} << bits) - 1;
  const std::int64_t least = bits == 1 ? 0 : -(std::int64_t{1} << (bits - 1));
  if (number < least || number > most)
    fail(where, std::to_string(number) + " does not fit " + device_name(device));
  return static_cast<std::uint32_t>(number & most);
}

Fault parse_fault(const json& object, const std::string& where) {
  expect_keys(object,
              {"kind", "match", "count", "every", "probability", "seed", "ms", "bytes", "hex"},
              where);
  Fault fault;
  const auto kind_name = required(object, "kind", where);
  const auto kind = find_fault(kind_name);
  if (!kind) fail(where + "/kind", "no fault " + kind_name + "; known are: " + fault_names());
  fault.kind = *kind;
  const auto match_name = text(object, "match", "any", where);
  const auto match = find_match(match_name);
  if (!match)
    fail(where + "/match", "any, read, write, force or enq is expected, not " + match_name);
  fault.match = *match;
  const bool dead = fault.kind == FaultKind::dead;
  fault.count = static_cast<int>(number(object, "count", dead ? -1 : 1, -1, 1'000'000'000, where));
  if (fault.count == 0) fail(where + "/count", "0 would never strike; -1 strikes for ever");
  fault.every = static_cast<int>(number(object, "every", 1, 1, 1'000'000'000, where));
  if (const auto found = object.find("probability"); found != object.end()) {
    if (!found->is_number()) fail(where + "/probability", "a number from 0 to 1 is expected");
    fault.probability = found->get<double>();
    if (fault.probability < 0 || fault.probability > 1)
      fail(where + "/probability", "a number from 0 to 1 is expected");
  }
  fault.seed = static_cast<std::uint32_t>(
      number(object, "seed", 1, 0, std::numeric_limits<std::uint32_t>::max(), where));

  const auto only = [&](const char* key, std::initializer_list<FaultKind> kinds) {
    if (object.contains(key) && std::ranges::find(kinds, fault.kind) == kinds.end())
      fail(where + "/" + key, "means nothing for " + kind_name);
  };
  only("ms", {FaultKind::late, FaultKind::split, FaultKind::drop});
  only("bytes", {FaultKind::truncated, FaultKind::split});
  only("hex", {FaultKind::garbage_before, FaultKind::noise_after});
  int usual_ms = 0;
  if (fault.kind == FaultKind::late) usual_ms = 500;
  if (fault.kind == FaultKind::split) usual_ms = 20;
  if (fault.kind == FaultKind::drop) usual_ms = 100;
  fault.delay = duration(object, "ms", usual_ms, where);
  fault.bytes = static_cast<std::size_t>(
      number(object, "bytes", fault.kind == FaultKind::split ? 4 : 0, 0, 65535, where));
  const auto hex =
      text(object, "hex", fault.kind == FaultKind::noise_after ? "03" : "7F 00 55", where);
  const auto other = from_hex(hex);
  if (!other || other->empty()) fail(where + "/hex", "'" + hex + "' is no hex");
  fault.other = *other;
  return fault;
}

std::vector<PlcConfig> parse_config(const json& root) {
  expect_keys(root, {"plcs"}, "");
  const auto found = root.find("plcs");
  if (found == root.end() || !found->is_array() || found->empty())
    fail("/plcs", "an array of at least one PLC is expected");
  std::vector<PlcConfig> plcs;
  std::set<std::string> names;
  std::set<std::string> paths;
  std::set<std::uint16_t> ports;
  for (std::size_t i = 0; i < found->size(); ++i) {
    const auto where = "/plcs/" + std::to_string(i);
    auto plc = parse_plc((*found)[i], where);
    if (!names.insert(plc.name).second) fail(where + "/name", plc.name + " is there twice");
    if (!plc.line.pty.empty() && !paths.insert(plc.line.pty).second)
      fail(where + "/pty", plc.line.pty + " is there twice");
    if (plc.line.tcp != 0 && !ports.insert(plc.line.tcp).second)
      fail(where + "/tcp", "port " + std::to_string(plc.line.tcp) + " is there twice");
    plcs.push_back(std::move(plc));
  }
  return plcs;
}

json plc_from_short_form(std::string_view form) {
  auto plc = json::object();
  while (!form.empty()) {
    const auto part = form.substr(0, form.find(','));
    form.remove_prefix(std::min(form.size(), part.size() + 1));
    const auto equals = part.find('=');
    if (equals == std::string_view::npos)
      throw ConfigError("--plc: '" + std::string(part) + "' is not key=value");
    const std::string key(part.substr(0, equals));
    const auto value = part.substr(equals + 1);
    std::int64_t integer = 0;
    const auto* end = value.data() + value.size();
    const auto [rest, error] = std::from_chars(value.data(), end, integer);
    if (value == "true" || value == "false") {
      plc[key] = value == "true";
    } else if (key != "name" && error == std::errc{} && rest == end) {
      plc[key] = integer;
    } else {
      plc[key] = value;
    }
  }
  return plc;
}

}  // namespace fxsim
