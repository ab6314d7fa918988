#include "tests/sim/config.h"

#include <algorithm>
#include <charconv>
#include <chrono>
#include <cstdint>
#include <initializer_list>
#include <limits>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <utility>

#include "tests/sim/json_keys.h"
#include "tests/sim/memory.h"
#include "tests/sim/plant.h"
#include "tests/sim/programming_port.h"

namespace fxsim {
namespace {

using nlohmann::json;

/// The default line settings of a protocol.
struct UsualLine {
  int baud;
  int data_bits;
  const char* parity;
  int turnaround_ms;
};

UsualLine usual_line(Protocol protocol) {
  switch (protocol) {
    case Protocol::modbus_rtu:
    case Protocol::mc_3c:
    case Protocol::mc_4c:
      return {9600, 8, "even", 5};
    case Protocol::modbus_tcp:
    case Protocol::mc_1e:
    case Protocol::mc_3e:
    case Protocol::mc_4e:
      return {0, 8, "none", 0};
    default:
      return {9600, 7, "even", 5};
  }
}

LineSettings parse_line(const json& plc, Protocol protocol, const std::string& where) {
  const auto usual = usual_line(protocol);
  LineSettings line;
  const bool ethernet = protocol == Protocol::modbus_tcp || is_mc_ethernet(protocol);
  const std::string name(protocol_name(protocol));
  line.pty = text(plc, "pty", "", where);
  if (plc.contains("pty") + plc.contains("tcp") + plc.contains("udp") != 1)
    fail(where, is_mc_ethernet(protocol) ? "exactly one of \"tcp\" and \"udp\" (a port) is expected"
                                         : "exactly one of \"pty\" (a path) and \"tcp\" (a port) "
                                           "is expected; \"udp\" is for mc-1e, "
                                           "mc-3e and mc-4e");
  if (plc.contains("pty") && line.pty.empty()) fail(where + "/pty", "a path is expected");
  if (ethernet && plc.contains("pty")) fail(where + "/pty", name + " needs \"tcp\"");
  line.tcp = static_cast<std::uint16_t>(number(plc, "tcp", 0, 0, 65535, where));
  if (plc.contains("udp"))
    line.udp = static_cast<std::uint16_t>(number(plc, "udp", 0, 0, 65535, where));
  line.udp_peer_port = static_cast<std::uint16_t>(number(plc, "udp_peer_port", 0, 0, 65535, where));
  if (line.udp_peer_port != 0 && !line.udp) fail(where + "/udp_peer_port", "needs \"udp\"");
  line.baud = static_cast<unsigned>(number(plc, "baud", usual.baud, 0, 1'000'000, where));
  const auto data_bits = number(plc, "data_bits", usual.data_bits, 7, 8, where);
  const auto stop_bits = number(plc, "stop_bits", 1, 1, 2, where);
  const auto parity = text(plc, "parity", usual.parity, where);
  if (parity != "even" && parity != "odd" && parity != "none")
    fail(where + "/parity", "even, odd or none is expected, not " + parity);
  if (protocol == Protocol::modbus_rtu && data_bits != 8)
    fail(where + "/data_bits", "modbus-rtu takes 8");
  line.bits_per_character =
      static_cast<unsigned>(1 + data_bits + (parity == "none" ? 0 : 1) + stop_bits);
  line.parity = parity;
  line.two_stop_bits = stop_bits == 2;
  line.strict = flag(plc, "strict_line", false, where);
  if (line.strict && (line.pty.empty() || line.baud == 0))
    fail(where + "/strict_line", "needs a \"pty\" and a \"baud\" other than 0");
  line.gateway = flag(plc, "gateway", false, where);
  line.connections = static_cast<unsigned>(number(plc, "connections", 0, 0, 1000, where));
  return line;
}

ResponseTime parse_response(const json& plc, Protocol protocol, const std::string& where) {
  ResponseTime response;
  response.turnaround = duration(plc, "turnaround_ms", usual_line(protocol).turnaround_ms, where);
  response.jitter = duration(plc, "jitter_ms", 0, where);
  response.seed = static_cast<std::uint32_t>(
      number(plc, "seed", 1, 0, std::numeric_limits<std::uint32_t>::max(), where));
  return response;
}

ComputerLinkSettings parse_computer_link(const json& plc, const std::string& where) {
  ComputerLinkSettings link;
  link.station = static_cast<unsigned>(number(plc, "station", 0, 0, 15, where));
  link.format = static_cast<unsigned>(number(plc, "format", 1, 1, 4, where));
  if (link.format != 1 && link.format != 4) fail(where + "/format", "1 or 4 is expected");
  link.sum_check = flag(plc, "sum_check", true, where);
  return link;
}

const json& array_at(const json& object, const char* key, const std::string& where) {
  const auto& found = object.at(key);
  if (!found.is_array()) fail(where + "/" + key, "an array is expected");
  return found;
}

/// Parses "hr:100-hr:119", or a single device.
Hole parse_hole(const Model& model, const json& value, const std::string& where) {
  if (!value.is_string()) fail(where, "a text is expected, as hr:100-hr:119 or D100-D119");
  const auto span = value.get<std::string>();
  const auto dash = std::min(span.find('-'), span.size());
  const auto first = parse_device_of(model, span.substr(0, dash), where);
  const auto last =
      dash == span.size() ? first : parse_device_of(model, span.substr(dash + 1), where);
  if (first.kind != last.kind || first.number > last.number)
    fail(where, "'" + span + "' has no first and last device of one row");
  return {first.kind, {first.number, last.number}};
}

std::vector<Hole> parse_holes(const json& plc, const Model& model, const std::string& where) {
  std::vector<Hole> found;
  if (!plc.contains("holes")) return found;
  const auto& holes = array_at(plc, "holes", where);
  for (std::size_t i = 0; i < holes.size(); ++i)
    found.push_back(parse_hole(model, holes[i], where + "/holes/" + std::to_string(i)));
  return found;
}

/// True if `key` has the second of two words, false if it has the first or is missing.
bool is_second_of(const json& plc, const char* key, const char* first, const char* second,
                  const std::string& where) {
  const auto word = text(plc, key, first, where);
  if (word != first && word != second)
    fail(where + "/" + key, std::string(first) + " or " + second + " is expected, not " + word);
  return word == second;
}

McSettings parse_mc(const json& plc, Protocol protocol, const Model& model,
                    const std::string& where) {
  McSettings mc;
  mc.family = model.family;
  if (is_second_of(plc, "code", "binary", "ascii", where)) mc.code = McCode::ascii;
  const auto natural = [&](const char* key, unsigned fallback, int most) {
    return static_cast<unsigned>(number(plc, key, fallback, 0, most, where));
  };
  mc.route.network = natural("network", mc.route.network, 255);
  mc.route.pc = natural("pc", mc.route.pc, 255);
  mc.route.module_io = natural("module_io", mc.route.module_io, 65535);
  mc.route.module_station = natural("module_station", mc.route.module_station, 255);
  mc.refuses_foreign = !is_second_of(plc, "wrong_route", "refuse", "silent", where);
  mc.cpu.write_in_run = flag(plc, "write_in_run", true, where);
  mc.cpu.holes = parse_holes(plc, model, where);
  mc.cpu.type_name = text(plc, "type_name", "", where);
  if (mc.cpu.type_name.size() > 16) fail(where + "/type_name", "16 characters at most");
  if (!is_mc_serial(protocol)) return mc;
  mc.station = natural("station", 0, 31);
  mc.format = natural("format", 4, 5);
  if (mc.format == 0 || (mc.format == 5 && protocol == Protocol::mc_3c))
    fail(where + "/format", "1 to 4, and of mc-4c 5, is expected");
  mc.sum_check = flag(plc, "sum_check", true, where);
  return mc;
}

ModbusSettings parse_modbus(const json& plc, Protocol protocol, const std::string& where) {
  ModbusSettings modbus;
  const bool tcp = protocol == Protocol::modbus_tcp;
  modbus.unit =
      static_cast<std::uint8_t>(number(plc, "unit", 1, tcp ? 0 : 1, tcp ? 255 : 247, where));
  modbus.max_read = static_cast<unsigned>(number(plc, "max_read", 125, 1, 125, where));
  modbus.max_read_code = static_cast<std::uint8_t>(number(plc, "max_read_code", 3, 1, 255, where));
  modbus.holes = parse_holes(plc, modbus_model(), where);
  if (plc.contains("missing_functions")) {
    for (const auto& code : array_at(plc, "missing_functions", where)) {
      if (!code.is_number_unsigned() || code.get<unsigned>() > 127)
        fail(where + "/missing_functions", "function codes up to 127 are expected");
      modbus.missing_functions.push_back(code.get<unsigned>());
    }
  }
  if (plc.contains("identity")) {
    for (const auto& object : array_at(plc, "identity", where)) {
      if (!object.is_string() || object.get<std::string>().size() > 60)
        fail(where + "/identity", "texts of up to 60 characters are expected");
      modbus.identity.push_back(object.get<std::string>());
    }
    if (modbus.identity.size() > 3) fail(where + "/identity", "at most maker, product and version");
  }
  return modbus;
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

Keys keys_of(Protocol protocol) {
  Keys keys = {"name",      "protocol", "pty",        "tcp",           "with",      "baud",
               "data_bits", "parity",   "stop_bits",  "turnaround_ms", "jitter_ms", "seed",
               "plant",     "run",      "run_switch", "memory",        "faults",    "strict_line"};
  const auto add = [&keys](std::initializer_list<std::string_view> more) {
    keys.insert(keys.end(), more);
  };
  if (is_modbus(protocol)) {
    add({"unit", "holes", "max_read", "max_read_code", "missing_functions", "identity"});
  } else {
    add({"model"});
  }
  if (protocol == Protocol::modbus_tcp) add({"gateway"});
  if (protocol == Protocol::computer_link || is_mc_serial(protocol))
    add({"station", "format", "sum_check"});
  if (is_mc_ethernet(protocol)) add({"udp", "udp_peer_port", "connections", "code"});
  if (is_mc_ethernet(protocol) || is_mc_serial(protocol))
    add({"pc", "wrong_route", "write_in_run", "holes"});
  if ((is_mc_ethernet(protocol) && protocol != Protocol::mc_1e) || is_mc_serial(protocol))
    add({"network", "module_io", "module_station", "type_name"});
  return keys;
}

/// Returns the model of a PLC of `protocol` by name, or the default model if none is given.
const Model& parse_model(const json& plc, Protocol protocol, const std::string& where) {
  if (is_modbus(protocol)) return modbus_model();
  const bool mc =
      is_mc_serial(protocol) || (is_mc_ethernet(protocol) && protocol != Protocol::mc_1e);
  const auto name = text(plc, "model", mc ? "FX5U" : "FX3U", where);
  const auto* model = mc ? find_mc_model(name) : find_model(name);
  if (model == nullptr)
    fail(where + "/model",
         "no model " + name + "; known are: " + (mc ? mc_model_names() : model_names()));
  if (protocol == Protocol::mc_1e && !model->name.starts_with("FX3"))
    fail(where + "/model", "mc-1e is for FX3G FX3S FX3U");
  return *model;
}

PlcConfig parse_plc(const json& object, const std::string& where) {
  if (!object.is_object()) fail(where, "an object is expected");
  PlcConfig plc;
  plc.name = required(object, "name", where);
  const auto protocol = text(object, "protocol", "fx-programming-port", where);
  const auto found = find_protocol(protocol);
  if (!found)
    fail(where + "/protocol", "no protocol " + protocol + "; known are: " + protocol_names());
  plc.protocol = *found;
  expect_keys(object, keys_of(plc.protocol), where);
  plc.model = &parse_model(object, plc.protocol, where);
  plc.line = parse_line(object, plc.protocol, where);
  plc.response = parse_response(object, plc.protocol, where);
  if (plc.protocol == Protocol::computer_link)
    plc.computer_link = parse_computer_link(object, where);
  if (is_modbus(plc.protocol)) plc.modbus = parse_modbus(object, plc.protocol, where);
  if (is_mc_ethernet(plc.protocol) || is_mc_serial(plc.protocol))
    plc.mc = parse_mc(object, plc.protocol, *plc.model, where);
  plc.plant = text(object, "plant", "none", where);
  if (!make_plant(plc.plant))
    fail(where + "/plant", "no plant " + plc.plant + "; known are: " + std::string(kPlantNames));
  if (plc.plant == "demo" && plc.model->family != Family::fx && plc.model->family != Family::iq_f)
    fail(where + "/plant", "the demo plant needs the devices of an FX");
  plc.run = flag(object, "run", true, where);
  plc.run_switch = flag(object, "run_switch", true, where);
  if (const auto memory = object.find("memory"); memory != object.end())
    parse_memory(*memory, plc, where + "/memory");
  if (object.contains("faults")) {
    const auto& faults = array_at(object, "faults", where);
    for (std::size_t i = 0; i < faults.size(); ++i)
      plc.faults.push_back(
          parse_fault(faults[i], plc.protocol, where + "/faults/" + std::to_string(i)));
  }
  return plc;
}

/// Returns why `plc` cannot share the line of `other`; empty if it can.
std::string conflict(const PlcConfig& plc, const PlcConfig& other) {
  if (plc.protocol != other.protocol) return "must speak its protocol";
  if (plc.protocol == Protocol::programming_port) return "but this protocol has no addresses";
  if (plc.line.baud != other.line.baud) return "must have its baud";
  if (plc.line.bits_per_character != other.line.bits_per_character)
    return "must have its data_bits, parity and stop_bits";
  if (plc.line.gateway != other.line.gateway) return "must have its gateway";
  if (plc.protocol == Protocol::mc_1e) return "but 1E has no addresses";
  if (is_mc_ethernet(plc.protocol)) {
    if (plc.mc.code != other.mc.code) return "must have its code";
    return plc.mc.route == other.mc.route ? "must have a network or pc of its own" : "";
  }
  if (is_mc_serial(plc.protocol)) {
    if (plc.mc.format != other.mc.format) return "must have its format";
    if (plc.mc.sum_check != other.mc.sum_check) return "must have its sum_check";
    return plc.mc.station == other.mc.station ? "must have a station of its own" : "";
  }
  if (is_modbus(plc.protocol))
    return plc.modbus.unit == other.modbus.unit ? "must have a unit of its own" : "";
  if (plc.computer_link.format != other.computer_link.format) return "must have its format";
  if (plc.computer_link.sum_check != other.computer_link.sum_check)
    return "must have its sum_check";
  return plc.computer_link.station == other.computer_link.station ? "must have a station of its own"
                                                                  : "";
}

/// Returns `text` with {} replaced by the number of the repetition.
std::string numbered(std::string text, std::size_t n) {
  const auto at = text.find("{}");
  return at == std::string::npos ? text : text.replace(at, 2, std::to_string(n));
}

/// Returns the n-th PLC of an entry with "repeat". Each has the next port or, on a shared wire, the
/// next address.
json repetition(json entry, std::size_t n) {
  entry.erase("repeat");
  bool own_wire = false;
  for (const auto* key : {"name", "pty", "with"}) {
    const auto found = entry.find(key);
    if (found == entry.end() || !found->is_string()) continue;
    const auto before = found->get<std::string>();
    *found = numbered(before, n);
    if (key != std::string_view("name") && *found != before) own_wire = true;
  }
  const auto advance = [&entry, n](const char* key) {
    const auto found = entry.find(key);
    if (found != entry.end() && found->is_number_unsigned())
      *found = found->get<std::uint64_t>() + n;
  };
  if (entry.contains("tcp") || entry.contains("udp")) {
    for (const auto* key : {"tcp", "udp"})
      if (entry.contains(key) && entry[key] != 0) advance(key);
  } else if (!own_wire) {
    advance("station");
    advance("unit");
  }
  return entry;
}

/// Adopts the line of the PLC named in "with". Line settings of `entry` itself are kept and
/// compared later.
void join_line(json& entry, const json& host) {
  for (const auto* key :
       {"protocol", "pty", "tcp", "udp", "udp_peer_port", "connections", "baud", "data_bits",
        "parity", "stop_bits", "strict_line", "gateway", "format", "sum_check", "code"})
    if (!entry.contains(key) && host.contains(key)) entry[key] = host[key];
}

}  // namespace

Device parse_device_of(const Model& model, std::string_view name, const std::string& where) {
  const auto device = parse_device(name, model.family);
  if (!device)
    fail(where, "'" + std::string(name) +
                    "' is no device; write X17 Y0 (octal on FX) M0 S0 D0 R0 TN0 TS0 TC0 CN0 CS0 "
                    "CC0, or co:0 di:0 hr:0 ir:0");
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

std::vector<PlcConfig> parse_config(const json& root) {
  expect_keys(root, {"plcs"}, "");
  const auto found = root.find("plcs");
  if (found == root.end() || !found->is_array() || found->empty())
    fail("/plcs", "an array of at least one PLC is expected");
  std::vector<PlcConfig> plcs;
  std::vector<json> entries;                 // source entry of each of plcs
  std::map<std::string, std::size_t> names;  // index in plcs
  std::map<std::string, std::size_t> paths;  // index of the first PLC on the line
  std::map<std::pair<bool, std::uint16_t>, std::size_t> ports;  // (is UDP, port number)
  std::map<std::size_t, std::vector<std::size_t>> lines;        // by first PLC of the line

  const auto take = [&](json entry, const std::string& where) {
    std::optional<std::size_t> host;
    if (const auto with = text(entry, "with", "", where); !with.empty()) {
      const auto at = names.find(with);
      if (at == names.end()) fail(where + "/with", "no PLC " + with + " before this one");
      host = at->second;
      join_line(entry, entries[*host]);
    }
    auto plc = parse_plc(entry, where);
    const auto index = plcs.size();
    if (!names.try_emplace(plc.name, index).second)
      fail(where + "/name", plc.name + " occurs twice");
    plc.line_of = index;
    if (host) {
      plc.line_of = plcs[*host].line_of;
      const auto& line = plcs[*host].line;
      if (plc.line.pty != line.pty || plc.line.tcp != line.tcp || plc.line.udp != line.udp)
        fail(where + "/with", "says another line than pty or tcp");
    } else if (!plc.line.pty.empty()) {
      plc.line_of = paths.try_emplace(plc.line.pty, index).first->second;
    } else if (const auto port = plc.line.udp.value_or(plc.line.tcp); port != 0) {
      const std::pair key(plc.line.udp.has_value(), port);
      plc.line_of = ports.try_emplace(key, index).first->second;
    }
    auto& neighbours = lines[plc.line_of];
    for (const auto neighbour : neighbours) {
      const auto& other = plcs[neighbour];
      const auto what = conflict(plc, other);
      if (!what.empty()) fail(where, plc.name + " is on the line of " + other.name + ", " + what);
    }
    // The first station of the line refuses a route that no station has.
    if (!neighbours.empty()) {
      plc.mc.refuses_foreign = is_mc_serial(plc.protocol) && plc.mc.refuses_foreign;
      plcs[plc.line_of].mc.neighbours.push_back(plc.mc.route);
    }
    neighbours.push_back(index);
    plcs.push_back(std::move(plc));
    entries.push_back(std::move(entry));
  };

  for (std::size_t i = 0; i < found->size(); ++i) {
    const auto& entry = (*found)[i];
    const auto where = "/plcs/" + std::to_string(i);
    if (!entry.is_object()) fail(where, "an object is expected");
    if (!entry.contains("repeat")) {
      take(entry, where);
      continue;
    }
    const auto times = static_cast<std::size_t>(number(entry, "repeat", 1, 1, 65535, where));
    for (std::size_t n = 0; n < times; ++n) take(repetition(entry, n), where);
  }
  return plcs;
}

PlcConfig recorded_plc(Recording recording, std::string place) {
  if (place.empty()) {
    if (recording.wire.starts_with("serial"))
      throw ConfigError("--at: the recording is of a serial line; give pty=PATH or tcp=PORT");
    place = recording.wire.starts_with("udp") ? "udp=0" : "tcp=0";
  }
  // The recording answers. The protocol only has to allow the line.
  const std::string protocol = place.starts_with("udp") ? "mc-3e" : "fx-programming-port";
  const json form =
      plc_from_short_form("name=" + recording.link + ",baud=0,protocol=" + protocol + "," + place);
  auto plc = parse_config(json{{"plcs", json::array({form})}}).front();
  plc.response.turnaround = std::chrono::milliseconds(0);  // the recording has its own
  plc.recording = std::make_shared<const Recording>(std::move(recording));
  return plc;
}

std::unique_ptr<Personality> make_personality(const PlcConfig& plc) {
  if (plc.recording) return make_recorded_device(plc.recording);
  if (is_modbus(plc.protocol)) return make_modbus(plc.protocol, plc.modbus);
  if (plc.protocol == Protocol::mc_1e) return make_mc_one_e(plc.mc);
  if (is_mc_ethernet(plc.protocol)) return make_mc_ethernet(plc.protocol, plc.mc);
  if (is_mc_serial(plc.protocol)) return make_mc_serial(plc.protocol, plc.mc);
  if (plc.protocol == Protocol::computer_link) return make_computer_link(plc.computer_link);
  return make_programming_port();
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
