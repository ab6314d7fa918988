// Explains one Modbus frame for `fxagent decode` and the line trace.
#include <algorithm>
#include <string>

#include "protocol/frame_walk.h"
#include "protocol/modbus/modbus.h"

namespace fxagent::modbus {
namespace {

/// Walks a PDU after its function code.
class PduWalk final : public FrameWalk {
 public:
  /// A request has a quantity of 1 to `most`.
  PduWalk(Explanation& out, ByteView data, Space space, std::uint32_t most)
      : FrameWalk(out, NumberForm::high_first, data), space_(space), most_(most) {}

  /// Explains the fields. A PDU without data has a fixed length.
  void explain(const Fields& fields);

  void address(const Field& field) {
    number_ = number(field);
    out_.device = name_of(space_, number_, 0);
    out_.count = 1;
    show(field.name, hex_text(number_, 4) + " = " + *out_.device);
  }
  void quantity(const Field& field) {
    out_.count = number(field);
    show(field.name, std::to_string(*out_.count));
    if (number_ + *out_.count > kNumbers) {
      doubt_ = "the numbers end at 65535";
    } else if (out_.direction == Direction::request && (*out_.count == 0 || *out_.count > most_)) {
      doubt_ = "a quantity of " + std::to_string(*out_.count) + "; 1 to " + std::to_string(most_) +
               " are allowed";
    }
  }

  void value(const Field& field) {
    add_values(out_, form_, left_, field.digits);
    hex(field);
  }
  void exception(const Field& field) {
    const std::uint32_t code = number(field);
    const std::string_view text = exception_coded(static_cast<int>(code)).text;
    out_.values.push_back(hex_text(code, 2));
    show(field.name,
         out_.values.back() + ": " + std::string(text.empty() ? "not in the specification" : text));
  }
  void on_off(const Field& field) {
    const std::uint32_t value = number(field);
    if (value != 0xFF00 && value != 0) return fault("a coil is written by FF00 or 0000");
    if (out_.direction == Direction::request)
      out_.operation = value != 0 ? "force_on" : "force_off";
    out_.values.emplace_back(value != 0 ? "1" : "0");
    show(field.name, value != 0 ? "FF00, on" : "0000, off");
  }

  void nothing(const Field& field) {
    if (left() == 0) return;
    rest(field);
    fault("nothing follows this function");
  }

  /// Data to write begin with the number of their bytes.
  void data_to_write(const Field& field) {
    const std::uint32_t given = number(field);
    const std::uint32_t bytes = is_bits() ? (*out_.count + 7) / 8 : *out_.count * 2;
    if (given != bytes || left_.size() != bytes)
      return fault("byte count " + std::to_string(given) + " and " + std::to_string(left_.size()) +
                   " bytes, where the quantity takes " + std::to_string(bytes));
    values(field);
  }
  void byte_count(const Field& field) {
    if (number(field) != left_.size()) return fault("the byte count does not fit the frame");
    if (!is_bits() && left_.size() % 2 != 0)
      return fault("an odd count of bytes cannot be registers");
    show(field.name, std::to_string(left_.size()));
    out_.count = static_cast<std::uint32_t>(is_bits() ? left_.size() * 8 : left_.size() / 2);
  }
  void values(const Field& field) {
    add_values(out_, form_, left_, is_bits() ? 2 : 4, width_of(space_));
    if (out_.values.size() > *out_.count) out_.values.resize(*out_.count);
    show(field.name, to_hex(left_));
  }

 private:
  bool is_bits() const { return width_of(space_) == 1; }

