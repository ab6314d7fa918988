#include "tests/sim/mc.h"

#include <algorithm>

namespace fxsim {
namespace {

constexpr std::uint8_t kRequest3E = 0x50;
constexpr std::uint8_t kRequest4E = 0x54;
constexpr std::uint8_t kAnswer = 0x80;  // added to the request's first byte
constexpr std::size_t kMaxLength = 8192;
constexpr std::size_t kRouteSize = 5;
constexpr std::uint16_t kUsualRefusal = 0x4013;  // of the nak fault: wrong state of the CPU
constexpr std::uint16_t kStrangeEndCode = 0xC059;

/// Offsets of the fields of a frame. In ASCII every byte is two characters.
struct Layout {
  std::size_t unit;    // characters per byte
  std::size_t serial;  // 0: none
  std::size_t route;
  std::size_t length;
  std::size_t content;  // start of the part counted by the length
};

Layout layout_of(bool four_e, McCode code) {
  const std::size_t unit = code == McCode::ascii ? 2 : 1;
  const std::size_t route = four_e ? 6 : 2;
  return {unit, four_e ? 2 * unit : 0, route * unit, (route + kRouteSize) * unit,
          (route + kRouteSize + 2) * unit};
}

/// Returns the first byte of the subheader, or 0 if there is none.
std::uint8_t first_of(ByteView frame, McCode code) {
  McReader in(frame, code);
  const auto first = in.number(1);
  return in.number(1) != 0 || in.unreadable() || in.cut_off() ? std::uint8_t{0}
                                                              : static_cast<std::uint8_t>(first);
}

Layout layout_of(ByteView frame, McCode code) {
  return layout_of((first_of(frame, code) & ~unsigned{kAnswer}) == kRequest4E, code);
}

std::uint32_t number_at(ByteView frame, std::size_t at, unsigned size, McCode code) {
  McReader in(frame.subspan(std::min(at, frame.size())), code);
  return in.number(size);
}

/// Overwrites a number in `frame`. Does nothing if the frame is too short: two flaws can cut a
/// reply.
void put_number(Bytes& frame, std::size_t at, std::uint32_t value, unsigned size, McCode code) {
  Bytes field;
  append_mc(field, code, value, size);
  if (at + field.size() > frame.size()) return;
  std::ranges::copy(field, frame.begin() + static_cast<std::ptrdiff_t>(at));
}

McRoute route_of(ByteView frame, McCode code) {
  const auto layout = layout_of(frame, code);
  McReader in(frame.subspan(layout.route), code);
  McRoute route;
  route.network = in.number(1);
  route.pc = in.number(1);
  route.module_io = in.number(2);
  route.module_station = in.number(1);
  if (route.module_io == 0x3E0) route.module_io = 0x3FF;  // addresses CPU No. 1
  return route;
}

/// Bytes that do not begin a request, or an impossible length, make the rest of a connection
/// unreadable. That is why a PLC set to the other code stays silent.
class EthernetFramer final : public Framer {
 public:
  explicit EthernetFramer(McCode code) : code_(code) {}

  void take(std::uint8_t byte, TimePoint when, std::vector<Frame>& out) override {
    if (lost_) {
      add_stray(byte, when, out);
      return;
    }
    frame_.push_back(byte);
    const std::size_t subheader = code_ == McCode::ascii ? 4 : 2;
    if (frame_.size() < subheader) return;
    const auto first = first_of(frame_, code_);
    lost_ = first != kRequest3E && first != kRequest4E;
    if (lost_) {
      finish(false, when, out);
      return;
    }
    const auto layout = layout_of(frame_, code_);
    if (frame_.size() < layout.content) return;
    McReader in(ByteView(frame_).subspan(layout.length), code_);
    const auto length = in.number(2);
    lost_ = in.unreadable() || length > kMaxLength;
    if (lost_ || frame_.size() >= layout.content + length) finish(!lost_, when, out);
  }

