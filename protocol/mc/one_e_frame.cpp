#include "protocol/mc/one_e_frame.h"

#include "protocol/mc/device.h"

namespace fxagent::mc::one_e {
namespace {

// Answer to 15, JY997D45801 7.6.3.
constexpr int kFx3u = 0xF3;
constexpr int kFx3g = 0xF4;

// End codes, JY997D45801 9.3.2, and abnormal codes after 5B.
constexpr int kCommandUnknown = 0x50;
constexpr int kNoAscii = 0x54;
constexpr int kWriteInRun = 0x55;
constexpr int kNoDevice = 0x56;
constexpr int kTooMany = 0x57;
constexpr int kNoHead = 0x58;
constexpr int kPcSilent = 0x60;
constexpr int kPcNumber = 0x10;
constexpr int kNoRemote = 0x18;

}  // namespace

std::optional<Bytes> from_ascii(ByteView frame) {
  if (!is_hex(frame)) return std::nullopt;
  Bytes bytes;
  bytes.reserve(frame.size() / 2);
  for (std::size_t i = 0; i + 1 < frame.size(); i += 2)
    bytes.push_back(static_cast<std::uint8_t>(hex_byte(frame.subspan(i, 2))));
  return bytes;
}

std::string_view model_coded(int model_code) {
  if (model_code == kFx3u) return to_string(Model::fx3u);
  return model_code == kFx3g ? to_string(Model::fx3g) : std::string_view{};
}

std::string refusal(int end_code, std::optional<int> abnormal_code) {
  const auto words = [&]() -> std::string_view {
    switch (end_code) {
      case kCommandUnknown:
        return "the PLC does not have this command";
      case kNoAscii:
        return "the PLC is set to ASCII and cannot read this: `code` must be the communication "
               "data code that is set in the PLC";
      case kWriteInRun:
        return "writing is not permitted while the PLC runs: set \"Enable online change\" in its "
               "Ethernet settings (FX3U-ENET: \"Enable Write at RUN time\")";
      case kNoDevice:
        return "no such device";
      case kTooMany:
        return "too many points, or beyond the last device";
      case kNoHead:
        return "no such device number, or this command cannot begin with it";
      case kPcSilent:
        return "the PLC gave its Ethernet module no answer within the monitoring timer";
      case kWithReason:
        if (abnormal_code == kPcNumber) return "no PLC has this PC number (`pc`)";
        if (abnormal_code == kNoRemote) return "remote RUN or STOP is not possible";
        return "the Ethernet module cannot reach the PLC";
      default:
        return "a reason that the manual does not list";
    }
  };
  std::string text = hex_text(static_cast<std::uint32_t>(end_code), 2);
  if (abnormal_code) text += " " + hex_text(static_cast<std::uint32_t>(*abnormal_code), 2);
  return text.append(": ").append(words());
}

RefusalMeaning meaning_of(int device_code, bool reads) {
  const int abnormal = device_code >> 8;
  switch (device_code & 0xFF) {
    case kCommandUnknown:
    case kNoAscii:
    case kWriteInRun:
      return RefusalMeaning::final;
    case kNoDevice:
    case kTooMany:
    case kNoHead:
      return reads ? RefusalMeaning::hole : RefusalMeaning::final;
    case kWithReason:
      if (abnormal == kNoRemote) return RefusalMeaning::final;  // an answer to RUN or STOP only
      if (abnormal == kPcNumber && !reads) return RefusalMeaning::final;
      return reads ? RefusalMeaning::unreachable : RefusalMeaning::unclear;
    case kPcSilent:
      return reads ? RefusalMeaning::unreachable : RefusalMeaning::unclear;
    default:
      return reads ? RefusalMeaning::final : RefusalMeaning::unclear;
  }
}

}  // namespace fxagent::mc::one_e
