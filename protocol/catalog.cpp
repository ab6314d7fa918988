#include "protocol/catalog.h"

#include <algorithm>

#include "protocol/fx/computer_link.h"
#include "protocol/fx/programming_port.h"
#include "protocol/modbus/modbus.h"

namespace fxagent {
namespace {

std::vector<std::string_view> fx_models() {
  const auto names = fx::model_names();
  return {names.begin(), names.end()};
}

ProtocolInfo programming_port() {
  using Kind = OptionSpec::Kind;
  ProtocolInfo info;
  info.name = "fx-programming-port";
  info.summary = "Mitsubishi FX through its programming port (RS-422, 9600 7E1)";
  info.line = {9600, 7, "even", 1};
  info.models = fx_models();
  info.options = {
      {"command_set",
       Kind::choice,
       0,
       0,
       {"auto", "classic", "extended"},
       std::string_view("auto"),
       "which commands may be used; auto takes the classic ones wherever they reach"},
      {"enquire",
       Kind::choice,
       0,
       0,
       {"open", "always", "never"},
       std::string_view("open"),
       "when ENQ is sent: after opening and after an error, before every request, or never"},
      {"max_block_bytes",
       Kind::integer,
       2,
       254,
       {},
       std::int64_t{64},
       "data bytes of one frame; above 64 only extended reads of an FX3S, FX3G or FX3U follow"},
  };
  info.make = &fx::ProgrammingPort::make;
  return info;
}

ProtocolInfo computer_link() {
  using Kind = OptionSpec::Kind;
  ProtocolInfo info;
  info.name = "fx-computer-link";
  info.summary = "Mitsubishi FX through its computer link (RS-485, stations 0 to 15)";
  info.line = {9600, 7, "even", 1};
  info.multidrop = true;
  info.models = fx_models();
  info.options = {
      {"station", Kind::integer, 0, 15, {}, std::int64_t{0}, "station number, D8121 of the PLC"},
      {"format",
       Kind::integer,
       1,
       4,
       {},
       std::int64_t{1},
       "control procedure 1, or 4, which ends each message with CR LF (D8120)"},
      {"sum_check", Kind::boolean, 0, 0, {}, true, "whether frames carry a sum (D8120)"},
      {"message_wait_ms",
       Kind::integer,
       0,
       150,
       {},
       std::int64_t{0},
       "how long the PLC waits before it answers, in tens"},
      {"acknowledge_data",
       Kind::boolean,
       0,
       0,
       {},
       true,
       "whether data are answered with ACK, as the manual asks"},
      {"max_block_bytes",
       Kind::integer,
       2,
       128,
       {},
       std::int64_t{128},
       "bytes of device memory in one frame"},
  };
  info.make = &fx::ComputerLink::make;
  return info;
}

ProtocolInfo modbus_protocol(std::string_view name, std::string_view summary) {
  using Kind = OptionSpec::Kind;
  ProtocolInfo info;
  info.name = name;
  info.summary = summary;
  info.multidrop = true;
  info.options = {
      {"unit",
       Kind::integer,
       0,
       255,
       {},
       std::int64_t{1},
       "unit id; on a serial line 1 to 247, or 0 for a broadcast"},
      {"max_read",
       Kind::integer,
       1,
       modbus::kMaxReadRegisters,
       {},
       std::int64_t{modbus::kMaxReadRegisters},
       "registers of one read; of coils and inputs 16 for each"},
      {"max_gap",
       Kind::integer,
       0,
       modbus::kMaxReadRegisters,
       {},
       std::int64_t{16},
       "registers in a row that are read though nobody asked for them; 0: none ever"},
      {"byte_order",
       Kind::choice,
       0,
       0,
       {"ABCD", "CDAB", "BADC", "DCBA"},
       std::string_view("ABCD"),
       "order of the bytes of 32 bits, unless a tag says otherwise"},
      {"address_base",
       Kind::integer,
       0,
       1,
       {},
       std::int64_t{0},
       "number of the first coil or register in hr: ir: co: di:"},
      {"allow_read_modify_write",
       Kind::boolean,
       0,
       0,
       {},
       false,
       "whether a bit of a register may be written by reading the register first, where function "
       "22 "
       "is missing"},
  };
  return info;
}

ProtocolInfo modbus_rtu() {
  ProtocolInfo info =
      modbus_protocol("modbus-rtu", "Modbus RTU, serial or through a serial server");
  info.line = {9600, 8, "even", 1};
  info.make = &modbus::Modbus::make_rtu;
  return info;
}

ProtocolInfo modbus_ascii() {
  ProtocolInfo info =
      modbus_protocol("modbus-ascii", "Modbus ASCII, serial or through a serial server");
  info.line = {9600, 7, "even", 1};
  info.make = &modbus::Modbus::make_ascii;
  return info;
}

ProtocolInfo modbus_tcp() {
  ProtocolInfo info = modbus_protocol("modbus-tcp", "Modbus TCP, port 502 by custom");
  info.on_serial = false;
  info.make = &modbus::Modbus::make_tcp;
  return info;
}

}  // namespace

std::span<const ProtocolInfo> catalog() {
  static const std::vector<ProtocolInfo> protocols = {programming_port(), computer_link(),
                                                      modbus_rtu(), modbus_ascii(), modbus_tcp()};
  return protocols;
}

const ProtocolInfo* find_protocol(std::string_view name) {
  const auto protocols = catalog();
  const auto found = std::find_if(protocols.begin(), protocols.end(),
                                  [&](const ProtocolInfo& info) { return info.name == name; });
  return found == protocols.end() ? nullptr : &*found;
}

Options default_options(const ProtocolInfo& protocol) {
  Options options;
  for (const OptionSpec& spec : protocol.options) {
    auto& value = options[std::string(spec.key)];
    if (const auto* word = std::get_if<std::string_view>(&spec.fallback))
      value = std::string(*word);
    else if (const auto* flag = std::get_if<bool>(&spec.fallback))
      value = *flag;
    else
      value = std::get<std::int64_t>(spec.fallback);
  }
  options["model"] = std::string("auto");
  return options;
}

}  // namespace fxagent
