// Explains one frame of the programming port for `fxagent decode` and the line trace. Not used to
// decode polls.
#include <algorithm>
#include <string>

#include "protocol/frame_walk.h"
#include "protocol/fx/programming_port.h"

namespace fxagent::fx {
namespace {

// Addresses of the extended sets that do not belong to devices.
constexpr std::uint32_t kMonitorList = 0x1400;
constexpr std::uint32_t kMonitorResult = 0x1790;
// In the classic set, program parameters and steps of an FX1S start here.
constexpr std::uint32_t kClassicProgram = 0x8000;

/// Walks a request after its command.
class RequestWalk final : public FrameWalk {
 public:
  RequestWalk(Explanation& out, ByteView rest, Model model, CommandSet set)
      : FrameWalk(out, NumberForm::digits, rest), set_(set), map_(map_of(model, set)) {}

  void address(const Field& field) {
    if (left() < 6) return fault("the address or the byte count is truncated");
    address_ = number(field);
    show(field.name, hex_text(address_, 4));
  }

  void bytes(const Field& field) {
    const std::uint32_t count = number(field);
    show(field.name, std::to_string(count));
    name_memory(count);
    const std::size_t expected = out_.operation == "write" ? 2 * count : 0;
    if (left() != expected)
      return fault(std::to_string(left()) + " data digits follow, " + std::to_string(expected) +
                   " expected");
    if (count == 0) fault("a byte count of 0");
  }

  void data(const Field& field) {
    const Bytes image = *bytes_in(left_);
    const std::uint32_t bits = area_ != nullptr ? kind_of(area_->space).bits : 16;
    const bool halves = bits == 32 && image.size() % 4 != 0;
    add_values(out_, NumberForm::low_first, image, bits == 1 ? 2 : halves ? 4 : bits / 4, bits);
    show(field.name, to_hex(image));
  }

  /// Its low byte comes first.
  void bit_address(const Field& field) {
    if (left() != field.digits)
      return fault("a force has four digits of address, not " + std::to_string(left()));
    const std::uint32_t low = number(2, field.name);
    const std::uint32_t address = number(2, field.name) << 8 | low;
    show(field.name, hex_text(address, 4));
    if (const PortArea* area = area_at_bit(map_, address))
      device({id(area->space), address - *area->force, 1}, 1);
  }

 private:
  void device(const Span& span, std::uint32_t count) {
    out_.device = device_name(span);
    out_.count = count;
    show("device", *out_.device);
  }

  void name_memory(std::uint32_t count) {
    area_ = area_at_byte(map_, address_);
    if (area_ != nullptr) {
      const std::uint32_t bits = kind_of(area_->space).bits;
      const std::uint32_t first_bit = (address_ - area_->address) * 8;
      if (first_bit % bits == 0)
        return device({id(area_->space), first_bit, bits}, count * 8 / bits);
      show("area", "second half of " + device_name({id(area_->space), first_bit, 8}));
    } else if (set_ == CommandSet::classic) {
      if (address_ >= kClassicProgram) show("area", "program memory");
    } else if (address_ >= kMonitorList && address_ <= kMonitorResult) {
      show("area", address_ == kMonitorResult ? "monitor result" : "monitor list");
    }
  }