 private:
  McCode code_;
};

/// Builds the answer to `request` from an end code and the data after it.
Bytes answer_to(ByteView request, McCode code, std::uint16_t end_code, ByteView data) {
  const auto layout = layout_of(request, code);
  Bytes answer;
  append_mc(answer, code, first_of(request, code) | unsigned{kAnswer}, 1);
  const auto header = request.subspan(layout.unit, layout.length - layout.unit);
  answer.insert(answer.end(), header.begin(), header.end());
  append_mc(answer, code, static_cast<std::uint32_t>(2 * layout.unit + data.size()), 2);
  append_mc(answer, code, end_code, 2);
  answer.insert(answer.end(), data.begin(), data.end());
  return answer;
}

/// Returns the route and command that a refusal repeats; zeros if the request was too short for
/// one.
Bytes error_information(ByteView request, McCode code, const McRequest& command) {
  const auto layout = layout_of(request, code);
  const auto route = request.subspan(layout.route, kRouteSize * layout.unit);
  Bytes data(route.begin(), route.end());
  append_mc(data, code, command.command, 2);
  append_mc(data, code, command.subcommand, 2);
  return data;
}

class McEthernet final : public Personality {
 public:
  McEthernet(Protocol protocol, McSettings settings)
      : protocol_(protocol), settings_(std::move(settings)) {
    settings_.cpu.serial = false;
    settings_.cpu.module = protocol == Protocol::mc_4e;
  }

  Protocol protocol() const override { return protocol_; }
  std::unique_ptr<Framer> make_framer() const override {
    return std::make_unique<EthernetFramer>(settings_.code);
  }

  bool hears(const Frame& frame) const override {
    const auto route = route_of(frame.bytes, settings_.code);
    if (route == settings_.route) return true;
    return settings_.refuses_foreign &&
           std::ranges::find(settings_.neighbours, route) == settings_.neighbours.end();
  }

  RequestKind kind(const Frame& frame) const override {
    return frame.whole ? mc_request_kind(request_of(frame)) : RequestKind::malformed;
  }

  std::string command(const Frame& frame) const override {
    return frame.whole ? mc_command_name(request_of(frame)) : std::string();
  }

  Ruling execute(const Frame& frame, Plc& plc) const override {
    if (!frame.whole) return {.verdict = Verdict::silent, .why = "no frame"};
    const bool four_e = first_of(frame.bytes, settings_.code) == kRequest4E;
    if (four_e && settings_.family == Family::q_l && !settings_.cpu.module)
      return {.verdict = Verdict::silent, .why = "no 4E at this port"};
    const auto request = request_of(frame);
    McOutcome outcome{.refusal = McRefusal::route};
    if (route_of(frame.bytes, settings_.code) == settings_.route)
      outcome = carry_out_mc(request, settings_.code, settings_.cpu, plc);
    auto ruling = mc_ruling(outcome, request);
    ruling.reply = outcome.refusal == McRefusal::none
                       ? answer_to(frame.bytes, settings_.code, 0, outcome.data)
                       : refusal(frame, end_code(outcome.refusal));
    return ruling;
  }

  Bytes refusal(const Frame& frame, std::optional<std::uint16_t> code) const override {
    const auto information = error_information(frame.bytes, settings_.code, request_of(frame));
    return answer_to(frame.bytes, settings_.code, code.value_or(kUsualRefusal), information);
  }

