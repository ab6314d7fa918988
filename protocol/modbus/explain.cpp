// Explains one Modbus frame for `fxagent decode` and the line trace.
#include <algorithm>
#include <string>

#include "protocol/modbus/modbus.h"

namespace fxagent::modbus {
namespace {

std::uint32_t number_at(ByteView pdu, std::size_t at) {
  return static_cast<std::uint32_t>(pdu[at] << 8 | pdu[at + 1]);
}

/// A function of the specification: its name and its table.
struct Known {
  Function function;
  std::string_view name;
  Space space;
};
constexpr Known kKnown[] = {
    {Function::read_coils, "read coils", Space::coil},
    {Function::read_discrete_inputs, "read discrete inputs", Space::discrete_input},
    {Function::read_holding_registers, "read holding registers", Space::holding_register},
    {Function::read_input_registers, "read input registers", Space::input_register},
    {Function::write_coil, "write a coil", Space::coil},
    {Function::write_register, "write a holding register", Space::holding_register},
    {Function::write_coils, "write coils", Space::coil},
    {Function::write_registers, "write holding registers", Space::holding_register},
    {Function::mask_write, "mask write of a holding register", Space::holding_register},
    {Function::read_write, "read and write holding registers", Space::holding_register},
};

/// A function that the agent never sends. Its data are shown unchanged.
struct Other {
  std::uint8_t function;
  std::string_view name;
  bool asks_alone;  ///< only its answer has data
};
constexpr Other kOthers[] = {
    {0x07, "read exception status", true},   {0x08, "diagnostics", false},
    {0x0B, "get comm event counter", true},  {0x0C, "get comm event log", true},
    {0x11, "report server id", true},        {0x14, "read file record", false},
    {0x15, "write file record", false},      {0x18, "read FIFO queue", false},
    {0x2B, "encapsulated interface", false},
};

const Other* other(std::uint8_t function) {
  const auto found = std::find_if(std::begin(kOthers), std::end(kOthers),
                                  [&](const Other& o) { return o.function == function; });
  return found == std::end(kOthers) ? nullptr : found;
}

const Known* known(std::uint8_t function) {
  const auto found = std::find_if(std::begin(kKnown), std::end(kKnown),
                                  [&](const Known& k) { return code(k.function) == function; });
  return found == std::end(kKnown) ? nullptr : found;
}

Explanation& wrong(Explanation& out, std::string error) {
  out.ok = false;
  if (!out.error) out.error = std::move(error);
  return out;
}

/// Fills in the content of a PDU in one direction.
class Explainer final {
 public:
  Explainer(ByteView pdu, Direction direction, Explanation& out)
      : pdu_(pdu), out_(out), direction_(direction) {
    out_.direction = direction;
    out_.ok = true;
    out_.operation = "other";
  }

  void run() {
    if (pdu_.empty()) return fault("no function code");
    const std::uint8_t function = pdu_[0] & static_cast<std::uint8_t>(~kException);
    out_.command = hex_text(function, 2);
    const Known* what = known(function);
    const Other* unspoken = other(function);
    field("function", hex_text(function, 2) + ", " +
                          std::string(what       ? what->name
                                      : unspoken ? unspoken->name
                                                 : "not known to this program"));
    if (function == 0) return fault("00 is no function");
    if ((pdu_[0] & kException) != 0) return exception();
    if (what == nullptr) return as_it_is(unspoken != nullptr && unspoken->asks_alone);
    if (direction_ == Direction::request)
      request(*what);
    else
      reply(*what);
  }

 private:
  void fault(std::string error) { wrong(out_, std::move(error)); }
  void field(std::string name, std::string text) {
    out_.fields.emplace_back(std::move(name), std::move(text));
  }
  bool has(std::size_t bytes) {
    if (pdu_.size() == bytes) return true;
    fault(std::to_string(pdu_.size()) + " bytes of function and data, " + std::to_string(bytes) +
          " belong there");
    return false;
  }

  void exception() {
    out_.operation = "nak";
    if (direction_ == Direction::request) return fault("an exception is an answer, no request");
    if (!has(2)) return;
    const auto text = exception_text(pdu_[1]);
    field("exception", hex_text(pdu_[1], 2) + ": " +
                           std::string(text.empty() ? "not in the specification" : text));
    out_.values.push_back(hex_text(pdu_[1], 2));
  }

