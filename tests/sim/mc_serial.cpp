#include "tests/sim/mc.h"

#include <algorithm>

namespace fxsim {
namespace {

constexpr std::uint8_t kStx = 0x02;
constexpr std::uint8_t kEtx = 0x03;
constexpr std::uint8_t kEnq = 0x05;
constexpr std::uint8_t kAck = 0x06;
constexpr std::uint8_t kDle = 0x10;
constexpr std::uint8_t kNak = 0x15;
constexpr std::uint8_t kCr = 0x0D;
constexpr std::uint8_t kLf = 0x0A;
constexpr std::uint32_t kFrame3C = 0xF9;
constexpr std::uint32_t kFrame4C = 0xF8;
constexpr std::size_t kSumSize = 2;
constexpr std::size_t kBinaryRouteSize = 8;
constexpr std::size_t kMaxFrame = 20'000;
constexpr std::chrono::seconds kHalfFrameLife{1};
constexpr std::uint16_t kUsualRefusal = 0x7167;
constexpr std::uint16_t kStrangeEndCode = 0x7E40;

/// The part of a frame between its control codes and its sum.
struct Content {
  Bytes text;  // block number, route and message; in format 5 the part counted by the length
  bool sum_is_right = true;
  bool closed = true;  // format 4: LF after CR; format 5: the length matches the text
};

struct Station {
  std::uint32_t frame = 0;
  std::uint32_t station = 0;
  McRoute route{};
  std::size_t message_at = 0;  // offset in the text
  std::size_t route_at = 0;
};

/// Parses the route at the start of the text. Returns nullopt if there is none.
std::optional<Station> station_of(ByteView text, unsigned format) {
  Station found;
  found.route_at = format == 2 ? 2 : 0;
  if (text.size() < found.route_at) return std::nullopt;
  McReader in(text.subspan(found.route_at), format == 5 ? McCode::binary : McCode::ascii);
  found.frame = in.number(1);
  found.station = in.number(1);
  found.route.network = in.number(1);
  found.route.pc = in.number(1);
  if (found.frame == kFrame4C) {
    found.route.module_io = in.number(2);
    found.route.module_station = in.number(1);
  } else if (found.frame != kFrame3C || format == 5) {
    return std::nullopt;
  }
  in.number(1);  // the requesting station's own number, if several masters share the line
  if (in.cut_off() || in.unreadable()) return std::nullopt;
  if (found.route.module_io == 0x3E0) found.route.module_io = 0x3FF;
  found.message_at = text.size() - in.left();
  return found;
}

void append_sum(Bytes& out, ByteView of) { append_hex(out, sum_of(of)); }

bool ends_with_sum(ByteView text, ByteView sum) {
  Bytes right;
  append_sum(right, text);
  return std::ranges::equal(right, sum);
}

/// Puts `text` of format 5 between DLE STX and DLE ETX and appends the sum.
Bytes wrapped_binary(ByteView text, std::uint32_t length, bool sum_check) {
  Bytes plain;
  append_mc(plain, McCode::binary, length, 2);
  plain.insert(plain.end(), text.begin(), text.end());
  Bytes frame{kDle, kStx};
  for (const auto byte : plain) {
    if (byte == kDle) frame.push_back(kDle);
    frame.push_back(byte);
  }
  frame.insert(frame.end(), {kDle, kEtx});
  if (sum_check) append_sum(frame, plain);
  return frame;
}

/// Puts `text` after `control`; appends ETX and a sum if data or format 3 require them.
Bytes wrapped_text(std::uint8_t control, ByteView text, bool etx, bool sum, bool crlf) {
  Bytes frame{control};
  frame.insert(frame.end(), text.begin(), text.end());
  if (etx) frame.push_back(kEtx);
  if (sum) append_sum(frame, Bytes(frame.begin() + 1, frame.end()));
  if (crlf) frame.insert(frame.end(), {kCr, kLf});
  return frame;
}

/// Extracts the content of a whole frame of SerialFramer.
Content content_of(ByteView frame, const McSettings& settings) {
  Content content;
  const std::size_t sum = settings.sum_check ? kSumSize : 0;
  if (settings.format == 5) {
    const auto given = frame.last(sum);
    Bytes plain;
    for (std::size_t i = 2; i + 2 + sum < frame.size(); ++i) {
      if (frame[i] == kDle) ++i;  // skips the first of two
      plain.push_back(frame[i]);
    }
    content.sum_is_right = sum == 0 || ends_with_sum(plain, given);
    McReader in(plain, McCode::binary);
    content.closed = in.number(2) == in.left() && !in.cut_off();
    const auto text = in.raw(in.left());
    content.text.assign(text.begin(), text.end());
    return content;
  }
  auto text = frame.subspan(1);
  if (settings.format == 4) {
    content.closed = text.back() == kLf;
    text = text.first(text.size() - 2);
  }
  if (sum != 0) {
    const auto size = text.size() - std::min(text.size(), sum);
    content.sum_is_right = ends_with_sum(text.first(size), text.subspan(size));
    text = text.first(size);
  }
  if (settings.format == 3) text = text.first(text.size() - 1);  // ETX
  content.text.assign(text.begin(), text.end());
  return content;
}

McRequest request_of(const Content& content, const McSettings& settings) {
  const auto station = station_of(content.text, settings.format);
  const auto at = station ? station->message_at : content.text.size();
  return read_mc_request(ByteView(content.text).subspan(at),
                         settings.format == 5 ? McCode::binary : McCode::ascii, settings.family);
}

class SerialFramer final : public Framer {
 public:
  explicit SerialFramer(const McSettings& settings) : settings_(settings) {}

