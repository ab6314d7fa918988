// Explains one frame of the computer link for `fxagent decode` and the line trace. Not used to
// decode polls.
#include <algorithm>
#include <string>

#include "protocol/device_walk.h"
#include "protocol/fx/computer_link.h"

namespace fxagent::fx {
namespace {

struct LinkCommand;

/// Walks a frame after its first character.
class LinkWalk final : public DeviceWalk {
 public:
  LinkWalk(Explanation& out, ByteView frame, Model model)
      : DeviceWalk(out, NumberForm::digits, frame.subspan(1)), frame_(frame), model_(model) {}

  /// Returns false if the frame has no valid station and PLC number.
  bool explain(std::optional<Direction> direction);

  void pc_number(const Field& field);
  void command(const Field& field);
  void message_wait(const Field& field);
  void flag(const Field& field);

 private:
  std::optional<FrameDevice> device_in(ByteView wire) override;
  void request();
  void answer();
  void answer_data(ByteView data);
  void ack_or_nak(std::optional<Direction> direction);
  void sum();

  ByteView frame_;
  Model model_;
  const LinkCommand* command_ = nullptr;
};

struct LinkCommand {
  std::string_view name;
  std::string_view operation;
  std::string_view meaning;
  Fields area;
};
constexpr Fields kHead = {read_by<&LinkWalk::decimal>("station", 2),
                          read_by<&LinkWalk::pc_number>("PLC number", 2)};
constexpr Fields kRequest = {read_by<&LinkWalk::command>("command", 2),
                             read_by<&LinkWalk::message_wait>("message wait", 1)};
constexpr Field kBitDevice = read_by<&LinkWalk::bit_device>("device", 5);
constexpr Field kWordDevice = read_by<&LinkWalk::word_device>("device", 5);
constexpr Field kLongDevice = read_by<&LinkWalk::word_device>("device", 7);
constexpr Field kPoints = read_by<&LinkWalk::points>("points", 2);
constexpr Field kPointsTo256 = read_by<&LinkWalk::points_to_256>("points", 2);
constexpr Field kBits = read_by<&LinkWalk::bits>("data");
constexpr Field kWords = read_by<&LinkWalk::words>("data");
constexpr Field kBitItems = read_by<&LinkWalk::bit_items>("", 5);
constexpr Field kWordItems = read_by<&LinkWalk::word_items>("", 5);
constexpr Field kLongItems = read_by<&LinkWalk::word_items>("", 7);
constexpr Field kFlag = read_by<&LinkWalk::flag>("");
constexpr Field kText = read_by<&LinkWalk::text>("text");

constexpr LinkCommand kLinkCommands[] = {
    {"BR", "read", "read of bits", {kBitDevice, kPointsTo256}},
    {"WR", "read", "read of words", {kWordDevice, kPoints}},
    {"QR", "read", "read of words, long device names", {kLongDevice, kPoints}},
    {"BW", "write", "write of bits", {kBitDevice, kPoints, kBits}},
    {"WW", "write", "write of words", {kWordDevice, kPoints, kWords}},
    {"QW", "write", "write of words, long device names", {kLongDevice, kPoints, kWords}},
    {"BT", "write", "write of scattered bits", {kPoints, kBitItems}},
    {"WT", "write", "write of scattered words", {kPoints, kWordItems}},
    {"QT", "write", "write of scattered words, long device names", {kPoints, kLongItems}},
    {"RR", "other", "remote RUN", {}},
    {"RS", "other", "remote STOP", {}},
    {"PC", "other", "which CPU is this", {}},
    {"GW", "other", "global flag of every station (M8126)", {kFlag}},
    {"TT", "other", "loop-back test", {kText}},
};

void LinkWalk::pc_number(const Field& field) {
  const std::uint32_t pc = number(field);
  const bool on_demand = frame_[0] == kStx && pc == 0xFE;
  show(field.name, as_text(frame_.subspan(3, 2)) + (on_demand ? ", sent on demand" : ""));
  if (pc != 0xFF && !on_demand) fault("the PLC number of an FX is FF");
}

void LinkWalk::command(const Field& field) {
  const std::string name = as_text(take(field.digits, field.name));
  const auto* found = std::ranges::find(kLinkCommands, name, &LinkCommand::name);
  if (found == std::end(kLinkCommands)) return fault("'" + name + "' is not a command of an FX");
  command_ = found;
  out_.operation = found->operation;
  out_.command = name;
  show(field.name, name + ", " + std::string(found->meaning));
}

void LinkWalk::message_wait(const Field& field) {
  if (!is_hex(left_.first(1))) return fault("the message wait is not a hex digit");
  show(field.name, std::to_string(number(field) * 10) + " ms");
}

void LinkWalk::flag(const Field& field) {
  if (left() == 0 || !add_bits(out_, form_, left_, 1)) return fault("the flag is neither 0 nor 1");
  take(1, field.name);
}

std::optional<FrameDevice> LinkWalk::device_in(ByteView wire) {
  const std::string written = as_text(wire);
  const auto letters = std::min(written.find_first_of("0123456789"), written.size());
  const std::string head = written.substr(0, letters);
  if (letters == written.size() || written.find_first_not_of("0123456789", letters) != written.npos)
    return std::nullopt;
  // Only QR, QW and QT reach extension registers, whose names have seven characters.
  if (head == "T" || head == "C" || (head == "R" && written.size() != 7)) return std::nullopt;
  const auto address = fx::parse_address(model_, written, std::nullopt);
  if (!address) return std::nullopt;
  const bool only_bits = address->span.bits == 1 && (head[0] == 'T' || head[0] == 'C');
  return FrameDevice{std::string(address->text), address->span.bits, only_bits};
}

/// Explains what is left: nothing, or the sum of all before.
void LinkWalk::sum() {
  if (!good()) return;
  if (left() != 0 && left() != 2)
    return fault(std::to_string(left()) + " characters are left over; a sum has two");
  show("sum", left() == 0 ? "none" : as_text(left_));
  if (left() != 0) judge_sum(out_, as_text(left_), byte_sum(frame_.subspan(1, frame_.size() - 3)));
}

void LinkWalk::request() {
  if (left() < 3) return fault("the request is truncated");
  walk(kRequest);
  if (good()) walk(command_->area);
  sum();
}

/// Only the request shows which devices the data belong to.
void LinkWalk::answer_data(ByteView data) {
  const std::string text = as_text(data);
  show("data", text);
  const bool are_bits = text.find_first_not_of("01") == text.npos;
  if (text.size() == 2 && is_hex(data) && !are_bits) {
    const std::string_view model = link_model(static_cast<int>(*number_in(form_, data)));
    out_.values.push_back(text);
    show("answer to PC", model.empty() ? "an unknown model" : model);
  } else if (text.size() % 4 == 0 && is_hex(data)) {
    add_values(out_, form_, data, 4);
  } else if (are_bits) {
    add_bits(out_, form_, data, data.size());
  } else if (data.size() > 2 && number_in(form_, data.first(2)) == data.size() - 2) {
    show("answer to TT", text.substr(2));
    return;
  } else {
    return fault("the data are neither words nor bits");
  }
  out_.count = static_cast<std::uint32_t>(out_.values.size());
}

void LinkWalk::answer() {
  out_.operation = "data";
  const auto size =
      static_cast<std::size_t>(std::find(left_.begin(), left_.end(), kEtx) - left_.begin());
  if (size == left()) return fault("there is no ETX (03)");
  if (size == 0) return fault("there are no data");
  answer_data(left_.first(size));
  left_ = left_.subspan(size + 1);
  sum();
}

/// A NAK of the PLC has a reason. An ACK may come from either side, and a NAK without reason comes
/// from the computer.
void LinkWalk::ack_or_nak(std::optional<Direction> direction) {
  const bool nak = frame_[0] == kNak;
  out_.operation = nak ? "nak" : "ack";
  if (left() != 0 && !(nak && left() == 2 && is_hex(left_)))
    return fault("'" + as_text(left_) + "' must not follow " +
                 (nak ? "a NAK: its reason is two hex digits" : "an ACK"));
  const Direction sender = nak && left() == 0 ? Direction::request : Direction::reply;
  out_.direction = direction.value_or(sender);
  out_.ambiguous = !nak && !direction;
  if (nak && out_.direction != sender)
    return fault(sender == Direction::reply
                     ? "a NAK with a reason is sent by the PLC only"
                     : "a NAK without a reason is sent by the computer only");
  if (left() != 0)
    show("reason", as_text(left_) + ", " +
                       std::string(link_refusal(static_cast<int>(*number_in(form_, left_)))));
}

bool LinkWalk::explain(std::optional<Direction> direction) {
  if (left() < 4 || !is_hex(left_.first(4)))
    return fault("station and PLC number are four hex digits"), false;
  walk(kHead);
  if (!good()) return false;
  if (frame_[0] == kEnq)
    request();
  else if (frame_[0] == kStx)
    answer();
  else
    ack_or_nak(direction);
  return true;
}

struct First {
  std::uint8_t character;
  std::string_view name;
  std::optional<Direction> direction;  ///< nullopt: either side sends it
};
constexpr First kFirst[] = {{kEnq, "ENQ", Direction::request}, {kStx, "STX", Direction::reply},
                            {kAck, "ACK", std::nullopt},       {kNak, "NAK", std::nullopt},
                            {kEot, "EOT", Direction::request}, {kCl, "CL", Direction::request}};

}  // namespace

Explanation ComputerLink::explain(ByteView bytes, std::optional<Direction> direction) const {
  Explanation out = begin_explanation(direction);
  if (bytes.empty()) return wrong(out, "no bytes");
  const auto* first = std::ranges::find(kFirst, bytes[0], &First::character);
  if (first == std::end(kFirst))
    return wrong(out, "a frame begins with ENQ, STX, ACK, NAK, EOT or CL, not with " +
                          to_hex(bytes.first(1)));
  out.fields.emplace_back("character", first->name);
  out.direction = first->direction.value_or(out.direction);
  if (direction && *direction != out.direction)
    return wrong(out, std::string(first->name) + " is sent by the " +
                          (out.direction == Direction::reply ? "PLC" : "computer") + " only");
  const bool ends_with_cr_lf = as_text(bytes).ends_with("\r\n") && bytes.size() > 2;
  const ByteView frame = bytes.first(bytes.size() - (ends_with_cr_lf ? 2 : 0));
  if (bytes[0] == kEot || bytes[0] == kCl) {
    if (frame.size() != 1) return wrong(out, "nothing follows EOT and CL");
    out.fields.emplace_back("meaning",
                            "ends the transmission; each station waits for a new request");
    return out;
  }
  if (!LinkWalk(out, frame, settings_.model).explain(direction)) return out;
  out.format = ends_with_cr_lf ? 4 : 1;
  if (ends_with_cr_lf) out.fields.emplace_back("end", "CR LF: format 4");
  return out;
}

}  // namespace fxagent::fx
