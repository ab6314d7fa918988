// Explains one frame of 3E, 4E, 3C or 4C for `fxagent decode` and the line trace.
#include <algorithm>
#include <string>
#include <string_view>

#include "protocol/mc/body.h"
#include "protocol/mc/explain_message.h"
#include "protocol/mc/mc.h"
#include "protocol/mc/message.h"

namespace fxagent::mc {
namespace {

void field(Explanation& out, std::string name, std::string text) {
  out.fields.emplace_back(std::move(name), std::move(text));
}

void show_route(Explanation& out, const Route& route) {
  field(out, "network", std::to_string(route.network));
  field(out, "PC", hex_text(route.pc, 2));
  field(out, "module I/O", hex_text(route.module_io, 4));
  field(out, "module station", hex_text(route.module_station, 2));
}

void check_direction(Explanation& out, std::optional<Direction> asked) {
  if (asked && *asked != out.direction)
    note_fault(out,
               out.direction == Direction::request ? "this is a request" : "this is an answer");
}

// ---- Ethernet -----------------------------------------------------------------------------------

/// True if `bytes` begin with the four characters of a subheader in ASCII code.
bool begins_in_ascii(ByteView bytes) {
  return bytes.size() >= 4 && std::all_of(bytes.begin(), bytes.begin() + 4,
                                          [](std::uint8_t c) { return hex_digit(c) >= 0; });
}

/// Shows which station refused which command, if the answer contains that.
void show_error_information(Explanation& out, Code code, ByteView rest) {
  const std::size_t whole = wire_size(code, 9);
  if (rest.size() < whole) {
    if (!rest.empty()) field(out, "part of the error information", to_hex(rest));
    return;
  }
  const auto number = [&](std::size_t at, std::size_t bytes) {
    return number_at(code, rest, wire_size(code, at), bytes).value_or(0);
  };
  Route route;
  route.network = static_cast<std::uint8_t>(number(0, 1));
  route.pc = static_cast<std::uint8_t>(number(1, 1));
  route.module_io = static_cast<std::uint16_t>(number(2, 2));
  route.module_station = static_cast<std::uint8_t>(number(4, 1));
  field(out, "refused by", to_string(route));
  field(out, "refused command",
        hex_text(number(5, 2), 4) + ", subcommand " + hex_text(number(7, 2), 4));
  if (rest.size() > whole) field(out, "more", to_hex(rest.subspan(whole)));
}

Explanation explain_ethernet(bool numbered, Model model, ByteView bytes,
                             std::optional<Direction> direction) {
  Explanation out;
  out.operation = "other";
  out.direction = direction.value_or(Direction::request);
  const Code code = begins_in_ascii(bytes) ? Code::ascii : Code::binary;
  const EthernetFrame frame = ethernet_frame(numbered, code, bytes, 0);
  if (frame.state == EthernetFrame::State::incomplete)
    return note_fault(out, "the frame is shorter than its header says"), out;
  if (frame.state == EthernetFrame::State::wrong) return note_fault(out, frame.error), out;
  if (frame.end != bytes.size())
    return note_fault(out, std::to_string(bytes.size() - frame.end) + " bytes follow the frame"),
           out;
  field(out, "frame",
        std::string(numbered ? "4E" : "3E") +
            (code == Code::ascii ? " in ASCII code" : " in binary code"));
  if (numbered) field(out, "serial number", hex_text(frame.serial, 4));
  show_route(out, frame.route);
  const auto first = number_at(code, frame.content, 0, 2);
  if (!first) return note_fault(out, "what follows the length is not hex digits"), out;
  const ByteView rest = frame.content.subspan(wire_size(code, 2));
  if (frame.is_request) {
    field(out, "monitoring timer", *first == 0 ? "for ever" : std::to_string(*first * 250) + " ms");
    explain_request(model, code, rest, out);
  } else if (*first != 0) {
    explain_refusal(model, static_cast<std::uint16_t>(*first), out);
    show_error_information(out, code, rest);
  } else {
    field(out, "end code", "0000, done");
    explain_data(code, rest, out);
  }
  check_direction(out, direction);
  return out;
}

// ---- serial -------------------------------------------------------------------------------------

void judge_sum(Explanation& out, std::string_view given, std::uint8_t computed) {
  out.checksum_given = std::string(given);
  out.checksum_computed = hex_text(computed, 2);
  field(out, "sum", std::string(given));
  std::string digits(given);
  for (char& c : digits)
    if (c >= 'a' && c <= 'f') c = static_cast<char>(c - 'a' + 'A');
  if (digits != *out.checksum_computed)
    note_fault(out,
               "sum " + std::string(given) + " given, " + *out.checksum_computed + " computed");
}

class SerialExplainer final {
 public:
  SerialExplainer(bool is_4c, Model model, ByteView bytes, std::optional<Direction> direction)
      : is_4c_(is_4c), model_(model), bytes_(bytes), direction_(direction) {
    out_.operation = "other";
    out_.direction = direction.value_or(Direction::request);
  }