  void take(std::uint8_t byte, TimePoint when, std::vector<Frame>& out) override {
    if (when - last_ > kHalfFrameLife) give_up(out);
    last_ = when;
    if (frame_.empty()) {
      after_dle_ = false;
      text_ends_at_ = 0;
    }
    settings_.format == 5 ? take_binary(byte, out) : take_text(byte, out);
    if (!frame_.empty() && is_whole()) {
      finish(true, when, out);
    } else if (frame_.size() >= kMaxFrame) {
      give_up(out);
    }
  }

 private:
  std::size_t sum_size() const { return settings_.sum_check ? kSumSize : 0; }

  void take_text(std::uint8_t byte, std::vector<Frame>& out) {
    const auto begins = settings_.format == 3 ? kStx : kEnq;
    if (byte == begins) give_up(out);
    if (frame_.empty() && byte != begins) {
      add_stray(byte, last_, out);
      return;
    }
    frame_.push_back(byte);
  }

  void take_binary(std::uint8_t byte, std::vector<Frame>& out) {
    if (text_ends_at_ != 0) {  // the sum
      frame_.push_back(byte);
      return;
    }
    if (!after_dle_) {
      if (frame_.empty() && byte != kDle) {
        add_stray(byte, last_, out);
        return;
      }
      frame_.push_back(byte);
      after_dle_ = byte == kDle;
      return;
    }
    after_dle_ = false;
    if (byte == kStx) {  // always begins a frame
      frame_.pop_back();
      give_up(out);
      frame_ = {kDle, kStx};
    } else if (frame_.size() == 1 && byte == kDle) {
      add_stray(byte, last_, out);  // the other may still begin a frame
      after_dle_ = true;
    } else if (frame_.size() == 1 || (byte != kDle && byte != kEtx)) {
      frame_.push_back(byte);
      give_up(out);
    } else {
      frame_.push_back(byte);
      if (byte == kEtx) text_ends_at_ = frame_.size();
    }
  }

  bool is_whole() const {
    switch (settings_.format) {
      case 5:
        return text_ends_at_ != 0 && frame_.size() == text_ends_at_ + sum_size();
      case 4:
        return frame_.size() > 2 && frame_[frame_.size() - 2] == kCr;
      case 3:
        return frame_.size() > 1 + sum_size() && frame_[frame_.size() - 1 - sum_size()] == kEtx;
      default:
        return is_as_long_as_its_command();
    }
  }

  /// Formats 1 and 2 have no end mark: the command determines the end.
  bool is_as_long_as_its_command() const {
    const auto text = ByteView(frame_).subspan(1);
    const auto station = station_of(text, settings_.format);
    if (!station) return false;
    const auto message = text.subspan(station->message_at);
    // Leaves out the sum, so that its characters do not count as missing data.
    const auto body = message.first(message.size() - std::min(message.size(), sum_size()));
    const auto request = read_mc_request(body, McCode::ascii, settings_.family);
    return request.shape != McRequest::Shape::cut_off &&
           request.used + sum_size() == message.size();
  }

