#include "tests/sim/control.h"

#include <nlohmann/json.hpp>

#include "tests/sim/config.h"

namespace fxsim {
namespace {

using nlohmann::json;

json value_or_list(const std::vector<std::uint32_t>& values) {
  return values.size() == 1 ? json(values.front()) : json(values);
}

std::string text(const json& request, const char* key) {
  const auto found = request.find(key);
  if (found == request.end() || !found->is_string())
    throw ConfigError(std::string("\"") + key + "\" is missing");
  return found->get<std::string>();
}

std::uint64_t natural(const json& request, const char* key, std::uint64_t fallback) {
  const auto found = request.find(key);
  if (found == request.end()) return fallback;
  if (!found->is_number_unsigned())
    throw ConfigError(std::string("\"") + key + "\" is no natural number");
  return found->get<std::uint64_t>();
}

json set_fault(const json& request, Station& station) {
  auto fault = request;
  fault.erase("cmd");
  fault.erase("plc");
  station.faults().add(parse_fault(fault, station.personality().protocol(), "fault"));
  return {{"ok", true}};
}

json get(const json& request, Station& station) {
  const auto& memory = station.plc().memory();
  auto device = parse_device_of(memory.model(), text(request, "device"), "device");
  const auto count = natural(request, "count", 1);
  const auto with_sign = request.value("signed", false);
  const auto bits = width(device.kind);
  auto values = json::array();
  for (std::uint64_t i = 0; i < count; ++i, ++device.number) {
    if (!memory.has(device)) throw ConfigError("no " + device_name(device));
    const auto raw = memory.get(device);
    const bool negative = with_sign && bits > 1 && (raw >> (bits - 1)) != 0;
    values.push_back(static_cast<std::int64_t>(raw) -
                     (negative ? std::int64_t{1} << bits : std::int64_t{0}));
  }
  return {{"ok", true}, {"values", std::move(values)}};
}

json set(const json& request, Station& station) {
  auto& plc = station.plc();
  auto device = parse_device_of(plc.memory().model(), text(request, "device"), "device");
  const auto found = request.find("value");
  if (found == request.end()) throw ConfigError("\"value\" is missing");
  const auto values = found->is_array() ? *found : json::array({*found});
  for (const auto& value : values) {
    if (!plc.memory().has(device)) throw ConfigError("no " + device_name(device));
    plc.preset(device, parse_value(value, device, "value"));
    ++device.number;
  }
  return {{"ok", true}};
}

json stats(Station& station) {
  const auto& stats = station.stats();
  auto requests = json::object();
  for (std::size_t i = 0; i < kRequestKinds; ++i)
    requests[request_kind_name(static_cast<RequestKind>(i))] = stats.requests[i];
  auto faults = json::object();
  for (std::size_t i = 0; i < kFaultKinds; ++i)
    if (stats.faults[i] != 0)
      faults[std::string(fault_name(static_cast<FaultKind>(i)))] = stats.faults[i];
  return {{"ok", true},
          {"requests", std::move(requests)},
          {"faults", std::move(faults)},
          {"naks", stats.naks},
          {"accepted_reads", stats.accepted_reads},
          {"accepted_writes", stats.accepted_writes},
          {"bytes_in", stats.bytes_in},
          {"bytes_out", stats.bytes_out},
          {"commands", stats.commands},
          {"most_read", stats.most_read},
          {"most_written", stats.most_written},
          {"overlaps", stats.overlaps},
          {"turned_away", stats.turned_away},
          {"strangers", stats.strangers},
          {"run", station.plc().running()}};
}

json log(const json& request, const Station& station) {
  auto entries = json::array();
  for (const auto& deed : station.deeds(natural(request, "since", 0))) {
    json entry = {
        {"index", deed.index}, {"ms", deed.unix_ms}, {"kind", request_kind_name(deed.kind)}};
    if (!deed.device.empty()) {
      entry["device"] = deed.device;
      entry["count"] = deed.count;
    }
    if (!deed.values.empty()) entry["value"] = value_or_list(deed.values);
    entries.push_back(std::move(entry));
  }
  return {{"ok", true}, {"log", std::move(entries)}};
}

json obey_or_throw(const json& request, const Stations& stations, TimePoint now) {
  if (!request.is_object()) throw ConfigError("an object is expected");
  const auto cmd = text(request, "cmd");
  if (cmd == "clear_faults" && !request.contains("plc")) {
    for (const auto& [name, station] : stations) station->faults().clear();
    return {{"ok", true}};
  }
  const auto name = text(request, "plc");
  const auto found = stations.find(name);
  if (found == stations.end()) throw ConfigError("no plc " + name);
  auto& station = *found->second;
  station.plc().advance(now);

  if (cmd == "fault") return set_fault(request, station);
  if (cmd == "clear_faults") {
    station.faults().clear();
    return {{"ok", true}};
  }
  if (cmd == "get") return get(request, station);
  if (cmd == "set") return set(request, station);
  if (cmd == "stats") return stats(station);
  if (cmd == "log") return log(request, station);
  if (cmd == "run" || cmd == "stop") {
    station.plc().set_running(cmd == "run");
    return {{"ok", true}, {"run", station.plc().running()}};
  }
  if (cmd == "switch") {
    const auto position = text(request, "position");
    if (position != "run" && position != "stop") throw ConfigError("position is run or stop");
    station.plc().set_run_switch(position == "run");
    return {{"ok", true}, {"run", station.plc().running()}};
  }
  throw ConfigError("no cmd " + cmd +
                    "; known are: fault clear_faults get set stats log run stop switch quit");
}

}  // namespace

json obey(const json& request, const Stations& stations, TimePoint now) {
  try {
    return obey_or_throw(request, stations, now);
  } catch (const std::exception& error) {  // a ConfigError, or a JSON value of the wrong type
    return {{"ok", false}, {"error", error.what()}};
  }
}

json log_line(const Exchange& exchange) {
  const auto& ruling = exchange.ruling;
  Bytes sent;
  for (const auto& piece : exchange.answer.pieces)
    sent.insert(sent.end(), piece.bytes.begin(), piece.bytes.end());
  json line = {{"ms", exchange.unix_ms},
               {"plc", std::string(exchange.station)},
               {"rx", to_hex(exchange.frame.bytes)},
               {"kind", request_kind_name(exchange.kind)},
               {"decision", verdict_name(ruling.verdict)},
               {"executed", exchange.executed},
               {"tx", to_hex(sent)}};
  if (!ruling.why.empty()) line["why"] = ruling.why;
  if (!ruling.device.empty()) {
    line["device"] = ruling.device;
    line["count"] = ruling.count;
  }
  if (!ruling.values.empty()) line["value"] = value_or_list(ruling.values);
  for (const auto fault : exchange.treatment.struck)
    line["faults"].push_back(std::string(fault_name(fault)));
  return line;
}

}  // namespace fxsim
