// Explains one frame of 3E, 4E, 3C or 4C for `fxagent decode` and the line trace.
#include <algorithm>
#include <string>
#include <string_view>

#include "protocol/frame_walk.h"
#include "protocol/mc/body.h"
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

Explanation& check_direction(Explanation& out, std::optional<Direction> asked) {
  if (!asked || *asked == out.direction) return out;
  return wrong(out,
               out.direction == Direction::request ? "this is a request" : "this is an answer");
}

// ---- Ethernet -----------------------------------------------------------------------------------

/// Shows which station refused which command, if the answer contains that.
void show_error_information(Explanation& out, Code code, ByteView rest) {
  const std::size_t whole = wire_size(code, 9);
  if (rest.size() < whole) {
    if (!rest.empty()) field(out, "part of the error information", to_hex(rest));
    return;
  }
  const auto number = [&](std::size_t at) { return number_at(code, rest, at, 2).value_or(0); };
  field(out, "refused by", to_string(route_in(code, rest.first(wire_size(code, 5)))));
  field(out, "refused command", hex_text(number(5), 4) + ", subcommand " + hex_text(number(7), 4));
  if (rest.size() > whole) field(out, "more", to_hex(rest.subspan(whole)));
}

Explanation explain_ethernet(bool numbered, Model model, ByteView bytes,
                             std::optional<Direction> direction) {
  Explanation out = begin_explanation(direction);
  // A frame in ASCII code begins with four characters of its subheader.
  const bool in_ascii = bytes.size() >= 4 && is_hex(bytes.first(4));
  const Code code = in_ascii ? Code::ascii : Code::binary;
  const EthernetFrame frame = ethernet_frame(numbered, code, bytes, 0);
  if (frame.state == EthernetFrame::State::incomplete)
    return wrong(out, "the frame is shorter than its header says");
  if (frame.state == EthernetFrame::State::wrong) return wrong(out, frame.error);
  if (frame.end != bytes.size())
    return wrong(out, std::to_string(bytes.size() - frame.end) + " bytes follow the frame");
  field(out, "frame",
        std::string(numbered ? "4E" : "3E") + (in_ascii ? " in ASCII code" : " in binary code"));
  if (numbered) field(out, "serial number", hex_text(frame.serial, 4));
  show_route(out, frame.route);
  const auto first = number_at(code, frame.content, 0, 2);
  if (!first) return wrong(out, "what follows the length is not hex digits");
  const ByteView rest = frame.content.subspan(wire_size(code, 2));
  if (frame.is_request) {
    field(out, "monitoring timer",
          *first == 0 ? "for ever" : std::to_string(*first * kTimerStepMs) + " ms");
    explain_request(model, code, rest, out);
  } else if (*first != 0) {
    explain_refusal(model, static_cast<std::uint16_t>(*first), out);
    show_error_information(out, code, rest);
  } else {
    field(out, "end code", "0000, done");
    explain_data(code, rest, out);
  }
  return check_direction(out, direction);
}

// ---- serial -------------------------------------------------------------------------------------

class SerialExplainer final {
 public:
  SerialExplainer(bool is_4c, Model model, ByteView bytes, std::optional<Direction> direction)
      : is_4c_(is_4c),
        model_(model),
        bytes_(bytes),
        direction_(direction),
        out_(begin_explanation(direction)) {}

  Explanation run() {
    if (bytes_.size() >= 2 && bytes_[0] == kDle && bytes_[1] == kStx)
      binary();
    else
      ascii();
    return check_direction(out_, direction_);
  }

 private:
  std::string text(std::size_t at, std::size_t size) const {
    return as_text(bytes_.subspan(at, size));
  }
  void fault(std::string error) { wrong(out_, std::move(error)); }
  /// Judges the two characters at `at`, the sum of `summed`.
  void judge(std::size_t at, ByteView summed) {
    field(out_, "sum", text(at, 2));
    judge_sum(out_, text(at, 2), byte_sum(summed));
  }

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
    const std::size_t route = wire_size(code, 2);
    const ByteView way = head.subspan(route, wire_size(code, is_4c ? 5 : 2));
    if (code == Code::ascii && (!is_hex(head.first(route)) || !is_hex(way)))
      return fault("the route is not hex digits"), false;
    frame_field_ = out_.fields.size();
    out_.format = static_cast<std::uint32_t>(format.front() - '0');
    field(out_, "frame", std::string(is_4c ? "4C" : "3C") + " in format " + std::string(format));
    field(out_, "station", std::to_string(*number_at(code, head, 1, 1)));
    show_route(out_, route_in(code, way));
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
    if (behind == 2) judge(frame.end, content);
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
    const bool says_q =
        end > head + 10 && first == kStx && text(head, end - head).find('Q') != std::string::npos;
    format_ = has_tail ? "4" : has_block ? "2" : says_q ? "3" : "1";
    if (has_block) field(out_, "block", text(1, 2));
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
    const bool has_sum =
        may_have_sum && text(end - 2, 2) == hex_text(byte_sum(bytes_.subspan(1, end - 3)), 2);
    Explanation whole = explained(end);
    if (!has_sum && (whole.ok || !may_have_sum || !explained(end - 2).ok)) {
      out_ = std::move(whole);
      return;
    }
    out_ = explained(end - 2);
    judge(end - 2, bytes_.subspan(1, end - 3));
  }

  /// Explains STX to ETX: data in formats 1, 2 and 4; anything in format 3.
  void framed(std::size_t begin, std::size_t end) {
    const ByteView rest = bytes_.subspan(begin, end - begin);
    const auto found = std::find(rest.begin(), rest.end(), kEtx);
    if (found == rest.end()) return fault("no ETX after the data");
    const auto size = static_cast<std::size_t>(found - rest.begin());
    const std::size_t etx = begin + size;
    const std::size_t behind = end - etx - 1;
    if (behind != 0 && behind != 2) return fault("two characters of sum, or none, follow ETX");
    const ByteView content = rest.first(size);
    const std::string said = text(begin, std::min<std::size_t>(size, 4));
    if (said == "QNAK") {
      refused(content.subspan(4));
    } else if (said == "QACK") {
      explain_data(Code::ascii, content.subspan(4), out_);
    } else {
      content_of_format_3_or_1(content);
    }
    if (behind == 2) judge(etx + 1, bytes_.subspan(1, etx));
  }

  void content_of_format_3_or_1(ByteView content) {
    Explanation asks = out_;
    explain_request(model_, Code::ascii, content, asks);
    Explanation answers = out_;
    explain_data(Code::ascii, content, answers);
    const auto command = content.size() >= 4 ? number_at(Code::ascii, content, 0, 2) : std::nullopt;
    const bool is_known = command && is_known_command(*command) && asks.ok;
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

Explanation Mc::explain(ByteView frame, std::optional<Direction> direction) const {
  if (is_serial(settings_.frame))
    return SerialExplainer(settings_.frame == Frame::c4, settings_.model, frame, direction).run();
  return explain_ethernet(settings_.frame == Frame::e4, settings_.model, frame, direction);
}

}  // namespace fxagent::mc
