// Explains one frame of the computer link for `fxagent decode` and the line trace. Not used to
// decode polls.
#include <algorithm>
#include <array>
#include <string>

#include "protocol/fx/computer_link.h"
#include "protocol/fx/link_frame.h"

namespace fxagent::fx {
namespace {

using namespace link;

/// Layout of the area of a command.
enum class Area : std::uint8_t { none, bits, words, bit_items, word_items, flag, text };

struct Command {
  std::string_view name;
  std::string_view operation;
  std::string_view meaning;
  Area area = Area::none;
  std::size_t device_chars = 0;
  bool writes = false;
};
constexpr std::array<Command, 14> kCommands = {{
    {"BR", "read", "read of bits", Area::bits, 5, false},
    {"WR", "read", "read of words", Area::words, 5, false},
    {"QR", "read", "read of words, long device names", Area::words, 7, false},
    {"BW", "write", "write of bits", Area::bits, 5, true},
    {"WW", "write", "write of words", Area::words, 5, true},
    {"QW", "write", "write of words, long device names", Area::words, 7, true},
    {"BT", "write", "write of scattered bits", Area::bit_items, 5, true},
    {"WT", "write", "write of scattered words", Area::word_items, 5, true},
    {"QT", "write", "write of scattered words, long device names", Area::word_items, 7, true},
    {"RR", "other", "remote RUN", Area::none, 0, false},
    {"RS", "other", "remote STOP", Area::none, 0, false},
    {"PC", "other", "which CPU is this", Area::none, 0, false},
    {"GW", "other", "global flag of every station (M8126)", Area::flag, 0, false},
    {"TT", "other", "loop-back test", Area::text, 0, false},
}};

bool all_hex(std::string_view text) {
  return std::all_of(text.begin(), text.end(),
                     [](char c) { return hex_digit(static_cast<std::uint8_t>(c)) >= 0; });
}

bool all_bits(std::string_view text) {
  return std::all_of(text.begin(), text.end(), [](char c) { return c == '0' || c == '1'; });
}

/// Returns a number of up to 8 hex digits. The caller has checked that they are.
std::uint32_t number_of(std::string_view digits) {
  std::uint32_t value = 0;
  for (const char c : digits)
    value = value << 4 | static_cast<std::uint32_t>(hex_digit(static_cast<std::uint8_t>(c)));
  return value;
}

Explanation& wrong(Explanation& explanation, std::string why) {
  explanation.ok = false;
  explanation.error = std::move(why);
  return explanation;
}

/// A device in a frame: X0040, TN123, R012000.
struct Named {
  std::string text;
  std::uint32_t bits = 16;  ///< bits of one device
};

std::optional<Named> device_in(Model model, std::string_view written) {
  const auto letters = std::min(written.find_first_of("0123456789"), written.size());
  const std::string_view head = written.substr(0, letters);
  const std::string_view digits = written.substr(letters);
  if (digits.empty() || digits.find_first_not_of("0123456789") != std::string_view::npos)
    return std::nullopt;
  // Only QR, QW and QT reach extension registers, whose names have seven characters.
  if (head == "T" || head == "C" || (head == "R" && written.size() != 7)) return std::nullopt;
  const auto address = parse_address(model, written, std::nullopt);
  if (!address) return std::nullopt;
  return Named{std::string(address->text), address->span.bits};
}

/// Adds the numbers in `data` as devices of `bits`. A word of a bit device is its 16 points.
void add_values(Explanation& out, std::string_view data, std::uint32_t bits) {
  const std::size_t digits = bits == 32 ? 8 : 4;
  for (std::size_t at = 0; at + digits <= data.size(); at += digits) {
    const std::uint32_t number = number_of(data.substr(at, digits));
    if (bits != 1)
      out.values.push_back(hex_text(number, static_cast<int>(digits)));
    else
      for (int bit = 0; bit < 16; ++bit)
        out.values.emplace_back((number >> bit & 1) != 0 ? "1" : "0");
  }
}

/// Explains the part of a request after the wait character. `area` may end with the sum.
class RequestArea final {
 public:
  RequestArea(Model model, const Command& command, std::string_view area)
      : model_(model), command_(command), area_(area) {}

