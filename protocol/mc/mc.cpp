#include "protocol/mc/mc.h"

#include <algorithm>

#include "protocol/mc/body.h"
#include "protocol/mc/message.h"

namespace fxagent::mc {
namespace {

// Sizes in bytes of binary code.
constexpr std::size_t kErrorRoute = 5;  // before the command in the error information
constexpr std::size_t kCommand = 2;
constexpr std::size_t kErrorInformation = kErrorRoute + 2 * kCommand;
// No answer is longer, and the bus receives no more.
constexpr std::size_t kMostSearched = 8192;

// Default of timer 1 of C24 modules (SH-080007, chapter 6.2).
constexpr std::chrono::milliseconds kResponseMonitoring{5000};
constexpr std::uint32_t kRunState = 203;  // SD203: low half byte is the state of the CPU
constexpr std::uint8_t kStepRun = 1;      // 0 RUN, 1 STEP-RUN, 2 STOP, 3 PAUSE
constexpr std::uint32_t kAlwaysOn = 400;  // SM400 exists in all of these series

Reply refusal(std::uint16_t code, Series series) {
  return {.kind = Reply::Kind::nak, .device_code = code, .text = end_code_text(code, series)};
}

/// Error: bad_request if frames cannot name all of a span.
Result<void> check_named(const Dialect& dialect, const Span& span) {
  if (span.space >= kSpaces || span.bits == 0) return {};
  const auto space = static_cast<Space>(span.space);
  const DeviceKind& kind = kind_of(space);
  const auto why_not = [&](std::uint32_t number) {
    return why_not_named(dialect, space, number, has_long_codes(dialect, 0));
  };
  const std::uint32_t last = kind.first_number + (span.end_bit() - 1) / kind.bits;
  const bool is_doubtful = has_doubtful_digits(dialect, space);
  auto why = why_not(kind.first_number + span.first_bit / kind.bits);
  // A word from X0 on names no further X.
  if (why.empty() && !(is_doubtful && last < kCertainWords))
    why = why_not(is_doubtful ? kCertainWords : last);
  if (!why.empty()) return refuse(std::move(why));
  return {};
}

}  // namespace

// ---- addresses and ranges ----------------------------------------------------------------------

Result<Address> Mc::parse_address(std::string_view text, std::optional<DataType> type) const {
  auto address = mc::parse_address(settings_.model, text, type);
  if (!address) return address;
  if (const auto named = check_named(settings_, address->span); !named) return fail(named);
  return address;
}

Result<void> Mc::check_range(const Span& span) const {
  return mc::check_range(settings_.model, span).and_then([&] {
    return check_named(settings_, span);
  });
}

Result<void> Mc::check_write(const Span& span) const {
  return mc::check_write(settings_.model, span).and_then([&] {
    return check_named(settings_, span);
  });
}

// ---- frames ------------------------------------------------------------------------------------

Result<Bytes> Mc::encode(const Request& request, std::uint16_t tag) const {
  const auto message = encode_message(settings_, request);
  if (!message) return fail(message);
  if (is_serial(settings_.frame))
    return serial_request(settings_, static_cast<std::uint8_t>(tag), *message);
  return ethernet_request(settings_, tag, *message);
}

namespace {

Result<Reply> data_reply(const Dialect& dialect, const Request& request, ByteView data) {
  const std::size_t expected = answer_size(dialect, request);
  if (is_identify(request) && data.size() != expected) {
    // Another vendor's device: use the name if there is one, otherwise report no model. The image
    // is never used as a value.
    const ByteView name = data.first(data.size() >= kTypeName ? kTypeName : 0);
    return Reply{.kind = Reply::Kind::data, .image = Bytes(name.begin(), name.end())};
  }
  if (data.size() != expected)
    return garbled(std::to_string(data.size()) + " characters of data given, " +
                   std::to_string(expected) + " expected");
  if (!brings_data(request)) return Reply{};
  auto image = decode_answer(dialect, request, data);
  if (!image) return fail(image);
  return Reply{.kind = Reply::Kind::data, .image = std::move(*image)};
}

/// Decodes the part after the length of an Ethernet frame that answers this request.
Result<Reply> reply_in(const Dialect& dialect, const Request& request, ByteView content) {
  const Code code = dialect.code;
  const std::size_t head = wire_size(code, kEndCode);
  const auto end_code = number_at(code, content, 0, kEndCode);
  if (!end_code)
    return garbled("end code " + to_hex(content.first(head)) + " is not four hex digits");
  const ByteView rest = content.subspan(head);
  if (*end_code == 0) return data_reply(dialect, request, rest);
  // The refusing station may differ from the addressed one. The refused command must not differ.
  if (rest.size() >= wire_size(code, kErrorInformation)) {
    const auto refused = number_at(code, rest, kErrorRoute, kCommand);
    const auto message = encode_message(dialect, request);
    if (!message) return fail(message);
    const auto asked = number_at(code, *message, 0, kCommand);
    if (refused != asked)
      return garbled(end_code_text(static_cast<std::uint16_t>(*end_code), dialect.series()) +
                     ", for another command: " +
                     to_hex(rest.subspan(wire_size(code, kErrorRoute), wire_size(code, kCommand))));
  }
  return refusal(static_cast<std::uint16_t>(*end_code), dialect.series());
}

Decoded decode_ethernet(const Dialect& dialect, const Request& request, std::uint16_t tag,
                        ByteView rx) {
  const bool numbered = dialect.frame == Frame::e4;
  for (std::size_t at = 0; at < rx.size();) {
    const EthernetFrame frame = ethernet_frame(numbered, dialect.code, rx, at);
    if (frame.state == EthernetFrame::State::incomplete) break;
    if (frame.state == EthernetFrame::State::wrong) return garbled(frame.error);
    const std::size_t began = at;
    at = frame.end;
    // An echo of the request, or a late answer.
    if (frame.is_request || (numbered && frame.serial != tag)) continue;
    if (frame.route != dialect.route)
      return garbled("an answer for " + to_string(frame.route) + ", where " +
                     to_string(dialect.route) + " was asked");
    auto reply = reply_in(dialect, request, frame.content);
    if (!reply) return fail(reply);
    reply->began = began;
    reply->consumed = frame.end;
    return std::move(*reply);
  }
  return std::nullopt;
}

Decoded decode_serial(const Dialect& dialect, const Request& request, std::uint16_t tag,
                      ByteView rx) {
  const std::size_t size = answer_size(dialect, request);
  Decoded found = serial_answer(dialect, static_cast<std::uint8_t>(tag), size, rx);
  if (!found) return found;
  if (!*found) {
    if (rx.size() > kMostSearched)
      return garbled(std::to_string(rx.size()) + " bytes without an answer");
    return std::nullopt;
  }
  const Reply& answer = **found;
  Result<Reply> reply =
      answer.kind == Reply::Kind::nak
          ? refusal(static_cast<std::uint16_t>(answer.device_code), dialect.series())
          : data_reply(dialect, request, answer.image);
  if (!reply) return fail(reply);
  reply->began = answer.began;
  reply->consumed = answer.consumed;
  return std::move(*reply);
}

}  // namespace

Decoded Mc::decode(const Request& request, std::uint16_t tag, ByteView rx) const {
  if (is_serial(settings_.frame)) return decode_serial(settings_, request, tag, rx);
  return decode_ethernet(settings_, request, tag, rx);
}

bool Mc::may_pass_for_answer(ByteView bytes) const {
  if (is_serial(settings_.frame)) return may_be_serial_answer(settings_, bytes);
  if (settings_.frame == Frame::e4) return !bytes.empty();
  // Subheader of an answer, compared as far as it has arrived.
  Bytes subheader;
  append_number(settings_.code, subheader, 0xD0, 1);
  append_number(settings_.code, subheader, 0, 1);
  for (std::size_t at = 0; at < bytes.size(); ++at) {
    const std::size_t size = std::min(subheader.size(), bytes.size() - at);
    const auto same = [&](std::uint8_t a, std::uint8_t b) {
      return a == b || (settings_.code == Code::ascii && hex_digit(a) == hex_digit(b));
    };
    if (std::ranges::equal(ByteView(subheader).first(size), bytes.subspan(at, size), same))
      return true;
  }
  return false;
}

LineLength Mc::line_length(const Request& request) const {
  LineLength length;
  const auto frame = encode(request, 0);
  if (!frame) return length;
  const std::size_t data = answer_size(settings_, request);
  length.request_chars = static_cast<std::uint32_t>(frame->size());
  length.reply_chars = static_cast<std::uint32_t>(is_serial(settings_.frame)
                                                      ? serial_answer_length(settings_, data)
                                                      : ethernet_answer_length(settings_, data));
  // Every byte may be a 10h, which is doubled on the wire.
  if (is_serial(settings_.frame) && settings_.code == Code::binary) {
    length.more_reply_chars = static_cast<std::uint32_t>(data);
    length.doubled_chars = static_cast<std::uint32_t>(serial_doubles(settings_, *frame, data));
  }
  return length;
}

// ---- time, recovery and refusals ----------------------------------------------------------------

std::chrono::milliseconds Mc::gives_up_after() const {
  if (!is_serial(settings_.frame)) return std::chrono::milliseconds(settings_.timer * kTimerStepMs);
  // A module waits only for other stations. Its own CPU answers at once or not at all.
  const bool is_own = settings_.route == Route{};
  return is_own ? std::chrono::milliseconds(0) : kResponseMonitoring;
}

Recovery Mc::after_silence() const {
  if (is_serial(settings_.frame)) return Recovery::drain;
  // A late answer in a 3E frame could be mistaken for the answer to the next request.
  return settings_.frame == Frame::e4 ? Recovery::none : Recovery::reconnect;
}

Recovery Mc::after_nonsense() const {
  return is_serial(settings_.frame) ? Recovery::drain : Recovery::reconnect;
}

std::optional<Request> Mc::probe(std::uint32_t number) const {
  // Two more bits add a byte in binary code.
  return Read{{id(Space::sm), kAlwaysOn, 1 + 2 * (number % kProbes)}, kBitWay};
}

std::uint32_t Mc::shorter_by(const Read& read) const {
  return read.way == kBitWay ? 2 : (read.way == kWordWay ? 16 : 32);
}

RefusalMeaning Mc::meaning_of(const Request& request, int device_code) const {
  const auto* control = std::get_if<Control>(&request);
  const bool runs_or_stops = control != nullptr && control->kind != Control::Kind::identify;
  // With this code every command is refused, so the PLC may well have this one.
  if (std::holds_alternative<Gather>(request) &&
      refuses_everything(static_cast<std::uint16_t>(device_code)))
    return RefusalMeaning::unclear;
  return meaning_of_end_code(static_cast<std::uint16_t>(device_code), brings_data(request),
                             runs_or_stops);
}

std::optional<Request> Mc::instead_of(const Request& request, int device_code) const {
  if (settings_.series() != Series::iq_r ||
      !is_unknown_command(static_cast<std::uint16_t>(device_code)))
    return std::nullopt;
  Request other = request;
  bool has_x_or_y = false;
  const auto change = [&](std::uint16_t space, std::uint8_t& way) {
    has_x_or_y |= space == id(Space::x) || space == id(Space::y);
    way |= kPlainCodes;
  };
  if (auto* write = std::get_if<Write>(&other)) change(write->span.space, write->way);
  if (auto* force = std::get_if<Force>(&other)) change(force->space, force->way);
  if (auto* scatter = std::get_if<Scatter>(&other))
    for (Write& part : scatter->parts) change(part.span.space, part.way);
  // A PLC without the codes of iQ-R may be an FX5 with the wrong `model`: there Y20 is another
  // output.
  if (has_x_or_y || other == request || !encode_message(settings_, other)) return std::nullopt;
  return other;
}

// ---- model, RUN and STOP -----------------------------------------------------------------------

std::string_view model_of_type(std::string_view name) {
  const auto digit = [&](std::size_t at) {
    return at < name.size() && name[at] >= '0' && name[at] <= '9';
  };
  for (const std::string_view fx5 : {"FX5UJ", "FX5U", "FX5S"})
    if (name.starts_with(fx5)) return fx5;
  if (name.starts_with('R') && digit(1)) return "iQ-R";
  if (name.starts_with('Q') && (digit(1) || name.starts_with("QS"))) return "Q";
  if (!name.starts_with('L') || !digit(1)) return {};
  // L04HCPU to L32HCPU are iQ-L. Their ports work as those of an iQ-R.
  std::size_t at = 1;
  while (digit(at)) ++at;
  return name.substr(at).starts_with("HCPU") ? "iQ-R" : "L";
}

std::optional<std::string> Mc::model_from(const std::vector<Bytes>& images) const {
  if (images.empty() || images[0].size() < kTypeName) return std::nullopt;
  const std::string name(images[0].begin(), images[0].begin() + kTypeName);
  const std::string_view model = model_of_type(name);
  return model.empty() ? std::nullopt : std::optional(std::string(model));
}

// SH-080483 (Q, L), SH-081264 (iQ-R) and JY997D55401 (FX5): the tables of SM and SD. An FX5 also
// has the clock of an FX3, 8013 up, which needs no request.
SpecialDevices Mc::special_devices() const {
  SpecialDevices special{.battery_low = "SM52",
                         .has_error = "SM0",
                         .error = "SD0",
                         .clock_copied = "SM213",
                         .clock_at = "SD210"};
  switch (series_of(settings_.model)) {
    case Series::q_l:
      special.clock = SpecialDevices::Clock::bcd;
      break;
    case Series::iq_r:
      special.clock = SpecialDevices::Clock::from_year;
      break;
    case Series::iq_f:
      special.clock = SpecialDevices::Clock::from_second;
      special.clock_copied = {};
      special.clock_at = "SD8013";
      break;
    default:
      break;
  }
  return special;
}

Request Mc::run_state() const { return Read{span_of(Space::sd, {kRunState, kRunState}), kWordWay}; }

std::optional<bool> Mc::run_state_from(ByteView image) const {
  if (image.empty()) return std::nullopt;
  return (image[0] & 0x0F) <= kStepRun;
}

std::string Mc::run_hint() const {
  return "the PLC's RUN/STOP switch must be at RUN: at STOP it takes the request and stays stopped";
}

}  // namespace fxagent::mc