  /// Shows data unchanged. `asks_alone`: a request has no data and an answer has some.
  void as_it_is(bool asks_alone) {
    const ByteView data = pdu_.subspan(1);
    if (!data.empty()) field("data", to_hex(data));
    if (asks_alone && data.empty() != (direction_ == Direction::request))
      fault(data.empty() ? "an answer to this function has data" : "nothing follows this function");
  }

  void place(const Known& what, std::uint32_t number, std::uint32_t count) {
    if (!out_.device) {
      out_.device = name_of(what.space, number, 0);
      out_.count = count;
    }
    field("address", hex_text(number, 4) + " = " + name_of(what.space, number, 0));
    if (number + count > kNumbers) fault("the numbers end at 65535");
  }

  void limits(std::uint32_t count, std::uint32_t most) {
    field("quantity", std::to_string(count));
    if (count == 0 || count > most)
      fault("a quantity of " + std::to_string(count) + "; 1 to " + std::to_string(most) +
            " are allowed");
  }

  void values(const Known& what, ByteView data, std::uint32_t count) {
    if (width_of(what.space) == 1) {
      for (std::uint32_t i = 0; i < count && i / 8 < data.size(); ++i)
        out_.values.emplace_back((data[i / 8] >> (i % 8) & 1) != 0 ? "1" : "0");
    } else {
      for (std::size_t i = 0; i + 1 < data.size(); i += 2)
        out_.values.push_back(hex_text(number_at(data, i), 4));
    }
    field("data", to_hex(data));
  }

  void request(const Known& what) {
    switch (what.function) {
      case Function::write_coil:
      case Function::write_register:
      case Function::mask_write:
        return single(what);
      case Function::write_coils:
      case Function::write_registers:
        out_.operation = "write";
        if (pdu_.size() < 6) return fault("the frame ends before its data");
        return several(what, number_at(pdu_, 1), number_at(pdu_, 3), pdu_.subspan(5));
      case Function::read_write:
        out_.operation = "write";
        if (pdu_.size() < 10) return fault("the frame ends before its data");
        field("read address", hex_text(number_at(pdu_, 1), 4));
        field("read quantity", std::to_string(number_at(pdu_, 3)));
        return several(what, number_at(pdu_, 5), number_at(pdu_, 7), pdu_.subspan(9));
      default:
        out_.operation = "read";
        if (!has(5)) return;
        place(what, number_at(pdu_, 1), number_at(pdu_, 3));
        return limits(number_at(pdu_, 3),
                      width_of(what.space) == 1 ? kMaxReadBits : kMaxReadRegisters);
    }
  }

  /// Explains functions whose answer repeats the request.
  void single(const Known& what) {
    out_.operation = "write";
    if (!has(what.function == Function::mask_write ? 7 : 5)) return;
    const std::uint32_t value = number_at(pdu_, 3);
    place(what, number_at(pdu_, 1), 1);
    if (what.function == Function::mask_write) {
      field("AND mask", hex_text(value, 4));
      field("OR mask", hex_text(number_at(pdu_, 5), 4));
      return;
    }
    if (what.function == Function::write_register) {
      out_.values.push_back(hex_text(value, 4));
      return field("value", hex_text(value, 4));
    }
    if (value != 0xFF00 && value != 0) return fault("a coil is written by FF00 or 0000");
    out_.operation = value != 0 ? "force_on" : "force_off";
    out_.values.emplace_back(value != 0 ? "1" : "0");
    field("value", value != 0 ? "FF00, on" : "0000, off");
  }

  /// `counted` begins with the byte count.
  void several(const Known& what, std::uint32_t number, std::uint32_t count, ByteView counted) {
    const bool bits = width_of(what.space) == 1;
    place(what, number, count);
    limits(count, bits                                    ? kMaxWriteBits
                  : what.function == Function::read_write ? 121
                                                          : kMaxWriteRegisters);
    const std::uint32_t bytes = bits ? (count + 7) / 8 : count * 2;
    if (counted[0] != bytes || counted.size() != bytes + std::size_t{1})
      return fault("byte count " + std::to_string(counted[0]) + " and " +
                   std::to_string(counted.size() - 1) + " bytes, where the quantity takes " +
                   std::to_string(bytes));
    values(what, counted.subspan(1), count);
  }