  /// Returns the number of characters in the area. nullopt, with the error in `out`, if it is
  /// wrong.
  std::optional<std::size_t> explain(Explanation& out) {
    switch (command_.area) {
      case Area::none:
        return 0;
      case Area::flag:
        if (area_.empty() || !all_bits(area_.substr(0, 1)))
          return no(out, "the flag is neither 0 nor 1");
        out.values.emplace_back(area_.substr(0, 1));
        return 1;
      case Area::text:
        return text(out);
      case Area::bits:
      case Area::words:
        return run(out);
      case Area::bit_items:
      case Area::word_items:
        return items(out);
    }
    return 0;
  }

 private:
  std::nullopt_t no(Explanation& out, std::string why) const {
    wrong(out, std::move(why));
    return std::nullopt;
  }

  /// Returns the two hex digits at `at`; 0 if they are not hex digits.
  std::uint32_t points_at(std::size_t at) const {
    const std::string_view digits = area_.substr(std::min(at, area_.size()), 2);
    return digits.size() == 2 && all_hex(digits) ? number_of(digits) : 0;
  }

  std::optional<std::size_t> text(Explanation& out) {
    const std::size_t length = points_at(0);
    if (length == 0 || area_.size() < 2 + length)
      return no(out, "the text is shorter than its length says");
    out.fields.emplace_back("text", area_.substr(2, length));
    return 2 + length;
  }

  std::optional<std::size_t> run(Explanation& out) {
    const std::size_t chars = command_.device_chars;
    if (area_.size() < chars + 2) return no(out, "the request is cut short");
    const auto device = device_in(model_, area_.substr(0, chars));
    if (!device)
      return no(out, "'" + std::string(area_.substr(0, chars)) + "' is no device of " +
                         std::to_string(chars) + " characters on this model");
    out.device = device->text;
    out.fields.emplace_back("device", device->text);
    const bool by_bits = command_.area == Area::bits;
    if (by_bits && device->bits != 1) return no(out, device->text + " is a word, not a bit");
    if (!by_bits && device->bits == 1 && (device->text[0] == 'T' || device->text[0] == 'C'))
      return no(out, "contacts of timers and counters are reached bit by bit only");
    std::uint32_t points = points_at(chars);
    if (points == 0 && by_bits && !command_.writes && area_.substr(chars, 2) == "00") points = 256;
    if (points == 0) return no(out, "the number of points is not two hex digits from 01 up");
    out.fields.emplace_back("points", std::to_string(points));
    out.count = !by_bits && device->bits == 1 ? points * 16 : points;
    if (!command_.writes) return chars + 2;
    const std::size_t length = points * (by_bits ? 1U : device->bits == 32 ? 8U : 4U);
    const std::string_view data = area_.substr(chars + 2, length);
    if (data.size() < length)
      return no(out, std::to_string(data.size()) + " data characters given, " +
                         std::to_string(length) + " expected");
    if (!(by_bits ? all_bits(data) : all_hex(data)))
      return no(out, "the data are not " + std::string(by_bits ? "0 and 1" : "hex digits"));
    out.fields.emplace_back("data", data);
    if (by_bits)
      for (const char c : data) out.values.emplace_back(1, c);
    else
      add_values(out, data, device->bits);
    return chars + 2 + length;
  }

  std::optional<std::size_t> items(Explanation& out) {
    const bool by_bits = command_.area == Area::bit_items;
    const std::size_t digits = by_bits ? 1 : 4;
    const std::uint32_t points = points_at(0);
    if (points == 0) return no(out, "the number of points is not two hex digits from 01 up");
    out.fields.emplace_back("points", std::to_string(points));
    std::size_t at = 2;
    for (std::uint32_t i = 0; i < points; ++i, at += command_.device_chars + digits) {
      if (area_.size() < at + command_.device_chars + digits)
        return no(out, "only " + std::to_string(i) + " of " + std::to_string(points) +
                           " points are there");
      const std::string_view written = area_.substr(at, command_.device_chars);
      const std::string_view value = area_.substr(at + command_.device_chars, digits);
      const auto device = device_in(model_, written);
      if (!device || device->bits == 32 || (by_bits && device->bits != 1))
        return no(out, "'" + std::string(written) + "' is no device for this command");
      if (!(by_bits ? all_bits(value) : all_hex(value)))
        return no(out, "'" + std::string(value) + "' is no value of " + device->text);
      out.device = i == 0 ? device->text : *out.device + "," + device->text;
      out.fields.emplace_back(device->text, value);
      out.values.emplace_back(value);
    }
    out.count = points;
    return at;
  }

