#include <algorithm>
#include <initializer_list>
#include <limits>
#include <nlohmann/json.hpp>

#include "tests/sim/config.h"
#include "tests/sim/json_keys.h"

namespace fxsim {
using nlohmann::json;

namespace {

bool knows_fault(Protocol protocol, FaultKind kind) {
  const bool mc = is_mc_ethernet(protocol) || is_mc_serial(protocol);
  const bool has_length =
      (is_mc_ethernet(protocol) && protocol != Protocol::mc_1e) || protocol == Protocol::mc_4c;
  switch (kind) {
    case FaultKind::wrong_sum:
      return protocol != Protocol::modbus_tcp && !is_mc_ethernet(protocol);
    case FaultKind::exception:
    case FaultKind::wrong_unit:
      return is_modbus(protocol);
    case FaultKind::wrong_station:
      return protocol == Protocol::computer_link || (mc && protocol != Protocol::mc_1e);
    case FaultKind::wrong_id:
      return protocol == Protocol::modbus_tcp || protocol == Protocol::mc_4e;
    case FaultKind::bad_length:
      return protocol == Protocol::modbus_tcp || has_length;
    case FaultKind::length_short:
    case FaultKind::length_long:
      return has_length;
    case FaultKind::longer:
    case FaultKind::shorter:
    case FaultKind::wrong_header:
      return mc;
    case FaultKind::end_code_with_data:
      return has_length || protocol == Protocol::mc_1e;
    case FaultKind::from_elsewhere:
      return is_mc_ethernet(protocol);
    default:
      return true;
  }
}

/// Parses "code": 2, or the notation of the manuals: two hex digits ("18"), or an MC end code
/// ("C056").
std::optional<std::uint16_t> parse_code(const json& fault, Protocol protocol,
                                        const std::string& where) {
  const auto found = fault.find("code");
  if (found == fault.end()) return std::nullopt;
  const bool mc = is_mc_ethernet(protocol) || is_mc_serial(protocol);
  if (!found->is_string())
    return static_cast<std::uint16_t>(number(fault, "code", 0, 0, mc ? 65535 : 255, where));
  const auto hex = found->get<std::string>();
  const auto code = parse_upper_hex(hex);
  const bool is_long = mc && hex.size() == 4;
  const bool is_short = hex.size() == 2 && (!mc || protocol == Protocol::mc_1e);
  if (!code || (!is_long && !is_short))
    fail(where + "/code", mc ? "four hex digits are expected" : "two hex digits are expected");
  return static_cast<std::uint16_t>(*code);
}

}  // namespace

Fault parse_fault(const json& object, Protocol protocol, const std::string& where) {
  expect_keys(
      object,
      {"kind", "match", "count", "every", "probability", "seed", "ms", "bytes", "hex", "code"},
      where);
  Fault fault;
  const auto kind_name = required(object, "kind", where);
  const auto kind = find_fault(kind_name);
  if (!kind) fail(where + "/kind", "no fault " + kind_name + "; known are: " + fault_names());
  fault.kind = *kind;
  if (!knows_fault(protocol, fault.kind))
    fail(where + "/kind", kind_name + " means nothing for " + std::string(protocol_name(protocol)));
  const auto match_name = text(object, "match", "any", where);
  const auto match = find_match(match_name);
  if (!match) fail(where + "/match", "no match " + match_name + "; known are: " + match_names());
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
  only("ms", {FaultKind::late, FaultKind::split, FaultKind::drop, FaultKind::twice,
              FaultKind::overtaken});
  only("bytes", {FaultKind::truncated, FaultKind::split});
  only("hex", {FaultKind::garbage_before, FaultKind::noise_after});
  only("code", {FaultKind::nak, FaultKind::exception});
  if (object.contains("code") && protocol == Protocol::programming_port)
    fail(where + "/code", "the NAK of the programming port has none");
  fault.code = parse_code(object, protocol, where);
  int usual_ms = 0;
  if (fault.kind == FaultKind::late) usual_ms = 500;
  if (fault.kind == FaultKind::split) usual_ms = 20;
  if (fault.kind == FaultKind::drop || fault.kind == FaultKind::overtaken) usual_ms = 100;
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

}  // namespace fxsim
