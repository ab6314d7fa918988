#include "protocol/fx/link_frame.h"

#include <array>

namespace fxagent::fx {
namespace {

/// Codes of the models in answers to PC, JY992D69901 8.8; FX3 from JY997D16901, F4 from the
/// FX3U-ENET manual. The code of FX3S is unknown.
struct TypeCode {
  int code;
  Model model;
};
constexpr std::array<TypeCode, 6> kTypeCodes = {{{0xF2, Model::fx1s},
                                                 {0x8E, Model::fx0n},
                                                 {0x9E, Model::fx1n},
                                                 {0x9D, Model::fx2n},
                                                 {0xF3, Model::fx3u},
                                                 {0xF4, Model::fx3g}}};

}  // namespace

std::string_view link_refusal(int code) {
  switch (code) {
    case link::kSumMismatch:
      return "the PLC found a wrong sum";
    case 0x03:
      return "the PLC is set to another format or procedure (D8120)";
    case link::kNoDevice:
      return "the device does not exist, or too many points";
    case 0x07:
      return "the data are not hex digits";
    case 0x0A:
    case 0x10:
      return "the PLC number is not FF";
    case 0x18:
      return "remote RUN or STOP is not possible";
    default:
      return "a reason that the manual does not list";
  }
}

std::string_view link_model(int code) {
  for (const TypeCode& known : kTypeCodes)
    if (known.code == code) return to_string(known.model);
  return {};
}

}  // namespace fxagent::fx