  McSettings settings_;
  bool after_dle_ = false;
  std::size_t text_ends_at_ = 0;  // format 5: position after DLE ETX
};

class McSerial final : public Personality {
 public:
  McSerial(Protocol protocol, McSettings settings)
      : protocol_(protocol), settings_(std::move(settings)) {
    settings_.cpu.serial = true;
    settings_.cpu.module = true;
  }

  Protocol protocol() const override { return protocol_; }
  std::unique_ptr<Framer> make_framer() const override {
    return std::make_unique<SerialFramer>(settings_);
  }

  bool hears(const Frame& frame) const override {
    const auto station = station_of(content_of(frame.bytes, settings_).text, settings_.format);
    return station && station->station == settings_.station &&
           (settings_.refuses_foreign || station->route == settings_.route);
  }

  RequestKind kind(const Frame& frame) const override {
    if (!frame.whole) return RequestKind::malformed;
    return mc_request_kind(request_of(content_of(frame.bytes, settings_), settings_));
  }

  std::string command(const Frame& frame) const override {
    if (!frame.whole) return {};
    return mc_command_name(request_of(content_of(frame.bytes, settings_), settings_));
  }

  Ruling execute(const Frame& frame, Plc& plc) const override {
    if (!frame.whole) return {.verdict = Verdict::silent, .why = "no frame"};
    const auto content = content_of(frame.bytes, settings_);
    const auto station = station_of(content.text, settings_.format);
    const auto request = request_of(content, settings_);
    McOutcome outcome;
    if (!content.sum_is_right) {
      outcome.refusal = McRefusal::sum;
    } else if (!content.closed) {
      outcome.refusal = settings_.format == 5 ? McRefusal::length : McRefusal::header;
    } else if (!station || station->route != settings_.route) {
      outcome.refusal = McRefusal::route;
    } else {
      outcome = carry_out_mc(request, code(), settings_.cpu, plc);
    }
    auto ruling = mc_ruling(outcome, request);
    ruling.reply = outcome.refusal == McRefusal::none ? answer(frame, outcome.data)
                                                      : refusal(frame, end_code(outcome.refusal));
    return ruling;
  }

  Bytes refusal(const Frame& frame, std::optional<std::uint16_t> code) const override {
    auto text = heading(frame);
    const auto end_code = code.value_or(kUsualRefusal);
    if (settings_.format == 5) {
      text.insert(text.end(), {0xFF, 0xFF});
      append_mc(text, McCode::binary, end_code, 2);
      return wrapped_binary(text, static_cast<std::uint32_t>(text.size()), settings_.sum_check);
    }
    const bool three = settings_.format == 3;
    if (three) text.insert(text.end(), {'Q', 'N', 'A', 'K'});
    append_mc(text, McCode::ascii, end_code, 2);
    return wrapped_text(three ? kStx : kNak, text, three, false, settings_.format == 4);
  }