  Space space_;
  std::uint32_t most_;
  std::uint32_t number_ = 0;
  std::string doubt_;  ///< an error in a number, after which the other fields are still shown
};

constexpr Field kAddress = read_by<&PduWalk::address>("address", 4);
constexpr Field kQuantity = read_by<&PduWalk::quantity>("quantity", 4);
constexpr Field kValue = read_by<&PduWalk::value>("value", 4);
constexpr Field kOnOff = read_by<&PduWalk::on_off>("value", 4);
constexpr Field kAndMask = read_by<&PduWalk::hex>("AND mask", 4);
constexpr Field kOrMask = read_by<&PduWalk::hex>("OR mask", 4);
constexpr Field kReadAddress = read_by<&PduWalk::hex>("read address", 4);
constexpr Field kReadNumber = read_by<&PduWalk::decimal>("read quantity", 4);
constexpr Field kDataToWrite = read_by<&PduWalk::data_to_write>("data", 2);
constexpr Field kByteCount = read_by<&PduWalk::byte_count>("byte count", 2);
constexpr Field kValues = read_by<&PduWalk::values>("data");
constexpr Field kRest = read_by<&PduWalk::rest>("data");
constexpr Field kSomeRest = read_by<&PduWalk::rest>("data", 2);
constexpr Field kNoRest = read_by<&PduWalk::nothing>("data");

/// A request or an answer after its function code.
struct Part {
  std::string_view operation;
  Fields fields;
};
constexpr Part kRead = {"read", {kAddress, kQuantity}};
constexpr Part kData = {"data", {kByteCount, kValues}};
constexpr Part kWrite = {"write", {kAddress, kQuantity, kDataToWrite}};
constexpr Part kWritten = {"ack", {kAddress, kQuantity}};
constexpr Part kCoilWrite = {"write", {kAddress, kOnOff}};
constexpr Part kCoilWritten = {"ack", {kAddress, kOnOff}};
constexpr Part kRegisterWrite = {"write", {kAddress, kValue}};
constexpr Part kRegisterWritten = {"ack", {kAddress, kValue}};
constexpr Part kMaskWrite = {"write", {kAddress, kAndMask, kOrMask}};
constexpr Part kMaskWritten = {"ack", {kAddress, kAndMask, kOrMask}};
constexpr Part kReadWrite = {"write",
                             {kReadAddress, kReadNumber, kAddress, kQuantity, kDataToWrite}};
constexpr Part kRefusal = {"nak", {read_by<&PduWalk::exception>("exception", 2)}};
// Of functions whose data is not explained.
constexpr Part kAnything = {"other", {kRest}};
constexpr Part kSomething = {"other", {kSomeRest}};
constexpr Part kNothing = {"other", {kNoRest}};

/// A function of the specification. `most` is the largest quantity of its request.
struct Known {
  std::uint8_t code;
  std::string_view name;
  Part request;
  Part reply;
  Space space = Space::coil;
  std::uint32_t most = 0;
};
constexpr Space kHolding = Space::holding_register;
constexpr Known kKnown[] = {
    {0x01, "read coils", kRead, kData, Space::coil, kMaxReadBits},
    {0x02, "read discrete inputs", kRead, kData, Space::discrete_input, kMaxReadBits},
    {0x03, "read holding registers", kRead, kData, kHolding, kMaxReadRegisters},
    {0x04, "read input registers", kRead, kData, Space::input_register, kMaxReadRegisters},
    {0x05, "write a coil", kCoilWrite, kCoilWritten, Space::coil},
    {0x06, "write a holding register", kRegisterWrite, kRegisterWritten, kHolding},
    {0x0F, "write coils", kWrite, kWritten, Space::coil, kMaxWriteBits},
    {0x10, "write holding registers", kWrite, kWritten, kHolding, kMaxWriteRegisters},
    {0x16, "mask write of a holding register", kMaskWrite, kMaskWritten, kHolding},
    {0x17, "read and write holding registers", kReadWrite, kData, kHolding, 121},
    {0x07, "read exception status", kNothing, kSomething},
    {0x08, "diagnostics", kAnything, kAnything},
    {0x0B, "get comm event counter", kNothing, kSomething},
    {0x0C, "get comm event log", kNothing, kSomething},
    {0x11, "report server id", kNothing, kSomething},
    {0x14, "read file record", kAnything, kAnything},
    {0x15, "write file record", kAnything, kAnything},
    {0x18, "read FIFO queue", kAnything, kAnything},
    {0x2B, "encapsulated interface", kAnything, kAnything},
};
constexpr Known kUnknown = {0, "not known to this program", kAnything, kAnything};

const Known& known(std::uint8_t function) {
  const auto* found = std::ranges::find(kKnown, function, &Known::code);
  return found == std::end(kKnown) ? kUnknown : *found;
}

void PduWalk::explain(const Fields& fields) {
  std::size_t least = 0;
  bool has_data = false;
  for (const Field& field : fields) {
    least += field.digits;
    has_data = has_data || field.name == "data";
  }
  if (has_data ? left() < least : left() != least)
    return fault(has_data ? "the frame ends before its data"
                          : std::to_string(1 + left() / 2) + " bytes of function and data, " +
                                std::to_string(1 + least / 2) + " belong there");
  walk(fields);
  if (doubt_.empty()) return;
  out_.error.reset();
  fault(doubt_);
}

void explain_pdu(Explanation& out, ByteView pdu, Direction direction) {
  const std::uint8_t function = pdu[0] & static_cast<std::uint8_t>(~kException);
  const Known& what = known(function);
  out.command = hex_text(function, 2);
  out.fields.emplace_back("function", *out.command + ", " + std::string(what.name));
  const bool asks = direction == Direction::request;
  const bool refuses = (pdu[0] & kException) != 0;
  if (function == 0) {
    wrong(out, "00 is not a function");
    return;
  }
  const Part& part = refuses ? kRefusal : asks ? what.request : what.reply;
  out.operation = part.operation;
  if (refuses && asks)
    wrong(out, "an exception is an answer, not a request");
  else
    PduWalk(out, pdu.subspan(1), what.space, what.most).explain(part.fields);
}

/// Returns the frame in `bytes`. Without a PDU, or with an error, it is bad whatever its content.
Frame frame_in(Framing framing, ByteView bytes) {
  Frame frame;
  if (framing == Framing::rtu && bytes.size() < 4) {
    frame.error = "too short for unit, function and CRC";
    return frame;
  }
  frame = framing == Framing::rtu     ? rtu_frame(bytes, 0, bytes.size() - 3)
          : framing == Framing::ascii ? ascii_frame(bytes, 0)
                                      : tcp_frame(bytes, 0, 2);
  const bool is_incomplete = frame.state == Frame::State::incomplete;
  if (!is_incomplete && frame.end == bytes.size()) return frame;
  frame.pdu.clear();
  if (frame.error.empty())
    frame.error = !is_incomplete
                      ? std::to_string(bytes.size() - frame.end) + " bytes follow the frame"
                  : framing == Framing::ascii ? "there is no frame from ':' to CR LF"
                                              : "the frame is shorter than its header says";
  return frame;
}

/// For a PDU that fits neither direction. The request of a read has five bytes and its answer
/// hardly ever does. Any other PDU except an exception is assumed to be a request.
bool is_like_a_request(ByteView pdu) {
  const bool reads = known(pdu[0]).request.operation == "read";
  return (pdu[0] & kException) == 0 && (!reads || pdu.size() == 5);
}

}  // namespace

Explanation Modbus::explain(ByteView bytes, std::optional<Direction> direction) const {
  const Framing framing = settings_.framing;
  const Frame frame = frame_in(framing, bytes);
  Explanation shell = begin_explanation(direction);
  if (frame.pdu.empty()) return wrong(shell, frame.error);
  if (framing == Framing::tcp) {
    shell.fields.emplace_back("transaction", hex_text(frame.transaction, 4));
  } else {
    shell.checksum_given = frame.sum_given;
    shell.checksum_computed = frame.sum_computed;
  }
  shell.fields.emplace_back("unit", std::to_string(frame.unit));
  bool fits = false;
  const auto explained = [&](Direction way) {
    Explanation out = shell;
    out.direction = way;
    explain_pdu(out, frame.pdu, way);
    fits = out.ok;
    if (out.checksum_given)
      out.fields.emplace_back(framing == Framing::rtu ? "CRC" : "LRC", *out.checksum_given);
    if (!frame.error.empty()) {
      out.error.reset();
      wrong(out, frame.error);
    }
    return out;
  };
  if (direction) return explained(*direction);
  Explanation request = explained(Direction::request);
  const bool may_ask = fits;
  const Explanation reply = explained(Direction::reply);
  const bool may_answer = fits;
  request.ambiguous = may_ask && may_answer;
  return may_ask || (!may_answer && is_like_a_request(frame.pdu)) ? request : reply;
}

}  // namespace fxagent::modbus