  Explanation run() {
    if (bytes_.size() >= 2 && bytes_[0] == kDle && bytes_[1] == kStx)
      binary();
    else
      ascii();
    check_direction(out_, direction_);
    return std::move(out_);
  }

 private:
  std::string_view text(std::size_t at, std::size_t size) const {
    return {reinterpret_cast<const char*>(bytes_.data()) + at, size};
  }
  void fault(std::string error) { note_fault(out_, std::move(error)); }

  /// Shows frame id and route, which begin at the start of `head`. False if they are invalid.
  bool show_header(Code code, ByteView head, std::string_view format) {
    const auto id = head.size() >= wire_size(code, 1) ? number_at(code, head, 0, 1) : std::nullopt;
    if (id != 0xF9U && id != 0xF8U) return fault("no frame id F9 (3C) or F8 (4C)"), false;
    const bool is_4c = *id == 0xF8;
    if (is_4c != is_4c_)
      return fault(std::string("a ") + (is_4c ? "4C" : "3C") + " frame: the protocol is mc-" +
                   (is_4c ? "4c" : "3c")),
             false;
    header_ = wire_size(code, is_4c ? 8 : 5);
    if (head.size() < header_) return fault("the frame ends in its route"), false;
    std::size_t at = 1;
    const auto next = [&](std::size_t size) {
      const auto value = number_at(code, head, wire_size(code, at), size);
      if (!value) fault("the route is not hex digits");
      at += size;
      return value.value_or(0);
    };
    frame_field_ = out_.fields.size();
    out_.format = static_cast<std::uint32_t>(format.front() - '0');
    field(out_, "frame", std::string(is_4c ? "4C" : "3C") + " in format " + std::string(format));
    field(out_, "station", std::to_string(next(1)));
    Route route;
    route.network = static_cast<std::uint8_t>(next(1));
    route.pc = static_cast<std::uint8_t>(next(1));
    if (is_4c) {
      route.module_io = static_cast<std::uint16_t>(next(2));
      route.module_station = static_cast<std::uint8_t>(next(1));
    }
    if (out_.error) return false;
    show_route(out_, route);
    return true;
  }

  void binary() {
    const Undoubled frame = undoubled(bytes_, 0);
    if (frame.state != Undoubled::State::good)
      return fault("no frame from 10 02 to 10 03, with every other 10 twice");
    const std::size_t behind = bytes_.size() - frame.end;
    if (behind != 0 && behind != 2) return fault("two characters of sum, or none, follow 10 03");
    if (frame.content.size() < 2) return fault("too short for its length");
    const ByteView content = frame.content;
    const std::size_t length = *number_at(Code::binary, content, 0, 2);
    if (!show_header(Code::binary, content.subspan(2), "5")) return;
    const ByteView body = content.subspan(2 + header_);
    if (body.size() >= 4 && body[0] == 0xFF && body[1] == 0xFF) {
      const auto code = static_cast<std::uint16_t>(*number_at(Code::binary, body, 2, 2));
      if (code != 0)
        explain_refusal(model_, code, out_);
      else
        explain_data(Code::binary, body.subspan(4), out_);
    } else {
      explain_request(model_, Code::binary, body, out_);
    }
    if (length != content.size() - 2)
      fault("length " + std::to_string(length) + " given, " + std::to_string(content.size() - 2) +
            " bytes follow it");
    if (behind == 2) judge_sum(out_, text(frame.end, 2), serial_sum(content));
  }