  CommandSet set_;
  PortMap map_;
  std::uint32_t address_ = 0;
  const PortArea* area_ = nullptr;  ///< nullptr: the address belongs to no device
};

struct PortCommand {
  std::string_view code;
  std::string_view operation;
  Fields fields{};
  std::size_t digits = 0;  ///< digits of the whole payload; 0: any
  std::string_view meaning{};
};
constexpr Field kAddress = read_by<&RequestWalk::address>("address", 4);
constexpr Field kBytes = read_by<&RequestWalk::bytes>("bytes", 2);
constexpr Field kData = read_by<&RequestWalk::data>("data");
constexpr Field kBitAddress = read_by<&RequestWalk::bit_address>("bit address", 4);
/// The first row that fits a payload is its command. The agent never sends a command with a
/// meaning; captures may contain it.
constexpr PortCommand kPortCommands[] = {
    {"0", "read", {kAddress, kBytes}},
    {"1", "write", {kAddress, kBytes, kData}},
    {"7", "force_on", {kBitAddress}},
    {"8", "force_off", {kBitAddress}},
    {"E00", "read", {kAddress, kBytes}},
    {"E10", "write", {kAddress, kBytes, kData}},
    {"E7", "force_on", {kBitAddress}},
    {"E8", "force_off", {kBitAddress}},
    {"A1", "other", {}, 2, "line speed 19200"},
    {"A2", "other", {}, 2, "line speed 38400"},
    {"A3", "other", {}, 2, "line speed 57600"},
    {"A5", "other", {}, 2, "line speed 115200 (unverified)"},
    {"B", "other", {}, 1, "end of program download"},
    {"E01", "other", {}, 0, "read of program memory"},
    {"E11", "other", {}, 0, "write of program memory"},
    {"E41", "other", {}, 11, "search in program memory"},
    {"E6", "other", {}, 3, "clear memory"},
    {"EC", "other", {}, 11, "challenge of an FX3"},
    {"EEA", "other", {}, 11, "unknown, seen from GX Works2"},
    {"ED1", "other", {}, 0, "online change"},
    {"F501", "other", {}, 9, "random read of one bit (FX3)"},
    {"F501", "other", {}, 10, "random read of one word (FX3)"},
    {"F7", "other", {}, 15, "fill program memory (FX3)"},
    {"4", "other", {}, 0, "unknown, seen from GX Works2"},
    {"E", "other", {}, 0, "unknown extended command"},
};

/// Explains a payload in one direction. One that does not fit the direction is an error.
Explanation explain_request(Model model, ByteView payload) {
  Explanation out = begin_explanation(Direction::request);
  out.operation.clear();
  const std::string text = as_text(payload);
  if (text.empty() || !is_hex(payload)) return wrong(out, "the payload is not hex digits");
  const auto* known =
      std::find_if(std::begin(kPortCommands), std::end(kPortCommands), [&](auto& c) {
        return text.starts_with(c.code) && (c.digits == 0 || c.digits == text.size());
      });
  if (known == std::end(kPortCommands))
    return wrong(out, "'" + text + "' is not a request of this protocol");
  out.operation = known->operation;
  out.command = std::string(known->code);
  out.fields.emplace_back("command", known->code);
  if (!known->meaning.empty()) {
    out.fields.emplace_back("meaning", known->meaning);
    return out;
  }
  const auto set = known->code.size() == 1 ? CommandSet::classic : CommandSet::extended;
  out.command_set = set == CommandSet::classic ? "classic" : "extended";
  RequestWalk(out, payload.subspan(known->code.size()), model, set).walk(known->fields);
  return out;
}

Explanation explain_answer(ByteView payload) {
  Explanation out = begin_explanation(Direction::reply);
  out.operation = "data";
  if (payload.empty() || !is_hex(payload)) return wrong(out, "the payload is not hex digits");
  if (payload.size() % 2 != 0)
    return wrong(out, "an odd number of digits (" + std::to_string(payload.size()) +
                          "); data are two for each byte");
  const Bytes image = *bytes_in(payload);
  // Whole words may also be bits: the reply does not contain the kind of its devices.
  const bool words = image.size() % 2 == 0;
  add_values(out, NumberForm::low_first, image, words ? 4 : 2, words ? 16 : 1);
  out.count = static_cast<std::uint32_t>(out.values.size());
  out.fields.emplace_back("data", to_hex(image));
  return out;
}

Explanation explain_character(std::uint8_t character, std::optional<Direction> direction) {
  const bool asks = character == kEnq;
  Explanation out = begin_explanation(asks ? Direction::request : Direction::reply);
  out.operation = asks ? "enquire" : character == kAck ? "ack" : "nak";
  out.fields.emplace_back("character", asks ? "ENQ" : character == kAck ? "ACK" : "NAK");
  if (direction && *direction != out.direction)
    return wrong(out, out.operation + " is sent by the " + (asks ? "computer" : "PLC") + " only");
  return out;
}

/// Returns the likelier meaning of a frame without direction. A request has an odd number of
/// digits, except forces and a few specials; data always have an even number. A reply of one byte
/// with the same digits as a speed command is by far more frequent than the command.
Explanation likelier(Model model, ByteView payload) {
  Explanation request = explain_request(model, payload);
  Explanation reply = explain_answer(payload);
  if (!request.ok && reply.ok) return reply;
  const bool both = request.ok && reply.ok;
  Explanation& taken = both && payload.size() == 2 ? reply : request;
  taken.ambiguous = both;
  return taken;
}

}  // namespace

Explanation ProgrammingPort::explain(ByteView frame, std::optional<Direction> direction) const {
  Explanation out = begin_explanation(direction);
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
    return wrong(out, "two digits of sum follow ETX, not " + std::to_string(behind) + " bytes");
  const Model model = settings_.model == Model::unknown_fx ? Model::fx3u : settings_.model;
  const ByteView payload = frame.subspan(1, length - 1);
  out = !direction                         ? likelier(model, payload)
        : *direction == Direction::request ? explain_request(model, payload)
                                           : explain_answer(payload);
  const ByteView given = frame.last(2);
  return judge_sum(out, is_hex(given) ? as_text(given) : to_hex(given),
                   byte_sum(frame.subspan(1, length)));
}

}  // namespace fxagent::fx
