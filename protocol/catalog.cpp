#include "protocol/catalog.h"

#include <algorithm>

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

}  // namespace

std::span<const ProtocolInfo> catalog() {
  static const std::vector<ProtocolInfo> protocols = {programming_port()};
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
