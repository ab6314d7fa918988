// End codes of 3E, 4E, 3C and 4C (message.h).
// Sources: SH-080008, JY997D56001, QnUCPU and LCPU built-in Ethernet manuals, QJ71C24 manuals.
// protocol/README.md lists the codes that PLCs were observed to send.
#include <algorithm>
#include <string_view>

#include "protocol/mc/message.h"
#include "protocol/value/bytes.h"

namespace fxagent::mc {
namespace {

/// Class of an end code. With any class except `relay` nothing was carried out.
enum class Class : std::uint8_t {
  final,
  port,     ///< final; the cause is a password or a setting of the port, not this request
  command,  ///< final: the PLC lacks the command or its subcommand
  hole,     ///< the PLC lacks this place or count: a smaller request may succeed
  line,     ///< noise; worth a second try
  busy,
  route,  ///< no route to the station
  relay,  ///< the request reached a station on the way, and perhaps the addressed one
};

/// An end code, or all that have these bits under `mask`.
struct EndCode {
  std::uint16_t code;
  Class what;
  std::string_view text;
  std::uint16_t mask = 0xFFFF;
};

constexpr std::string_view kTooMany = "too many points in one request";
constexpr std::uint16_t kWriteInRun = 0x0055;

// The first row that fits counts. A text that depends on the series is empty here.
constexpr EndCode kCodes[] = {
    {0x0050, Class::port, "unknown frame: is protocol mc-1e, mc-3e or mc-4e right?"},
    {kWriteInRun, Class::port, {}},
    {0x4013, Class::final, "not possible in this state of the CPU"},
    {0x4030, Class::hole, "the device cannot be accessed in this way"},
    {0x4031, Class::hole, "beyond the last device of the PLC's parameters"},
    {0x4032, Class::hole, "the device cannot be accessed in this way"},
    {0x4043, Class::final, "wrong content of the request"},
    {0x4080, Class::final, "wrong content of the request"},
    {0x413E, Class::final, "the CPU does not have the requested item"},
    {0x414A, Class::final, "the CPU does not have the requested item"},
    {0x7151, Class::final, "wrong format of the request"},
    {0x7153, Class::final, "the request is too long"},
    {0x7155, Class::final, "no monitor is registered"},
    {0x7157, Class::final, "wrong content of the request"},
    {0x7164, Class::final, "wrong content of the request"},
    {0x7167, Class::final,
     "writing while the PLC runs is not allowed: set Online Change of the serial module to Enable"},
    {0x7168, Class::final, "not possible while the PLC runs"},
    {0x716D, Class::final, "wrong content of the request"},
    {0x7E40, Class::command, "this PLC does not have the command: is `model` right?"},
    {0x7E41, Class::hole, kTooMany},
    {0x7E42, Class::hole, kTooMany},
    {0x7E43, Class::hole, "no such device"},
    {0x7E47, Class::busy, "the PLC is still busy with the previous request"},
    {0x7E4F, Class::hole, "beyond the last device"},
    {0x7F20, Class::port, "characters that cannot be converted: is `format` that of the port?"},
    {0x7F21, Class::port, "the header is wrong: is `format` that of the port?"},
    {0x7F22, Class::command, "unknown command or device: is `model` right?"},
    {0x7F23, Class::port,
     "ETX or CR LF is missing or in the wrong place: is `format` that of the port?"},
    {0x7F24, Class::line, "the PLC found a wrong sum: is `sum_check` that of the port?"},
    {0x7F67, Class::line, "characters came too fast for the PLC (overrun)"},
    {0x7F69, Class::line, "the PLC found wrong parity"},
    {0x7F6A, Class::busy, "the receive buffer of the PLC is full"},
    {0xC050, Class::port,
     "ASCII data that cannot be converted: is `code` the port's Communication Data Code?"},
    {0xC051, Class::hole, kTooMany},
    {0xC052, Class::hole, kTooMany},
    {0xC053, Class::hole, kTooMany},
    {0xC054, Class::hole, kTooMany},
    {0xC056, Class::hole, "beyond the last device"},
    {0xC058, Class::final, "the length of the request does not fit its content"},
    {0xC059, Class::command, "this PLC does not have the command or subcommand: is `model` right?"},
    {0xC05B, Class::hole, "the CPU cannot reach this device"},
    {0xC05C, Class::final, "the request is not possible for this device"},
    {0xC05D, Class::final, "no monitor is registered"},
    {0xC05F, Class::port,
     "not possible for the requested station: are network, pc, module_io and module_station "
     "right?"},
    {0xC060, Class::final, "bits that are neither 0 nor 1"},
    {0xC061, Class::command,
     "the length of the request does not fit its content, or this PLC does not have its "
     "subcommand: is `model` right?"},
    {0xC06F, Class::port, "binary although ASCII is set, or the reverse: is `code` right?"},
    {0xC200, Class::port, {}, 0xFFFC},  // C200 to C204: a remote password
    {0xC204, Class::port, {}},
    {0x4A00, Class::route, "no way to this station: are network and pc right?", 0xFF00},
    {0x4B00, Class::relay, "a station on the way to this one had an error", 0xFF00},
    {0x4000, Class::final, "refused by the CPU; see the error codes in its manual", 0xF000},
};

/// Returns nullptr for an unknown code.
const EndCode* find(std::uint16_t code) {
  const auto* found = std::ranges::find_if(
      kCodes, [&](const EndCode& known) { return (code & known.mask) == known.code; });
  return found == std::end(kCodes) ? nullptr : found;
}

bool is_of(Class what, std::uint16_t code) {
  const EndCode* known = find(code);
  return known != nullptr && known->what == what;
}

/// GX Works2 sets up Q and L, GX Works3 sets up FX5 and iQ-R.
std::string_view online_change(Series series) {
  switch (series) {
    case Series::q_l:
      return "writing while the PLC runs is not allowed: in GX Works2 set \"Enable online change "
             "(FTP, MC Protocol)\" of the Ethernet port";
    case Series::iq_f:
    case Series::iq_r:
      return "writing while the PLC runs is not allowed: in GX Works3 set Enable/Disable Online "
             "Change of the Ethernet port to Enable All (SLMP)";
    default:
      return "writing while the PLC runs is not allowed: set Enable/Disable Online Change of the "
             "Ethernet port to Enable All (SLMP) in GX Works3, or \"Enable online change (FTP, MC "
             "Protocol)\" in GX Works2";
  }
}

std::string password(Series series) {
  const bool by_works3 = series == Series::iq_f || series == Series::iq_r;
  return std::string("a remote password locks this port; exclude the port from it in GX Works") +
         (series == Series::q_l ? "2"
          : by_works3           ? "3"
                                : "") +
         " (Remote Password)";
}

std::string words_of(const EndCode* known, Series series) {
  if (known == nullptr) return "an unknown reason; see the error codes in the PLC's manual";
  if (!known->text.empty()) return std::string(known->text);
  return known->code == kWriteInRun ? std::string(online_change(series)) : password(series);
}

}  // namespace

std::string end_code_text(std::uint16_t code, Series series) {
  return "end code " + hex_text(code, 4) + ": " + words_of(find(code), series);
}

RefusalMeaning meaning_of_end_code(std::uint16_t code, bool reads, bool runs_or_stops) {
  const EndCode* known = find(code);
  if (known == nullptr) return reads ? RefusalMeaning::final : RefusalMeaning::unclear;
  switch (known->what) {
    case Class::hole:
      return reads ? RefusalMeaning::hole : RefusalMeaning::final;
    case Class::line:
      return runs_or_stops ? RefusalMeaning::final : RefusalMeaning::curable;
    case Class::busy:
      return runs_or_stops ? RefusalMeaning::final : RefusalMeaning::busy;
    case Class::route:
      return reads ? RefusalMeaning::unreachable : RefusalMeaning::final;
    case Class::relay:
      return reads ? RefusalMeaning::unreachable : RefusalMeaning::unclear;
    case Class::final:
    case Class::port:
    case Class::command:
      break;
  }
  return RefusalMeaning::final;
}

bool refuses_everything(std::uint16_t code) { return is_of(Class::port, code); }

bool is_unknown_command(std::uint16_t code) { return is_of(Class::command, code); }

}  // namespace fxagent::mc
