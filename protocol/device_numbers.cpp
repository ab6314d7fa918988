#include "protocol/device_numbers.h"

#include <string>

#include "protocol/fx/device.h"
#include "protocol/mc/device.h"
#include "protocol/modbus/pdu.h"
#include "protocol/plc.h"

namespace fxagent {
namespace {

bool is_fx(const ProtocolInfo& protocol) { return protocol.name.starts_with("fx-"); }
bool is_modbus(const ProtocolInfo& protocol) { return protocol.name.starts_with("modbus-"); }

template <typename Kind>
DeviceNumbers numbers_in(const Kind& kind, const Span& span) {
  const std::uint32_t first = kind.first_number + span.first_bit / kind.bits;
  return {kind.letters, kind.bits, first, first + span.bits / kind.bits - 1};
}

std::vector<DeviceNumbers> lettered_fx(const Codec& codec, std::string_view letters) {
  const auto model = fx::model_named(model_of(codec)).value_or(fx::Model::unknown);
  std::vector<DeviceNumbers> found;
  for (std::uint16_t i = 0; i < fx::kSpaces; ++i) {
    const auto space = static_cast<fx::Space>(i);
    const fx::DeviceKind& kind = fx::kind_of(space);
    if (kind.letters != letters) continue;
    for (const fx::Numbers& run : fx::numbers_of(model, space))
      found.push_back({kind.letters, kind.bits, run.first, run.last});
  }
  return found;
}

mc::Model mc_model(const ProtocolInfo& protocol, const Codec& codec) {
  const bool by_1e = protocol.name == "mc-1e";
  const auto model = mc::model_named(model_of(codec));
  if (!model) return by_1e ? mc::Model::unknown_fx3 : mc::Model::unknown;
  return by_1e ? mc::seen_by_1e(*model) : *model;
}

std::vector<DeviceNumbers> lettered_mc(mc::Model model, std::string_view letters) {
  std::vector<DeviceNumbers> found;
  for (std::uint16_t i = 0; i < mc::kSpaces; ++i) {
    const auto space = static_cast<mc::Space>(i);
    const mc::DeviceKind& kind = mc::kind_of(space);
    if (kind.letters != letters) continue;
    if (const auto run = mc::numbers_of(model, space))
      found.push_back({kind.letters, kind.bits, run->first, run->last});
  }
  return found;
}

std::vector<DeviceNumbers> lettered_modbus(std::string_view letters) {
  using modbus::Space;
  for (const Space space :
       {Space::coil, Space::discrete_input, Space::input_register, Space::holding_register})
    if (modbus::letters_of(space) == letters)
      return {{modbus::letters_of(space), modbus::width_of(space), 0, modbus::kNumbers - 1}};
  return {};
}

}  // namespace

DeviceNumbers numbers_of(const ProtocolInfo& protocol, const Span& span) {
  if (is_modbus(protocol)) {
    const auto table = static_cast<modbus::Space>(span.space);
    const std::uint32_t width = modbus::width_of(table);
    const std::uint32_t first = span.first_bit / width;
    return {modbus::letters_of(table), width, first, first + span.bits / width - 1};
  }
  if (is_fx(protocol)) return numbers_in(fx::kind_of(static_cast<fx::Space>(span.space)), span);
  return numbers_in(mc::kind_of(static_cast<mc::Space>(span.space)), span);
}

std::vector<DeviceNumbers> devices_lettered(const ProtocolInfo& protocol, const Codec& codec,
                                            std::string_view letters) {
  if (is_modbus(protocol)) return lettered_modbus(letters);
  if (is_fx(protocol)) return lettered_fx(codec, letters);
  return lettered_mc(mc_model(protocol, codec), letters);
}

}  // namespace fxagent
