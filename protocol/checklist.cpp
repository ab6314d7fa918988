#include "protocol/checklist.h"

#include <algorithm>
#include <string_view>
#include <utility>
#include <variant>

#include "protocol/plc.h"

namespace fxagent {
namespace {

const SettingHints& hints_for(const ProtocolInfo& protocol, const Codec& codec) {
  const std::string model = model_of(codec);
  const auto found = std::ranges::find(protocol.model_hints, std::string_view(model),
                                       &std::pair<std::string_view, SettingHints>::first);
  return found == protocol.model_hints.end() ? protocol.hints : found->second;
}

/// Adds the value of each option after its name: "`unit`" becomes "`unit` (5)".
std::string with_values(std::string_view text, const Options& options) {
  std::string out;
  for (std::size_t at = 0; at < text.size();) {
    const std::size_t begin = std::min(text.find('`', at), text.size());
    const std::size_t end = text.find('`', std::min(begin + 1, text.size()));
    if (end == text.npos) return out.append(text.substr(at));
    out.append(text.substr(at, end + 1 - at));
    const auto option = options.find(text.substr(begin + 1, end - begin - 1));
    if (option != options.end()) out.append(" (").append(to_string(option->second)).append(")");
    at = end + 1;
  }
  return out;
}

/// Returns the settings that route to a station behind the connected PLC.
std::string of_route(const ProtocolInfo& protocol, const Options& options) {
  std::string out;
  for (const std::string_view key : {"network", "pc", "module_io", "module_station"}) {
    const auto spec = std::ranges::find(protocol.options, key, &OptionSpec::key);
    const auto* number = option<std::int64_t>(options, key);
    if (spec == protocol.options.end() || number == nullptr ||
        *number == std::get<std::int64_t>(spec->fallback))
      continue;
    out.append("; is `")
        .append(key)
        .append("` (")
        .append(std::to_string(*number))
        .append(") right");
  }
  return out;
}

/// Returns the questions about the line itself. They depend on the protocol only in whether devices
/// share the line.
std::string of_serial_port(const ProtocolInfo& protocol, const Wiring& wiring) {
  std::string out;
  if (wiring.line)
    out = "; does the device have the speed, data bits and parity of this port, " +
          to_string(*wiring.line);
  if (protocol.multidrop)
    out.append("; are A and B (D+ and D-) of RS-485 swapped; ")
        .append(wiring.echo ? "does the adapter return what is sent, as `echo` says"
                            : "does a two-wire adapter return what is sent (then set `echo`), or "
                              "need `rs485` to switch its direction");
  return out + "; does another program, panel or master use the line?";
}

std::string of_serial_server() {
  return "; does the serial server's line have the speed, data bits and parity of the device; does "
         "the server pass bytes unchanged (raw TCP; a Modbus gateway needs modbus-tcp); are A and "
         "B (D+ and D-) swapped; does another client or master use the line?";
}

std::string headline(const Wiring& wiring, Answers answers) {
  switch (answers) {
    case Answers::from_others:
      return "no answer, although other devices on " + wiring.place + " answer";
    case Answers::of_gateway:
      return "the gateway " + wiring.place + " answers, but the device behind it does not";
    default:
      return "no answer on " + wiring.place;
  }
}

/// Returns the number that the device has among others: "`unit` (5)".
std::string own_number(const Options& options) {
  for (const char* key : {"unit", "station"})
    if (options.contains(key)) return with_values(std::string("`") + key + "`", options);
  return "the device";
}

/// Returns the text for a device that has answered before, so that its settings were right.
std::string of_stopped(const Options& options, const Wiring& wiring, Answers answers) {
  const bool is_serial = wiring.channel == Wiring::Channel::serial;
  if (answers == Answers::others_now)
    return own_number(options) + " has answered before, and other devices on " + wiring.place +
           " still answer. Check: does it have power; is its own wire" +
           (is_serial ? "" : " behind " + wiring.place) + " in order; were its settings changed?";
  return std::string("it has answered before. Check: does it have power; ") +
         (is_serial ? "is its cable in place; does another program, panel or master use the line"
                    : "does the network reach it; does another program hold its connection") +
         "; were its settings changed?";
}

}  // namespace

std::string to_string(const LineDefaults& line) {
  const char parity = line.parity == Parity::none ? 'N' : line.parity == Parity::even ? 'E' : 'O';
  return std::to_string(line.baud) + " baud " + std::to_string(line.data_bits) + parity +
         std::to_string(line.stop_bits);
}

std::string_view checklist_of_closed(const ProtocolInfo& protocol, const Codec& codec) {
  return hints_for(protocol, codec).closed;
}

std::string checklist(const ProtocolInfo& protocol, const Options& options, const Codec& codec,
                      const Wiring& wiring, Answers answers) {
  if (answers == Answers::until_now || answers == Answers::others_now)
    return of_stopped(options, wiring, answers);
  std::string out = headline(wiring, answers);
  out.append(". Check: does the device have power; ")
      .append(with_values(hints_for(protocol, codec).silent, options));
  if (protocol.plc_line_word && wiring.line)
    out.append("; ").append(protocol.plc_line_word(options, *wiring.line));
  out.append(of_route(protocol, options));
  if (!protocol.on_serial) return out + "?";
  if (answers == Answers::from_others)
    return out +
           "; does it have the speed, data bits and parity of the others; is its own wire in "
           "order?";
  return out + (wiring.channel == Wiring::Channel::serial ? of_serial_port(protocol, wiring)
                                                          : of_serial_server());
}

}  // namespace fxagent