  void spoil(Bytes& reply, Flaw flaw) const override {
    const bool binary = settings_.format == 5;
    const std::size_t tail = settings_.format == 4 ? 2 : 0;
    const auto etx = std::find(reply.rbegin(), reply.rend(), kEtx);
    const auto behind_etx = static_cast<std::size_t>(etx - reply.rbegin());
    const bool has_etx = etx != reply.rend() && (binary || reply.front() == kStx);
    const bool has_sum = has_etx && behind_etx == tail + kSumSize;
    if (flaw == Flaw::sum) {
      // A frame without a sum gets another first byte.
      auto& last = has_sum ? reply[reply.size() - tail - 1] : reply.front();
      last = static_cast<std::uint8_t>(last == '0' ? '1' : last == kAck ? kAck + 1 : '0');
      return;
    }

    Bytes text;
    if (binary) {
      auto settings = settings_;
      settings.sum_check = has_sum;
      text = content_of(reply, settings).text;
    } else {
      const auto cut = has_etx ? behind_etx + 1 : tail;
      text.assign(reply.begin() + 1, reply.end() - static_cast<std::ptrdiff_t>(cut));
    }
    const auto station = station_of(text, settings_.format);
    if (!station) return;
    auto length_off = std::int64_t{0};
    const std::size_t word = binary ? 2 : 4;
    const auto change = [&](std::size_t at, auto make) {
      McReader in(ByteView(text).subspan(at), code());
      Bytes field;
      append_mc(field, code(), make(in.number(1)), 1);
      std::ranges::copy(field, text.begin() + static_cast<std::ptrdiff_t>(at));
    };
    switch (flaw) {
      case Flaw::sender:
        change(station->route_at + (binary ? 1 : 2), [](std::uint32_t n) { return n + 1; });
        break;
      case Flaw::header:
        change(station->route_at, [](std::uint32_t n) { return n ^ (kFrame3C ^ kFrame4C); });
        break;
      case Flaw::longer:
        append_mc(text, code(), 0x1234, 2);
        break;
      case Flaw::shorter:
        text.resize(text.size() - std::min(word, text.size() - station->message_at));
        break;
      case Flaw::length:
        length_off = 0xFFFF - static_cast<std::int64_t>(text.size());
        break;
      case Flaw::length_short:
        length_off = -2;
        break;
      case Flaw::length_long:
        length_off = 2;
        break;
      case Flaw::end_code:
        if (binary && text.size() >= kBinaryRouteSize + 4) {
          const auto at = static_cast<std::ptrdiff_t>(kBinaryRouteSize + 2);
          Bytes field;
          append_mc(field, McCode::binary, kStrangeEndCode, 2);
          std::ranges::copy(field, text.begin() + at);
        }
        break;
      default:
        break;
    }
    if (binary) {
      const auto length =
          static_cast<std::uint32_t>(static_cast<std::int64_t>(text.size()) + length_off);
      reply = wrapped_binary(text, length, has_sum);
    } else {
      reply = wrapped_text(reply.front(), text, has_etx, has_sum, tail != 0);
    }
  }

 private:
  McCode code() const { return settings_.format == 5 ? McCode::binary : McCode::ascii; }

  /// Returns what every answer repeats: the request's text up to its message.
  Bytes heading(const Frame& frame) const {
    auto text = content_of(frame.bytes, settings_).text;
    const auto station = station_of(text, settings_.format);
    text.resize(station ? station->message_at : 0);
    return text;
  }

  /// Returns an acknowledgement or data. An answer without data has a sum only in format 5.
  Bytes answer(const Frame& frame, ByteView data) const {
    auto text = heading(frame);
    const bool has_data = !data.empty();
    if (settings_.format == 5) {
      text.insert(text.end(), {0xFF, 0xFF, 0x00, 0x00});
    } else if (settings_.format == 3) {
      text.insert(text.end(), {'Q', 'A', 'C', 'K'});
    }
    text.insert(text.end(), data.begin(), data.end());
    if (settings_.format == 5)
      return wrapped_binary(text, static_cast<std::uint32_t>(text.size()), settings_.sum_check);
    const bool etx = has_data || settings_.format == 3;
    return wrapped_text(etx ? kStx : kAck, text, etx, has_data && settings_.sum_check,
                        settings_.format == 4);
  }

  std::uint16_t end_code(McRefusal refusal) const {
    switch (refusal) {
      case McRefusal::command:
      case McRefusal::long_codes:
        return 0x7E40;
      case McRefusal::random_words:
      case McRefusal::random_bits:
        return 0x7E41;
      case McRefusal::words:
      case McRefusal::bits:
        return 0x7E42;
      case McRefusal::device:
      case McRefusal::unit:
      case McRefusal::way:
        return 0x7E43;
      case McRefusal::beyond:
        return 0x7E4F;
      case McRefusal::characters:
        return 0x7F20;
      case McRefusal::length:
      case McRefusal::bit_value:
        return 0x7F22;
      case McRefusal::header:
        return 0x7F23;
      case McRefusal::sum:
        return 0x7F24;
      case McRefusal::write_in_run:
        return 0x7167;
      case McRefusal::state:
        return 0x4013;
      case McRefusal::route:
        return settings_.family == Family::iq_f ? 0x7F21 : 0x4A00;
      case McRefusal::none:
        break;
    }
    return 0;
  }

  Protocol protocol_;
  McSettings settings_;
};

}  // namespace

std::unique_ptr<Personality> make_mc_serial(Protocol protocol, McSettings settings) {
  return std::make_unique<McSerial>(protocol, std::move(settings));
}

}  // namespace fxsim
