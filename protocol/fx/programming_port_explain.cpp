// Explains one frame of the programming port for `fxagent decode` and the line trace. Not used to
// decode polls.
#include <algorithm>
#include <array>
#include <string>

#include "protocol/fx/port_frame.h"
#include "protocol/fx/programming_port.h"

namespace fxagent::fx {
namespace {

/// Frames that the agent never sends, listed so that captures with them can be explained.
struct Special {
  std::string_view command;
  std::size_t digits;  // digits of the whole payload; 0: any
  std::string_view meaning;
};
constexpr std::array<Special, 17> kSpecials = {{
    {"A1", 2, "line speed 19200"},
    {"A2", 2, "line speed 38400"},
    {"A3", 2, "line speed 57600"},
    {"A5", 2, "line speed 115200 (unverified)"},
    {"B", 1, "end of program download"},
    {"E01", 0, "read of program memory"},
    {"E11", 0, "write of program memory"},
    {"E41", 11, "search in program memory"},
    {"E6", 3, "clear memory"},
    {"EC", 11, "challenge of an FX3"},
    {"EEA", 11, "unknown, seen from GX Works2"},
    {"ED1", 0, "online change"},
    {"F501", 9, "random read of one bit (FX3)"},
    {"F501", 10, "random read of one word (FX3)"},
    {"F7", 15, "fill program memory (FX3)"},
    {"4", 0, "unknown, seen from GX Works2"},
    {"E", 0, "unknown extended command"},
}};

// Addresses of the extended sets that do not belong to devices.
constexpr std::uint32_t kMonitorList = 0x1400;
constexpr std::uint32_t kMonitorResult = 0x1790;
// In the classic set, program parameters and steps of an FX1S start here.
constexpr std::uint32_t kClassicProgram = 0x8000;

bool all_hex(std::string_view text) {
  return std::all_of(text.begin(), text.end(),
                     [](char c) { return hex_digit(static_cast<std::uint8_t>(c)) >= 0; });
}

/// Returns a number of up to 8 hex digits. The caller has checked that they are.
std::uint32_t number_of(std::string_view digits) {
  std::uint32_t value = 0;
  for (const char c : digits)
    value = value * 16 + static_cast<std::uint32_t>(hex_digit(static_cast<std::uint8_t>(c)));
  return value;
}

Bytes bytes_of(std::string_view digits) {
  Bytes bytes;
  for (std::size_t i = 0; i + 1 < digits.size(); i += 2)
    bytes.push_back(static_cast<std::uint8_t>(number_of(digits.substr(i, 2))));
  return bytes;
}

/// Returns data as devices of `bits` each: bits lowest first, numbers with 4 or 8 digits.
std::vector<std::string> values_of(ByteView image, std::uint32_t bits) {
  std::vector<std::string> values;
  if (bits == 1) {
    for (const std::uint8_t byte : image)
      for (int bit = 0; bit < 8; ++bit) values.emplace_back((byte >> bit & 1) != 0 ? "1" : "0");
    return values;
  }
  const std::size_t width = bits / 8;
  for (std::size_t at = 0; at + width <= image.size(); at += width) {
    std::uint32_t number = 0;
    for (std::size_t i = width; i > 0; --i) number = number << 8 | image[at + i - 1];
    values.push_back(hex_text(number, static_cast<int>(width * 2)));
  }
  return values;
}

Explanation& wrong(Explanation& explanation, std::string why) {
  explanation.ok = false;
  explanation.error = std::move(why);
  return explanation;
}

/// Explains a payload in one direction. A payload that does not fit the direction is an error.
class Explainer final {
 public:
  explicit Explainer(Model model, std::string_view payload)
      : model_(model == Model::unknown ? Model::fx3u : model), payload_(payload) {}

  Explanation request() const {
    Explanation out;
    out.ok = true;
    out.direction = Direction::request;
    if (payload_.empty() || !all_hex(payload_)) return wrong(out, "the payload is not hex digits");
    if (starts("0") || starts("1")) return memory(out, CommandSet::classic, 1);
    if (starts("7") || starts("8")) return force(out, CommandSet::classic, 1);
    if (starts("E00") || starts("E10")) return memory(out, CommandSet::extended, 3);
    if (starts("E7") || starts("E8")) return force(out, CommandSet::extended, 2);
    return special(out);
  }

