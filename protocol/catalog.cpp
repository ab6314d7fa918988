#include "protocol/catalog.h"

#include <algorithm>
#include <array>

#include "protocol/encoding.h"
#include "protocol/fx/computer_link.h"
#include "protocol/fx/programming_port.h"
#include "protocol/mc/mc.h"
#include "protocol/mc/one_e.h"
#include "protocol/modbus/modbus.h"
#include "protocol/plc.h"

namespace fxagent {
namespace {

// Names of models, and further names of some of them: compact forms, and the one with Ethernet. Of
// an FX the widest model comes last.
constexpr auto kFxModels =
    std::to_array<std::string_view>({"FX0N", "FX1S", "FX1N", "FX2N", "FX3S", "FX3G", "FX3U"});
constexpr auto kFxKin =
    std::to_array<std::string_view>({"FX1NC", "FX2NC", "FX3GC", "FX3GE", "FX3UC"});
constexpr auto kOneEModels = std::to_array<std::string_view>({"Q", "L", "FX3G", "FX3U"});
constexpr auto kOneEKin = std::to_array<std::string_view>({"FX3GC", "FX3GE", "FX3UC"});
constexpr auto kMcModels =
    std::to_array<std::string_view>({"FX5U", "FX5UJ", "FX5S", "Q", "L", "iQ-R"});
constexpr auto kMcKin = std::to_array<std::string_view>({"FX5UC"});

OptionSpec integer(std::string_view key, std::int64_t min, std::int64_t max, std::int64_t fallback,
                   std::string_view meaning) {
  return {key, OptionSpec::Kind::integer, min, max, {}, fallback, meaning};
}

OptionSpec boolean(std::string_view key, bool fallback, std::string_view meaning) {
  return {key, OptionSpec::Kind::boolean, 0, 0, {}, fallback, meaning};
}

/// `words` begins with the default.
OptionSpec choice(std::string_view key, const std::vector<std::string_view>& words,
                  std::string_view meaning) {
  return {key, OptionSpec::Kind::choice, 0, 0, words, std::string(words.front()), meaning};
}

constexpr AddressForms kFxAddresses{
    R"(^([XxYy][0-7]+|[MmSs][0-9]+|[DdRr][0-9]+(\.[0-9A-Fa-f])?|[TtCc][NnSs]?[0-9]+|[Kk][1-8]([XxYy][0-7]+|[MmSs][0-9]+)|.*\$\{.*)$)",
    "X17 Y0 (octal), M0 M8000 S20 D100 D8010 R0, TN5 CN5 (values), TS5 CS5 (contacts), "
    "CN200 (32 bits), D100.F (a bit of a word), K4M0 (16 bits as a number).",
    "bool for bits, int16 for words, int32 for CN200 to CN255 and K5 to K8.",
    R"(^( *([XxYy][0-7]+( *(-|\.\.) *[XxYy]?[0-7]+)?|[MmSsDdRr][0-9]+( *(-|\.\.) *[MmSsDdRr]?[0-9]+)?|[TtCc][NnSs][0-9]+( *(-|\.\.) *([TtCc][NnSs])?[0-9]+)?) *|.*\$\{.*)$)",
    "M100-M199, Y0, D200-D209. M8034 to M8037 and M8118 are never written.",
};

constexpr AddressForms kModbusAddresses{
    R"(^([HhIi][Rr]:(0[Xx][0-9A-Fa-f]+|[0-9]+)(\.([0-9]|1[0-5]))?|([Cc][Oo]|[Dd][Ii]):(0[Xx][0-9A-Fa-f]+|[0-9]+)|[34][0-9]{4,5}(\.([0-9]|1[0-5]))?|[01][0-9]{4,5}|.*\$\{.*)$)",
    "hr:100 (holding register), ir:0 (input register), co:5 (coil), di:7 (discrete input), "
    "hr:0x64, hr:100.3 (a bit of a register); or 40101, 400101 and so on, by the count of "
    "digits.",
    "bool for coils, discrete inputs and bits of registers, int16 for registers.",
    R"(^( *(([HhIi][Rr]|[Cc][Oo]|[Dd][Ii]):(0[Xx][0-9A-Fa-f]+|[0-9]+)( *(-|\.\.) *(([HhIi][Rr]|[Cc][Oo]|[Dd][Ii]):(0[Xx][0-9A-Fa-f]+|[0-9]+)|0[Xx][0-9A-Fa-f]+|[0-9]{1,4}))?|[0134][0-9]{4,5}( *(-|\.\.) *(([HhIi][Rr]|[Cc][Oo]|[Dd][Ii]):(0[Xx][0-9A-Fa-f]+|[0-9]+)|[0134][0-9]{4,5}))?) *|.*\$\{.*)$)",
    "co:0-co:7, hr:100-hr:119, 40101-40120. Inputs can be read only.",
};

constexpr AddressForms kMcAddresses{
    R"(^(([Kk][1-8])?[A-Za-z]{1,4}[0-9A-Fa-f]+(\.[0-9A-Fa-f])?|.*\$\{.*)$)",
    "X17 Y0 (octal on an FX5, hexadecimal elsewhere), M0 L0 F0 B1F S0 SM400 SB0, D100 W1F "
    "R0 ZR0 SD0 SW0 Z0, TN5 STN5 CN5 (values), TS5 STS5 CS5 (contacts), TC5 STC5 CC5 "
    "(coils), LCN5 LTN5 LSTN5 LZ0 (32 bits), D100.F (a bit of a word), K4M0 (16 bits as a "
    "number).",
    "bool for bits, int16 for words, uint32 for LCN, LTN and LSTN, int32 for CN200 to "
    "CN255, LZ and K5 to K8.",
    R"(^( *[A-Za-z]{1,4}[0-9A-Fa-f]+( *(-|\.\.) *([A-Za-z]{1,4}[0-9A-Fa-f]|[0-9])[0-9A-Fa-f]*)? *|.*\$\{.*)$)",
    "M100-M199, Y0, W0-W1F. SM8034 to SM8037 are never written.",
};

constexpr std::string_view kFxModel =
    "Model of the PLC. `auto`: the agent asks the PLC, and `check` uses the ranges of the FX3U, "
    "the widest. Addresses that the real model lacks are then bad. An `FX1NC`, `FX2NC`, `FX3GC`, "
    "`FX3GE` or `FX3UC` counts as the model without the last letter.";

ProtocolInfo fx_protocol(std::string_view name, std::string_view summary) {
  ProtocolInfo info;
  info.name = name;
  info.summary = summary;
  info.text_begins_with = kStx;
  // Models other than these three reach 19200 baud.
  info.most_speed = 19200;
  info.fast_models = {"FX3S", "FX3G", "FX3U"};
  info.models = kFxModels;
  info.kin = kFxKin;
  info.model_meaning = kFxModel;
  info.address_forms = kFxAddresses;
  return info;
}

ProtocolInfo programming_port() {
  const fx::ProgrammingPort::Settings settings;
  ProtocolInfo info = fx_protocol("fx-programming-port",
                                  "Mitsubishi FX through its programming port (RS-422, 9600 7E1)");
  info.one_line = true;
  // Speeds of its commands A1 to A5. It begins at 9600.
  info.speeds = {9600, 19200, 38400, 57600, 115200};
  info.options = {
      choice("command_set", {"auto", "classic", "extended"},
             "`auto`: classic commands within their range, extended commands beyond. FX0N and "
             "FX1S have only the classic set."),
      choice("enquire", {"open", "always", "never"},
             "Times of ENQ: after the link opens and after an error, before every "
             "request, or never."),
      integer("max_block_bytes", 2, 254, settings.max_block_bytes,
              "Data bytes of one frame. Only extended reads of an FX3S, FX3G or FX3U use more "
              "than 64."),
  };
  info.hints.silent =
      "is the programming cable (RS-422) in the PLC's round socket, without GX Works or a panel on "
      "it; is this a communication board set up by D8120 (then set protocol to fx-computer-link)";
  info.make = &fx::ProgrammingPort::make;
  return info;
}

ProtocolInfo computer_link() {
  const fx::ComputerLink::Settings settings;
  ProtocolInfo info = fx_protocol(
      "fx-computer-link", "Mitsubishi FX through its computer link (RS-485, stations 0 to 15)");
  // D8120, bits 4 to 7. JY997D16901 lists 38400 for the FX3.
  info.speeds = {300, 600, 1200, 2400, 4800, 9600, 19200, 38400};
  info.multidrop = true;
  info.options = {
      integer("station", 0, 15, settings.station, "Station number, D8121 of the PLC."),
      integer("format", 1, 4, settings.format,
              "Control procedure format 1 or 4, as in D8120. Format 4 ends each message with CR "
              "LF."),
      boolean("sum_check", settings.sum_check,
              "True if frames carry a sum, as in D8120. Without it, noise can pass for a value."),
      integer("message_wait_ms", 0, 150, settings.wait_tens * 10,
              "Time that the PLC waits before it answers, a multiple of 10; 70 or more with an "
              "FX-485PC-IF."),
      boolean("acknowledge_data", settings.acknowledge_data,
              "True if the agent answers data with ACK, as the manual requires. `false` saves "
              "the line time of the ACK. It is right for two-wire adapters that return "
              "everything that is sent."),
      integer("max_block_bytes", 2, 128, 128, "Bytes of device memory in one frame."),
  };
  info.format_place = "D8120 of the PLC";
  info.hints.silent =
      "is D8121 of the PLC `station`; are `format` and `sum_check` those of D8120; was the PLC "
      "switched off and on after D8120 or D8121 was changed";
  info.plc_line_word = &fx::d8120_for;
  info.make = &fx::ComputerLink::make;
  return info;
}

ProtocolInfo modbus_protocol(std::string_view name, modbus::Framing framing,
                             std::string_view summary) {
  const modbus::Modbus::Settings settings;
  ProtocolInfo info;
  info.name = name;
  info.summary = summary;
  info.multidrop = true;
  info.model_meaning = "Modbus devices have no models: leave it out, or set `auto`.";
  info.address_forms = kModbusAddresses;
  info.options = {
      integer("unit", 0, 255, settings.unit,
              "Unit id. On a serial line 1 to 247, or 0 for a broadcast: every unit obeys and "
              "none answers. A broadcast device has no tags. On TCP 0 is a unit like any other. "
              "Behind a gateway it is the unit on the gateway's line."),
      integer("max_read", 1, modbus::kMaxReadRegisters, settings.max_read,
              "Registers of the longest read; 16 coils or discrete inputs for each register. "
              "Many devices accept fewer than 125."),
      integer("max_gap", 0, modbus::kMaxReadRegisters, settings.max_gap,
              "Registers in a row that the agent may read although no tag needs them; 16 coils "
              "or discrete inputs for each register. 0: it reads only the places of tags."),
      choice("byte_order", {"ABCD", "CDAB", "BADC", "DCBA"},
             "Byte order of 32-bit values; A is the most significant byte. `BADC` and `DCBA` "
             "swap the bytes of 16-bit values, too. Default of `word_order`."),
      integer("address_base", 0, 1, settings.address_base,
              "Number of the first place in `hr:` `ir:` `co:` `di:`."),
      boolean("allow_read_modify_write", settings.allow_read_modify_write,
              "True if the agent may write a bit of a register by reading and writing the whole "
              "register, if the device lacks function 22. Changes by the device in between are "
              "lost."),
  };
  info.make = [framing](const Options& options) { return modbus::Modbus::make(framing, options); };
  return info;
}

ProtocolInfo modbus_rtu() {
  ProtocolInfo info = modbus_protocol("modbus-rtu", modbus::Framing::rtu,
                                      "Modbus RTU, serial or through a serial server");
  info.hints.silent = "is its address `unit`; is it set to Modbus RTU, not ASCII";
  info.line.data_bits = 8;
  return info;
}

ProtocolInfo modbus_ascii() {
  ProtocolInfo info = modbus_protocol("modbus-ascii", modbus::Framing::ascii,
                                      "Modbus ASCII, serial or through a serial server");
  info.hints.silent = "is its address `unit`; is it set to Modbus ASCII, not RTU";
  info.text_begins_with = ':';
  return info;
}

ProtocolInfo modbus_tcp() {
  ProtocolInfo info =
      modbus_protocol("modbus-tcp", modbus::Framing::tcp, "Modbus TCP, port 502 by custom");
  info.hints.silent =
      "is `unit` right (a device with its own network port often has 1 or 255; behind a gateway it "
      "is the unit on the gateway's line); does the gateway's line have the device's speed, data "
      "bits and parity; are A and B of that line swapped; do other programs use all connections; "
      "is this a serial server without Modbus (then set protocol to modbus-rtu)";
  info.hints.closed =
      "does the device or gateway limit connections, and do other programs use them; does it "
      "accept this machine's address?";
  info.on_serial = false;
  return info;
}

ProtocolInfo mc_1e() {
  const mc::OneE::Settings settings;
  ProtocolInfo info;
  info.name = "mc-1e";
  info.summary = "Mitsubishi FX3 and E71 modules over Ethernet (MC protocol, 1E frames)";
  info.on_serial = false;
  info.on_udp = true;
  info.multidrop = true;
  info.models = kOneEModels;
  info.kin = kOneEKin;
  info.address_forms = kMcAddresses;
  info.model_meaning =
      "Model of the PLC. `auto`: the agent asks an FX3, and `check` uses the ranges of the FX3U, "
      "the widest. Before the answer it does not read X and Y, nor M8000, D8000 and CN200 "
      "upwards. `Q` and `L` mean an E71 module, which cannot report its model: X and Y are "
      "hexadecimal there. An `FX3GC`, `FX3GE` or `FX3UC` counts as the model without the last "
      "letter.";
  info.options = {
      choice("code", {"binary", "ascii"},
             "Communication data code, as in the PLC's Ethernet settings."),
      integer("pc", 0, 255, settings.route.pc,
              "PC number. 255 is the connected PLC; others are stations of a network behind it."),
      integer("monitoring_timer_ms", 250, 60000, settings.timer * 250,
              "Time that the Ethernet module waits for its PLC before it answers with an error, in "
              "steps of 250. `timeout_ms` should be longer; its default is 1000 more."),
  };
  info.hints.silent =
      "is Communication Data Code of the PLC's Ethernet settings `code`; is the open setting of "
      "this port MC Protocol (FX3U-ENET: Procedure exist (MC)); does the PLC know 1E frames (an "
      "FX5U needs mc-3e)";
  info.hints.closed =
      "each open setting takes one connection: is another program (a panel, GX Works2) using this "
      "port? Give the agent an open setting of its own";
  SettingHints module = info.hints;
  module.silent =
      "in GX Works2 look at the E71 module under Network Parameter, Ethernet: does its Open "
      "Setting have a line for MC protocol with this port number and protocol (TCP or UDP); is "
      "Communication Data Code `code`; is this a built-in port (it needs mc-3e)";
  info.model_hints = {{"Q", module}, {"L", module}};
  info.make = &mc::OneE::make;
  return info;
}

/// Common part of all MC protocols except 1E.
ProtocolInfo mc_protocol(std::string_view name, std::string_view summary) {
  const mc::Mc::Settings settings;
  ProtocolInfo info;
  info.name = name;
  info.summary = summary;
  info.multidrop = true;
  info.models = kMcModels;
  info.kin = kMcKin;
  info.address_forms = kMcAddresses;
  info.last_is_widest = false;
  info.model_meaning =
      "Model of the PLC. `auto`: the agent asks the PLC; built-in ports of Q and L do not report "
      "it. While the model is unknown, and in `check`, the ranges of all models together apply. "
      "X and Y above 7 are then errors, because X10 is input 8 on an FX5 (octal) and input 16 on "
      "others (hexadecimal): set the model. An `FX5UC` counts as `FX5U`, an iQ-L as `iQ-R`.";
  info.options = {
      integer("network", 0, 255, settings.route.network,
              "Network number of the PLC; 0 is the connected PLC."),
      integer("pc", 0, 255, settings.route.pc,
              "PC number (station) of the PLC in that network; 255 is the connected PLC."),
  };
  return info;
}

void add_module(ProtocolInfo& info) {
  const mc::Route route;
  info.options.push_back(
      integer("module_io", 0, 65535, route.module_io,
              "Module I/O number of the target CPU or module. 1023 (03FFh) is the CPU of the "
              "station, 992 to 995 are CPUs 1 to 4."));
  info.options.push_back(integer("module_station", 0, 255, route.module_station,
                                 "Station number behind that module (multidrop); 0: none."));
}

/// Adds hints for the port settings of these PLCs: FX5 and iQ-R in GX Works3, Q and L in GX Works2.
void add_hints(ProtocolInfo& info) {
  info.hints.silent =
      "look at the PLC's Ethernet port: is there an SLMP Connection Module (GX Works3) or a line "
      "MC Protocol of its Open Setting (GX Works2) with this port number and protocol (TCP or "
      "UDP); is Communication Data Code `code`; is it an FX3 (it needs mc-1e) or a built-in port "
      "of a Q or L (it needs mc-3e)";
  info.hints.closed =
      "each SLMP Connection Module (GX Works3) or line of the Open Setting (GX Works2) serves one "
      "connection: is another program using this one? Give the agent an entry with a port of its "
      "own";
  const SettingHints works3 = {
      "in GX Works3 look at the Ethernet port: is there an SLMP Connection Module (iQ-R: SLMP, "
      "Unpassive) with this port number and protocol (TCP or UDP); is Communication Data Code "
      "`code`",
      "each SLMP Connection Module in the parameters serves one connection: is another program "
      "using this one? Give the agent an entry with a port of its own"};
  const SettingHints works2 = {
      "in GX Works2 look at Built-in Ethernet Port Setting (E71 module: Network Parameter): does "
      "its Open Setting have a line MC Protocol with this port number and protocol (TCP or UDP); "
      "is Communication Data Code `code`; is this a built-in port (it needs mc-3e)",
      "each line of the Open Setting in GX Works2 serves one connection: is another program using "
      "this one? Give the agent a line with a port of its own"};
  for (const std::string_view model : kMcModels)
    info.model_hints.emplace_back(model, model == "Q" || model == "L" ? works2 : works3);
  if (info.name != "mc-3e") return;
  info.hints.silent = info.hints.silent.substr(0, info.hints.silent.find(" or a built-in port"));
  for (auto& [model, hints] : info.model_hints)
    hints.silent = hints.silent.substr(0, hints.silent.find("; is this a built-in port"));
}

ProtocolInfo mc_ethernet(std::string_view name, mc::Frame frame, std::string_view summary) {
  const mc::Mc::Settings settings;
  ProtocolInfo info = mc_protocol(name, summary);
  info.on_serial = false;
  info.on_udp = true;
  add_module(info);
  info.options.insert(
      info.options.begin(),
      choice("code", {"binary", "ascii"},
             "Communication Data Code of the port, as in its parameters. In ASCII the agent cannot "
             "read X and Y of an FX5 above 7: their digits are not known for certain."));
  info.options.push_back(integer(
      "monitoring_timer_ms", 250, 60000, settings.timer * 250,
      "Time that the PLC may try to reach the target station before it answers with an error, in "
      "steps of 250. `timeout_ms` should be longer; its default is 1000 more."));
  info.options.push_back(integer("max_block_bytes", 2, settings.max_block_bytes,
                                 settings.max_block_bytes, "Bytes of device memory in one frame."));
  add_hints(info);
  info.make = [frame](const Options& options) { return mc::Mc::make(frame, options); };
  return info;
}

ProtocolInfo mc_serial(std::string_view name, mc::Frame frame, std::string_view summary) {
  const bool is_4c = frame == mc::Frame::c4;
  constexpr std::int64_t kBlock = 512;
  const mc::Mc::Settings settings;
  ProtocolInfo info = mc_protocol(name, summary);
  info.line.data_bits = 8;
  info.least_data_bits = 7;
  info.text_begins_with = kStx;
  info.options.insert(info.options.begin(),
                      integer("station", 0, 31, settings.station,
                              "Station number, as in the parameters of the serial port."));
  info.options.push_back(
      integer("format", 1, is_4c ? 5 : 4, settings.format,
              is_4c ? "Message pattern, as in the parameters: 1 to 4 are ASCII, 5 is binary "
                      "and needs 8 data bits."
                    : "Message pattern, as in the parameters; all are ASCII."));
  info.options.back().binary_from = 5;
  info.options.push_back(boolean(
      "sum_check", settings.sum_check,
      "True if frames carry a sum, as in the parameters. Without it, noise can pass for a value."));
  info.options.push_back(integer("max_block_bytes", 2, settings.max_block_bytes, kBlock,
                                 "Bytes of device memory in one frame. More is a little faster, "
                                 "but commands wait longer."));
  if (is_4c) add_module(info);
  info.format_place =
      "the parameters of the PLC's serial port (FX5: 485 Serial Port in GX Works3; C24 module: its "
      "switch setting)";
  info.hints.silent =
      "in the parameters of the PLC's serial port (FX5: 485 Serial Port in GX Works3; C24 module: "
      "its switch setting), is the protocol MC Protocol, the message pattern `format`, the station "
      "`station` and the sum check `sum_check`; was the PLC switched off and on after a change";
  info.make = [frame](const Options& options) { return mc::Mc::make(frame, options); };
  return info;
}

}  // namespace

std::span<const ProtocolInfo> catalog() {
  static const std::vector<ProtocolInfo> protocols = {
      programming_port(),
      computer_link(),
      modbus_rtu(),
      modbus_ascii(),
      modbus_tcp(),
      mc_1e(),
      mc_ethernet("mc-3e", mc::Frame::e3, "MC protocol (SLMP) in 3E frames: FX5, Q, L, iQ-R"),
      mc_ethernet("mc-4e", mc::Frame::e4,
                  "MC protocol (SLMP) in 4E frames, whose answers have numbers"),
      mc_serial("mc-3c", mc::Frame::c3,
                "MC protocol in 3C frames: serial ports of FX5, Q, L, iQ-R"),
      mc_serial("mc-4c", mc::Frame::c4,
                "MC protocol in 4C frames: serial ports of FX5, Q, L, iQ-R")};
  return protocols;
}

std::shared_ptr<const Codec> widest_of(const ProtocolInfo& protocol,
                                       const std::shared_ptr<const Codec>& codec) {
  if (!must_ask_model(*codec) || !protocol.last_is_widest) return codec;
  return codec->plc()->with_model(protocol.models.back());
}

std::string widest_name(const ProtocolInfo& protocol) {
  return protocol.last_is_widest ? std::string(protocol.models.back()) + ", the widest"
                                 : "what any model has";
}

const OptionSpec* binary_option(const ProtocolInfo& protocol, const Options& options) {
  const auto found = std::ranges::find_if(protocol.options, [&](const OptionSpec& spec) {
    const auto* value = option<std::int64_t>(options, spec.key);
    return value != nullptr && spec.binary_from && *value >= *spec.binary_from;
  });
  return found == protocol.options.end() ? nullptr : &*found;
}

const ProtocolInfo* find_protocol(std::string_view name) {
  const auto protocols = catalog();
  const auto found = std::ranges::find(protocols, name, &ProtocolInfo::name);
  return found == protocols.end() ? nullptr : &*found;
}

Options default_options(const ProtocolInfo& protocol) {
  Options options{{"model", std::string(kAutoModel)}};
  for (const OptionSpec& spec : protocol.options) options[std::string(spec.key)] = spec.fallback;
  return options;
}

}  // namespace fxagent