  Model model_;
  const Command& command_;
  std::string_view area_;
};

/// Judges the rest of a frame after its content: nothing, or the sum.
void judge_sum(Explanation& out, ByteView summed, std::string_view given) {
  if (given.empty()) {
    out.fields.emplace_back("sum", "none");
    return;
  }
  if (given.size() != 2) {
    wrong(out, std::to_string(given.size()) + " characters are left over; a sum has two");
    return;
  }
  const std::string computed = hex_text(link_sum(summed), 2);
  out.checksum_given = std::string(given);
  out.checksum_computed = computed;
  out.fields.emplace_back("sum", given);
  if (!all_hex(given) || number_of(given) != number_of(computed))
    wrong(out, "sum " + std::string(given) + " given, " + computed + " computed");
}

Explanation& explain_request(Explanation& out, Model model, std::string_view frame) {
  if (frame.size() < kHeader + 3) return wrong(out, "the request is cut short");
  const std::string_view name = frame.substr(kHeader, 2);
  const auto* command = std::find_if(kCommands.begin(), kCommands.end(),
                                     [&](const Command& c) { return c.name == name; });
  if (command == kCommands.end())
    return wrong(out, "'" + std::string(name) + "' is no command of an FX");
  out.operation = command->operation;
  out.command = std::string(name);
  out.fields.emplace_back("command", std::string(name) + ", " + std::string(command->meaning));
  const std::string_view wait = frame.substr(kHeader + 2, 1);
  if (!all_hex(wait)) return wrong(out, "the message wait is not a hex digit");
  out.fields.emplace_back("message wait", std::to_string(number_of(wait) * 10) + " ms");
  const std::string_view area = frame.substr(kHeader + 3);
  const auto used = RequestArea(model, *command, area).explain(out);
  if (!used) return out;
  const std::string_view summed = frame.substr(1, kHeader + 2 + *used);
  judge_sum(out, Bytes(summed.begin(), summed.end()), area.substr(*used));
  return out;
}

/// Explains the data of an answer. Only the request shows which devices they belong to.
void explain_data(Explanation& out, std::string_view data) {
  const bool loop_back = data.size() > 2 && all_hex(data.substr(0, 2)) &&
                         number_of(data.substr(0, 2)) + 2 == data.size();
  out.fields.emplace_back("data", data);
  if (data.size() == 2 && all_hex(data) && !all_bits(data)) {
    const std::string_view model = link_model(static_cast<int>(number_of(data)));
    out.values.emplace_back(data);
    out.fields.emplace_back("answer to PC", model.empty() ? "a model not known here" : model);
  } else if (data.size() % 4 == 0 && all_hex(data)) {
    add_values(out, data, 16);
  } else if (all_bits(data)) {
    for (const char c : data) out.values.emplace_back(1, c);
  } else if (loop_back) {
    out.fields.emplace_back("answer to TT", data.substr(2));
    return;
  } else {
    wrong(out, "the data are neither words nor bits");
    return;
  }
  out.count = static_cast<std::uint32_t>(out.values.size());
}

Explanation& explain_answer(Explanation& out, std::string_view frame) {
  out.operation = "data";
  const auto etx = frame.find(static_cast<char>(kEtx));
  if (etx == std::string_view::npos) return wrong(out, "there is no ETX (03)");
  if (etx <= kHeader) return wrong(out, "there are no data");
  explain_data(out, frame.substr(kHeader, etx - kHeader));
  if (!out.ok) return out;
  const std::string_view summed = frame.substr(1, etx);
  judge_sum(out, Bytes(summed.begin(), summed.end()), frame.substr(etx + 1));
  return out;
}

/// Explains ACK and NAK. A NAK of the PLC has a reason; an ACK may come from either side, and a NAK
/// without reason comes from the computer.
Explanation& explain_short(Explanation& out, std::string_view frame,
                           std::optional<Direction> direction) {
  const bool nak = static_cast<std::uint8_t>(frame[0]) == kNak;
  const std::string_view reason = frame.substr(kHeader);
  out.operation = nak ? "nak" : "ack";
  if (!reason.empty() && !(nak && reason.size() == 2 && all_hex(reason)))
    return wrong(out, "'" + std::string(reason) + "' does not belong behind " +
                          (nak ? "a NAK: its reason is two hex digits" : "an ACK"));
  const bool from_plc = nak ? !reason.empty() : true;
  out.direction = direction.value_or(from_plc ? Direction::reply : Direction::request);
  out.ambiguous = !nak && !direction;
  if (nak && out.direction != (from_plc ? Direction::reply : Direction::request))
    return wrong(out, from_plc ? "a NAK with a reason is sent by the PLC only"
                               : "a NAK without a reason is sent by the computer only");
  if (!reason.empty())
    out.fields.emplace_back("reason",
                            std::string(reason) + ", " +
                                std::string(link_refusal(static_cast<int>(number_of(reason)))));
  return out;
}

std::string_view name_of(std::uint8_t first) {
  switch (first) {
    case kStx:
      return "STX";
    case kEnq:
      return "ENQ";
    case kAck:
      return "ACK";
    case kNak:
      return "NAK";
    case kEot:
      return "EOT";
    default:
      return "CL";
  }
}

}  // namespace

Explanation explain_link_frame(Model model, ByteView bytes, std::optional<Direction> direction) {
  Explanation out;
  out.ok = true;
  out.direction = direction.value_or(Direction::request);
  out.operation = "other";
  if (bytes.empty()) return wrong(out, "no bytes");
  std::string frame = as_text(bytes);
  const bool ends_with_cr_lf = frame.size() > 2 && frame.ends_with("\r\n");
  if (ends_with_cr_lf) frame.resize(frame.size() - 2);
  const std::uint8_t first = bytes[0];
  constexpr std::array kFirst{kStx, kEnq, kAck, kNak, kEot, kCl};
  if (std::find(kFirst.begin(), kFirst.end(), first) == kFirst.end())
    return wrong(out, "a frame begins with ENQ, STX, ACK, NAK, EOT or CL, not with " +
                          to_hex(bytes.first(1)));
  out.fields.emplace_back("character", name_of(first));
  const bool from_plc = first == kStx;
  if (first != kAck && first != kNak) {
    out.direction = from_plc ? Direction::reply : Direction::request;
    if (direction && *direction != out.direction)
      return wrong(out, std::string(name_of(first)) + " is sent by the " +
                            (from_plc ? "PLC" : "computer") + " only");
  }
  if (first == kEot || first == kCl) {
    if (frame.size() != 1) return wrong(out, "nothing follows EOT and CL");
    out.fields.emplace_back("meaning", "every PLC begins anew and does not answer");
    return out;
  }
  const std::string_view head = std::string_view(frame).substr(1, 4);
  if (head.size() < 4 || !all_hex(head))
    return wrong(out, "station and PLC number are four hex digits");
  out.fields.emplace_back("station", std::to_string(number_of(head.substr(0, 2))));
  const std::uint32_t pc = number_of(head.substr(2));
  const bool on_demand = from_plc && pc == 0xFE;
  out.fields.emplace_back("PLC number",
                          std::string(head.substr(2)) + (on_demand ? ", sent on demand" : ""));
  if (pc != 0xFF && !on_demand) return wrong(out, "the PLC number of an FX is FF");
  if (first == kEnq)
    explain_request(out, model, frame);
  else if (first == kStx)
    explain_answer(out, frame);
  else
    explain_short(out, frame, direction);
  out.format = ends_with_cr_lf ? 4 : 1;
  if (ends_with_cr_lf) out.fields.emplace_back("end", "CR LF: format 4");
  return out;
}

}  // namespace fxagent::fx