  Explanation reply() const {
    Explanation out;
    out.ok = true;
    out.direction = Direction::reply;
    out.operation = "data";
    if (payload_.empty() || !all_hex(payload_)) return wrong(out, "the payload is not hex digits");
    if (payload_.size() % 2 != 0)
      return wrong(out, "an odd number of digits (" + std::to_string(payload_.size()) +
                            "); data are two for each byte");
    const Bytes image = bytes_of(payload_);
    // Whole words may also be bits: the reply does not contain the kind of its devices.
    out.values = values_of(image, image.size() % 2 == 0 ? 16 : 1);
    out.count = static_cast<std::uint32_t>(out.values.size());
    out.fields.emplace_back("data", to_hex(image));
    return out;
  }

 private:
  bool starts(std::string_view head) const { return payload_.substr(0, head.size()) == head; }

  void command(Explanation& out, CommandSet set, std::size_t digits) const {
    out.command = std::string(payload_.substr(0, digits));
    out.command_set = set == CommandSet::classic ? "classic" : "extended";
    out.fields.emplace_back("command", *out.command);
  }

  /// Explains reads and writes: command, four digits of address, two of byte count, data.
  Explanation memory(Explanation& out, CommandSet set, std::size_t digits) const {
    command(out, set, digits);
    const bool write = payload_[digits == 1 ? 0 : 1] == '1';
    out.operation = write ? "write" : "read";
    const std::string_view rest = payload_.substr(digits);
    if (rest.size() < 6) return wrong(out, "the address or the byte count is cut short");
    const std::uint32_t address = number_of(rest.substr(0, 4));
    const std::uint32_t bytes = number_of(rest.substr(4, 2));
    out.fields.emplace_back("address", hex_text(address, 4));
    out.fields.emplace_back("bytes", std::to_string(bytes));
    name_memory(out, set, address, bytes);
    const std::string_view data = rest.substr(6);
    const std::size_t expected = write ? bytes * 2 : 0;
    if (data.size() != expected)
      return wrong(out, std::to_string(data.size()) + " data digits follow, " +
                            std::to_string(expected) + " expected");
    if (bytes == 0) return wrong(out, "a byte count of 0");
    if (write) {
      const Bytes image = bytes_of(data);
      const PortArea* area = area_at_byte(map_of(model_, set), address);
      const std::uint32_t bits = area != nullptr ? kind_of(area->space).bits : 16;
      const std::uint32_t fitting = bits != 1 && image.size() % (bits / 8) != 0 ? 16 : bits;
      out.values = values_of(image, fitting);
      out.fields.emplace_back("data", to_hex(image));
    }
    return out;
  }

  void name_memory(Explanation& out, CommandSet set, std::uint32_t address,
                   std::uint32_t bytes) const {
    const PortArea* area = area_at_byte(map_of(model_, set), address);
    if (area == nullptr) {
      if (set == CommandSet::classic && address >= kClassicProgram)
        out.fields.emplace_back("area", "program memory");
      if (set == CommandSet::extended && address >= kMonitorList && address < kMonitorResult)
        out.fields.emplace_back("area", "monitor list");
      if (set == CommandSet::extended && address == kMonitorResult)
        out.fields.emplace_back("area", "monitor result");
      return;
    }
    const DeviceKind& kind = kind_of(area->space);
    const std::uint32_t first_bit = (address - area->address) * 8;
    if (first_bit % kind.bits != 0) {
      out.fields.emplace_back("area",
                              "second half of " + device_name({id(area->space), first_bit, 8}));
      return;
    }
    out.device = device_name({id(area->space), first_bit, kind.bits});
    out.count = bytes * 8 / kind.bits;
    out.fields.emplace_back("device", *out.device);
  }

