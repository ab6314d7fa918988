#include "protocol/catalog.h"

#include <algorithm>

#include "protocol/fx/computer_link.h"
#include "protocol/fx/programming_port.h"

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

}  // namespace

std::span<const ProtocolInfo> catalog() {
  static const std::vector<ProtocolInfo> protocols = {programming_port(), computer_link()};
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