  void reply(const Known& what) {
    switch (what.function) {
      case Function::write_coil:
      case Function::write_register:
      case Function::mask_write:
        single(what);
        out_.operation = "ack";
        return;
      case Function::write_coils:
      case Function::write_registers:
        out_.operation = "ack";
        if (!has(5)) return;
        place(what, number_at(pdu_, 1), number_at(pdu_, 3));
        return field("quantity", std::to_string(number_at(pdu_, 3)));
      default:
        break;
    }
    out_.operation = "data";
    if (pdu_.size() < 2 || pdu_[1] != pdu_.size() - 2)
      return fault("the byte count does not fit the frame");
    const bool bits = width_of(what.space) == 1;
    if (!bits && pdu_[1] % 2 != 0) return fault("an odd count of bytes cannot be registers");
    field("byte count", std::to_string(pdu_[1]));
    out_.count = bits ? pdu_[1] * 8U : pdu_[1] / 2U;
    values(what, pdu_.subspan(2), *out_.count);
  }

  ByteView pdu_;
  Explanation& out_;
  Direction direction_;
};

/// Removes the frame from its PDU. Returns false, with the reason in `out`, if there is no PDU.
bool unwrap(Framing framing, ByteView bytes, Explanation& out, std::uint8_t& unit, Bytes& pdu) {
  if (framing == Framing::rtu && bytes.size() < 4)
    return wrong(out, "too short for unit, function and CRC"), false;
  const Frame frame = framing == Framing::rtu     ? rtu_frame(bytes, 0, bytes.size() - 3)
                      : framing == Framing::ascii ? ascii_frame(bytes, 0)
                                                  : tcp_frame(bytes, 0, 2);
  if (frame.state == Frame::State::incomplete)
    return wrong(out, framing == Framing::ascii ? "no frame from ':' to CR LF"
                                                : "the frame is shorter than its header says"),
           false;
  if (frame.state == Frame::State::wrong) wrong(out, frame.error);
  if (frame.pdu.empty()) return false;
  if (frame.end != bytes.size())
    return wrong(out, std::to_string(bytes.size() - frame.end) + " bytes follow the frame"), false;
  unit = frame.unit;
  pdu = frame.pdu;
  if (framing == Framing::tcp) {
    out.fields.emplace_back("transaction", hex_text(frame.transaction, 4));
  } else {
    out.checksum_given = frame.sum_given;
    out.checksum_computed = frame.sum_computed;
  }
  return true;
}

/// For a PDU that fits neither direction. The request of a read has five bytes and its answer
/// hardly ever does. Any other PDU except an exception is assumed to be a request.
bool is_like_a_request(ByteView pdu) {
  const Known* what = known(pdu[0]);
  const bool reads =
      what != nullptr && code(what->function) <= code(Function::read_input_registers);
  return (pdu[0] & kException) == 0 && (!reads || pdu.size() == 5);
}

}  // namespace

Explanation explain_frame(Framing framing, ByteView frame, std::optional<Direction> direction) {
  Explanation shell;
  shell.operation = "other";
  shell.direction = direction.value_or(Direction::request);
  std::uint8_t unit = 0;
  Bytes pdu;
  if (!unwrap(framing, frame, shell, unit, pdu)) return shell;
  shell.fields.emplace_back("unit", std::to_string(unit));
  bool fits = false;
  const auto explained = [&](Direction way) {
    Explanation out = shell;
    out.error.reset();
    Explainer(pdu, way, out).run();
    fits = out.ok;
    if (out.checksum_given)
      out.fields.emplace_back(framing == Framing::rtu ? "CRC" : "LRC", *out.checksum_given);
    if (shell.error) {  // the frame is wrong, whatever its content
      out.ok = false;
      out.error = shell.error;
    }
    return out;
  };
  if (direction) return explained(*direction);
  Explanation request = explained(Direction::request);
  const bool may_ask = fits;
  const Explanation reply = explained(Direction::reply);
  const bool may_answer = fits;
  request.ambiguous = may_ask && may_answer;
  return may_ask || (!may_answer && is_like_a_request(pdu)) ? request : reply;
}

}  // namespace fxagent::modbus