  /// Explains forces: command, bit address with its low byte first.
  Explanation force(Explanation& out, CommandSet set, std::size_t digits) const {
    command(out, set, digits);
    out.operation = payload_[digits - 1] == '7' ? "force_on" : "force_off";
    const std::string_view rest = payload_.substr(digits);
    if (rest.size() != 4)
      return wrong(out,
                   "a force has four digits of address, here are " + std::to_string(rest.size()));
    const std::uint32_t address = number_of(rest.substr(2, 2)) << 8 | number_of(rest.substr(0, 2));
    out.fields.emplace_back("bit address", hex_text(address, 4));
    if (const PortArea* area = area_at_bit(map_of(model_, set), address)) {
      out.device = device_name({id(area->space), address - *area->force, 1});
      out.count = 1;
      out.fields.emplace_back("device", *out.device);
    }
    return out;
  }

  Explanation special(Explanation& out) const {
    for (const Special& known : kSpecials) {
      if (!starts(known.command) || (known.digits != 0 && known.digits != payload_.size()))
        continue;
      out.operation = "other";
      out.command = std::string(known.command);
      out.fields.emplace_back("command", *out.command);
      out.fields.emplace_back("meaning", std::string(known.meaning));
      return out;
    }
    return wrong(out, "'" + std::string(payload_) + "' is no request of this protocol");
  }

  Model model_;
  std::string_view payload_;
};

Explanation explain_character(std::uint8_t character, std::optional<Direction> direction) {
  Explanation out;
  out.ok = true;
  out.direction = character == kEnq ? Direction::request : Direction::reply;
  out.operation = character == kEnq ? "enquire" : character == kAck ? "ack" : "nak";
  out.fields.emplace_back("character", character == kEnq   ? "ENQ"
                                       : character == kAck ? "ACK"
                                                           : "NAK");
  if (direction && *direction != out.direction)
    return wrong(out, out.operation + " is sent by the " +
                          (character == kEnq ? "computer" : "PLC") + " only");
  return out;
}

/// Returns the likelier meaning of a frame without direction. A request has an odd number of
/// digits, except forces and a few specials; data always have an even number. A reply of one byte
/// with the same digits as a speed command is by far more frequent than the command.
Explanation likelier(const Explainer& explainer, std::size_t digits) {
  Explanation request = explainer.request();
  Explanation reply = explainer.reply();
  if (!request.ok && reply.ok) return reply;
  const bool both = request.ok && reply.ok;
  Explanation& taken = both && digits == 2 ? reply : request;
  taken.ambiguous = both;
  return taken;
}

}  // namespace

Explanation explain_port_frame(Model model, ByteView frame, std::optional<Direction> direction) {
  Explanation out;
  out.direction = direction.value_or(Direction::request);
  out.operation = "other";
  if (frame.empty()) return wrong(out, "no bytes");
  const std::uint8_t first = frame.front();
  if (frame.size() == 1 && (first == kEnq || first == kAck || first == kNak))
    return explain_character(first, direction);
  if (first != kStx) return wrong(out, "the frame does not begin with STX (02)");
  const auto etx = std::find(frame.begin(), frame.end(), kEtx);
  if (etx == frame.end()) return wrong(out, "there is no ETX (03)");
  const auto length = static_cast<std::size_t>(etx - frame.begin());
  const std::size_t behind = frame.size() - length - 1;
  if (behind != 2)
    return wrong(out,
                 "two digits of sum follow ETX, here are " + std::to_string(behind) + " bytes");

  const std::string payload = as_text(frame.subspan(1, length - 1));
  const Explainer explainer(model, payload);
  out = !direction                         ? likelier(explainer, payload.size())
        : *direction == Direction::request ? explainer.request()
                                           : explainer.reply();
  const std::string computed = hex_text(port_sum(frame.subspan(1, length)), 2);
  const ByteView given = frame.last(2);
  const bool printable = hex_digit(given[0]) >= 0 && hex_digit(given[1]) >= 0;
  out.checksum_given = printable ? as_text(given) : to_hex(given);
  out.checksum_computed = computed;
  if (out.ok && (!printable || number_of(*out.checksum_given) != number_of(computed)))
    return wrong(out, "sum " + *out.checksum_given + " given, " + computed + " computed");
  return out;
}

}  // namespace fxagent::fx