  void ascii() {
    if (bytes_.size() < 3) return fault("too short for a frame");
    const std::uint8_t first = bytes_[0];
    if (first != kEnq && first != kStx && first != kAck && first != kNak)
      return fault("a frame begins with ENQ, STX, ACK, NAK or 10 02");
    std::size_t end = bytes_.size();
    const bool has_tail = bytes_[end - 2] == kCr && bytes_[end - 1] == kLf;
    if (has_tail) end -= 2;
    // Format 2 has a block number before its id. No station is F8 or F9.
    const auto id_at = [&](std::size_t at) {
      return end >= at + 2 && (text(at, 2) == "F9" || text(at, 2) == "F8");
    };
    const bool has_block = !has_tail && id_at(3);
    const std::size_t head = has_block ? 3 : 1;
    const bool says_q = end > head + 10 && first == kStx &&
                        text(head, end - head).find('Q') != std::string_view::npos;
    format_ = has_tail ? "4" : has_block ? "2" : says_q ? "3" : "1";
    if (has_block) field(out_, "block", std::string(text(1, 2)));
    if (!show_header(Code::ascii, bytes_.subspan(head, end - head), format_)) return;
    const std::size_t begin = head + header_;
    if (first == kEnq) return request(begin, end);
    if (first == kStx) return framed(begin, end);
    if (first == kNak) return refused(bytes_.subspan(begin, end - begin));
    explain_data(Code::ascii, {}, out_);
    if (begin != end) fault("more than an acknowledgement");
  }

  void refused(ByteView digits) {
    const auto code = digits.size() == 4 ? number_at(Code::ascii, digits, 0, 2) : std::nullopt;
    if (!code) return fault("a refusal has an end code of four hex digits");
    explain_refusal(model_, static_cast<std::uint16_t>(*code), out_);
  }

  /// The last two characters are the sum if they match it. Otherwise the needs of the request
  /// decide.
  void request(std::size_t begin, std::size_t end) {
    const auto explained = [&](std::size_t until) {
      Explanation out = out_;
      explain_request(model_, Code::ascii, bytes_.subspan(begin, until - begin), out);
      return out;
    };
    const bool may_have_sum = end >= begin + 2;
    const std::uint8_t sum =
        may_have_sum ? serial_sum(bytes_.subspan(1, end - 3)) : std::uint8_t{0};
    const bool has_sum = may_have_sum && text(end - 2, 2) == hex_text(sum, 2);
    Explanation whole = explained(end);
    if (!has_sum && (whole.ok || !may_have_sum || !explained(end - 2).ok)) {
      out_ = std::move(whole);
      return;
    }
    out_ = explained(end - 2);
    judge_sum(out_, text(end - 2, 2), sum);
  }

  /// Explains STX to ETX: data in formats 1, 2 and 4; anything in format 3.
  void framed(std::size_t begin, std::size_t end) {
    const ByteView rest = bytes_.subspan(begin, end - begin);
    const auto found = std::find(rest.begin(), rest.end(), kEtx);
    if (found == rest.end()) return fault("no ETX behind the data");
    const auto size = static_cast<std::size_t>(found - rest.begin());
    const std::size_t etx = begin + size;
    const std::size_t behind = end - etx - 1;
    if (behind != 0 && behind != 2) return fault("two characters of sum, or none, follow ETX");
    const ByteView content = rest.first(size);
    const std::string_view said = text(begin, std::min<std::size_t>(size, 4));
    if (said == "QNAK") {
      refused(content.subspan(4));
    } else if (said == "QACK") {
      explain_data(Code::ascii, content.subspan(4), out_);
    } else {
      content_of_format_3_or_1(content);
    }
    if (behind == 2) judge_sum(out_, text(etx + 1, 2), serial_sum(bytes_.subspan(1, etx)));
  }

  void content_of_format_3_or_1(ByteView content) {
    Explanation asks = out_;
    explain_request(model_, Code::ascii, content, asks);
    Explanation answers = out_;
    explain_data(Code::ascii, content, answers);
    const auto command = content.size() >= 4 ? number_at(Code::ascii, content, 0, 2) : std::nullopt;
    const bool is_known =
        command && !command_name(static_cast<std::uint16_t>(*command)).empty() && asks.ok;
    const bool is_request = direction_ ? *direction_ == Direction::request : is_known;
    asks.ambiguous = !direction_;
    asks.fields[frame_field_].second.back() = '3';
    asks.format = 3;
    out_ = std::move(is_request ? asks : answers);
  }

  bool is_4c_;
  Model model_;
  ByteView bytes_;
  std::optional<Direction> direction_;
  Explanation out_;
  std::size_t header_ = 0;
  std::size_t frame_field_ = 0;  ///< the last character of this field is the format
  std::string format_;
};

}  // namespace

Explanation explain_frame(Frame frame, Model model, ByteView bytes,
                          std::optional<Direction> direction) {
  if (!is_serial(frame)) return explain_ethernet(frame == Frame::e4, model, bytes, direction);
  return SerialExplainer(frame == Frame::c4, model, bytes, direction).run();
}

}  // namespace fxagent::mc