  void spoil(Bytes& reply, Flaw flaw) const override {
    const auto code = settings_.code;
    const auto layout = layout_of(reply, code);
    const auto length = number_at(reply, layout.length, 2, code);
    const auto word = static_cast<std::uint32_t>(2 * layout.unit);
    const auto set_length = [&](std::uint32_t value) {
      put_number(reply, layout.length, value, 2, code);
    };
    switch (flaw) {
      case Flaw::sender: {
        const auto pc_at = layout.route + layout.unit;
        put_number(reply, pc_at, number_at(reply, pc_at, 1, code) + 1, 1, code);
        break;
      }
      case Flaw::transaction:
        if (layout.serial != 0)
          put_number(reply, layout.serial, number_at(reply, layout.serial, 2, code) - 1, 2, code);
        break;
      case Flaw::length:
        set_length(0xFFFF);
        break;
      case Flaw::length_short:
        set_length(length - word);
        break;
      case Flaw::length_long:
        set_length(length + word);
        break;
      case Flaw::longer:
        append_mc(reply, code, 0x1234, 2);
        set_length(length + word);
        break;
      case Flaw::shorter:
        if (length <= word) break;
        reply.resize(reply.size() - std::min<std::size_t>(word, length - word));
        set_length(static_cast<std::uint32_t>(reply.size() - layout.content));
        break;
      case Flaw::end_code:
        put_number(reply, layout.content, kStrangeEndCode, 2, code);
        break;
      case Flaw::header:
        put_number(reply, 0, number_at(reply, 0, 1, code) ^ unsigned{kRequest3E ^ kRequest4E}, 1,
                   code);
        break;
      case Flaw::sum:
        break;
    }
  }

 private:
  McRequest request_of(const Frame& frame) const {
    const auto layout = layout_of(frame.bytes, settings_.code);
    const auto content = ByteView(frame.bytes).subspan(layout.content);
    const auto timer = std::min(content.size(), 2 * layout.unit);
    return read_mc_request(content.subspan(timer), settings_.code, settings_.family);
  }

  std::uint16_t end_code(McRefusal refusal) const {
    const bool iq_f = settings_.family == Family::iq_f;
    const bool q_l_module = settings_.family == Family::q_l && settings_.cpu.module;
    switch (refusal) {
      case McRefusal::command:
        return 0xC059;
      case McRefusal::long_codes:
        return 0xC061;
      case McRefusal::length:
        return settings_.code == McCode::ascii ? 0xC058 : 0xC061;
      case McRefusal::characters:
        return 0xC050;
      case McRefusal::words:
        return iq_f ? 0xC052 : 0xC051;
      case McRefusal::bits:
        return iq_f ? 0xC051 : 0xC052;
      case McRefusal::random_bits:
        return 0xC053;
      case McRefusal::random_words:
        return q_l_module ? 0x4080 : 0xC054;
      case McRefusal::beyond:
        return settings_.family == Family::iq_r ? 0x4031 : 0xC056;
      case McRefusal::device:
        return 0xC05B;
      case McRefusal::unit:
        return 0xC05C;
      case McRefusal::way:
        return 0x4030;
      case McRefusal::bit_value:
        return 0xC060;
      case McRefusal::write_in_run:
        return 0x0055;
      case McRefusal::state:
        return 0x4013;
      case McRefusal::route:
        return iq_f ? 0xC05F : 0x4A00;
      default:
        return 0;
    }
  }

  Protocol protocol_;
  McSettings settings_;
};

}  // namespace

std::string mc_command_name(const McRequest& request) {
  Bytes digits;
  append_mc(digits, McCode::ascii, request.command, 2);
  digits.push_back('/');
  append_mc(digits, McCode::ascii, request.subcommand, 2);
  return std::string(as_text(digits));
}

Ruling mc_ruling(const McOutcome& outcome, const McRequest& request) {
  if (outcome.refusal != McRefusal::none)
    return {.verdict = Verdict::nak, .why = std::string(refusal_text(outcome.refusal))};
  const bool reads = mc_request_kind(request) == RequestKind::read || !outcome.data.empty();
  return {.verdict = reads ? Verdict::data : Verdict::ack,
          .device = outcome.device,
          .count = outcome.count,
          .values = outcome.values,
          .points = outcome.points};
}

std::unique_ptr<Personality> make_mc_ethernet(Protocol protocol, McSettings settings) {
  return std::make_unique<McEthernet>(protocol, std::move(settings));
}

}  // namespace fxsim
