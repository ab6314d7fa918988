#include "protocol/mc/one_e.h"

#include <algorithm>

#include "protocol/encoding.h"
#include "protocol/mc/body.h"

namespace fxagent::mc {

using one_e::code;

namespace {

using Settings = OneE::Settings;

// Points of one frame, JY997D45801 7.4. It is unknown if an E71 accepts more.
constexpr std::uint32_t kReadBits = 256;
constexpr std::uint32_t kReadWords = 64;
constexpr std::uint32_t kReadWordsOfBits = 32;
constexpr std::uint32_t kWriteBits = 160;  // bits, or ten words
constexpr std::uint32_t kWriteWords = 64;
constexpr std::uint32_t kRandomBits = 80;
constexpr std::uint32_t kRandomWords = 10;
/// Words of a bit device begin at a multiple of this.
constexpr std::uint32_t kAlign = 16;

/// Command and end code of an answer.
constexpr std::size_t kAnswerHead = 2;

// Answer to 15, JY997D45801 7.6.3.
constexpr int kFx3u = 0xF3;
constexpr int kFx3g = 0xF4;

/// End code that is followed by an abnormal code and 00.
constexpr int kWithReason = 0x5B;

/// Reason of a refusal and its meaning for a read and for any other request.
struct Refusal {
  int code;  ///< end code, with the abnormal code above it if that matters
  RefusalMeaning for_read;
  RefusalMeaning otherwise;
  std::string_view text;
};
using Meaning = RefusalMeaning;
// JY997D45801 9.3.2. The first row that fits counts.
constexpr Refusal kRefusals[] = {
    {0x50, Meaning::final, Meaning::final, "the PLC does not have this command"},
    {0x54, Meaning::final, Meaning::final,
     "the PLC is set to ASCII and cannot read this: `code` must be the communication data code "
     "that is set in the PLC"},
    {0x55, Meaning::final, Meaning::final,
     "writing is not permitted while the PLC runs: set \"Enable online change\" in its Ethernet "
     "settings (FX3U-ENET: \"Enable Write at RUN time\")"},
    {0x56, Meaning::hole, Meaning::final, "no such device"},
    {0x57, Meaning::hole, Meaning::final, "too many points, or beyond the last device"},
    {0x58, Meaning::hole, Meaning::final,
     "no such device number, or this command cannot begin with it"},
    {0x105B, Meaning::unreachable, Meaning::final, "no PLC has this PC number (`pc`)"},
    {0x185B, Meaning::final, Meaning::final, "remote RUN or STOP is not possible"},
    {kWithReason, Meaning::unreachable, Meaning::unclear,
     "the Ethernet module cannot reach the PLC"},
    {0x60, Meaning::unreachable, Meaning::unclear,
     "the PLC gave its Ethernet module no answer within the monitoring timer"},
};
constexpr Refusal kUnlisted = {0, Meaning::final, Meaning::unclear,
                               "a reason that the manual does not list"};

const Refusal& refusal_of(int device_code) {
  const auto* found = std::ranges::find_if(kRefusals, [&](const Refusal& known) {
    return known.code == device_code || known.code == (device_code & 0xFF);
  });
  return found == std::end(kRefusals) ? kUnlisted : *found;
}

/// Returns Reply::device_code.
int device_code(int end_code, std::optional<int> abnormal_code) {
  return end_code | abnormal_code.value_or(0) << 8;
}

bool is_fx3(Model model) { return series_of(model) == Series::fx3; }

/// True for devices that the PLC of an E71 numbers, limits or builds differently: with the wrong
/// model other devices would answer without any error.
bool is_fx3_only(Space space) {
  return space == Space::x || space == Space::y || space == Space::special_m ||
         space == Space::special_d || space == Space::cn32;
}

std::uint32_t number_of(const Span& span) {
  const DeviceKind& kind = kind_of(static_cast<Space>(span.space));
  return kind.first_number + span.first_bit / kind.bits;
}

/// Number and code in binary, code and number in ASCII.
void append_device(Code data_code, Bytes& out, const Span& span) {
  const std::uint16_t device_code = kind_of(static_cast<Space>(span.space)).one_e;
  if (data_code == Code::ascii) append_number(data_code, out, device_code, 2);
  append_number(data_code, out, number_of(span), 4);
  if (data_code == Code::binary) append_number(data_code, out, device_code, 2);
}

/// Returns the bytes of data in the binary form of a successful answer.
std::size_t data_bytes(const Request& request) {
  if (const auto* read = std::get_if<Read>(&request))
    return read->way == kBitWay ? (read->span.bits + 1) / 2 : read->span.bits / 8;
  return is_identify(request) ? 2 : 0;
}

/// Names the usual mistake that an answer with this first byte shows.
std::string_view likely_mistake(Code data_code, std::uint8_t first) {
  if (first == 0xD0 || first == 0xD4 || first == 'D')
    return ": that is an answer of 3E or 4E frames";
  if (data_code == Code::binary && (first == '8' || first == '9'))
    return ": it is in ASCII; `code` must be the communication data code that is set in the PLC";
  if (data_code == Code::ascii && first >= one_e::kAnswer)
    return ": it is in binary; `code` must be the communication data code that is set in the PLC";
  return "";
}

}  // namespace

// ---- addresses and ranges ----------------------------------------------------------------------

namespace {

/// Errors: bad_request if 1E frames reach nothing of the space; unsupported if that depends on the
/// model and the model is unknown.
Result<void> check_reach(Model model, const Span& span) {
  if (span.space >= kSpaces)
    return refuse("space " + std::to_string(span.space) + " is not a device");
  const auto space = static_cast<Space>(span.space);
  const DeviceKind& kind = kind_of(space);
  // JY997D18101 9.3.2: an FX3 has no code for coils. Only an FX3 is known to have S.
  const bool coil = space == Space::tc || space == Space::cc;
  if (kind.one_e == 0 || (coil && is_fx3(model)) || (space == Space::s && !is_fx3(model)))
    return refuse(device_name(model, span) + ": 1E frames do not reach " +
                  std::string(kind.letters) + (is_fx3(model) ? " of an FX3" : " of this model"));
  if (model == Model::unknown_fx && is_fx3_only(space))
    return fail(
        ErrorCode::unsupported,
        device_name(model, span) +
            " can be accessed once the model is known: other series have other devices there");
  return {};
}

Result<void> check_reached_write(Model model, const Span& span) {
  return check_write(model, span).and_then([&] { return check_reach(model, span); });
}

/// Returns `parsed`, or an error if 1E frames never reach it, whatever the model turns out to be.
template <class T>
Result<T> reachable(Model model, Result<T> parsed, const Span& span) {
  const auto reached = check_reach(model, span);
  if (!reached && reached.error().code == ErrorCode::bad_request) return fail(reached);
  return parsed;
}

}  // namespace

Result<Address> OneE::parse_address(std::string_view text, std::optional<DataType> type) const {
  auto address = mc::parse_address(settings_.model, text, type);
  if (!address) return address;
  return reachable(settings_.model, address, address->span);
}

Result<Span> OneE::parse_range(std::string_view text) const {
  auto span = mc::parse_range(settings_.model, text);
  if (!span) return span;
  return reachable(settings_.model, span, *span);
}

Result<void> OneE::check_write(const Span& span) const {
  return check_reached_write(settings_.model, span);
}

// ---- ways to read ------------------------------------------------------------------------------

std::vector<ReadWay> OneE::read_ways(std::uint16_t space_id) const {
  const Model model = settings_.model;
  std::vector<ReadWay> ways;
  if (!check_reach(model, {space_id, 0, 1})) return ways;
  const auto space = static_cast<Space>(space_id);
  // Until the model is known, read only what the smallest FX3 has.
  const bool known = model != Model::unknown_fx;
  const auto numbers = numbers_of(known ? model : Model::fx3g, space);
  if (numbers.empty()) return ways;
  const Span all = span_of(space, numbers.front());
  const std::uint32_t width = kind_of(space).bits;
  const auto add = [&](std::uint8_t way, std::uint32_t unit, std::uint32_t points) {
    ways.push_back({.way = way,
                    .first_bit = all.first_bit,
                    .end_bit = all.end_bit(),
                    .align_bits = unit,
                    .unit_bits = unit,
                    .max_bits = points});
  };
  if (width == 1) add(kBitWay, 1, kReadBits);
  if (width == 1 && !is_contact(space)) add(kWordWay, 16, kReadWordsOfBits * 16);
  // A 32-bit counter takes two of the 64 words.
  if (width > 1) add(kWordWay, width, kReadWords * 16);
  return ways;
}

std::uint32_t OneE::max_write_bits(std::uint16_t space) const {
  if (!check_reach(settings_.model, {space, 0, 1})) return 0;
  return width_of(space) == 1 ? kWriteBits : kWriteWords * 16;
}

// ---- requests ----------------------------------------------------------------------------------

namespace {

Bytes begun(const Settings& settings, one_e::Command command) {
  Bytes out;
  out.reserve(24);  // a read
  append_number(settings.code, out, code(command), 1);
  append_number(settings.code, out, settings.route.pc, 1);
  append_number(settings.code, out, settings.timer, 2);
  return out;
}

/// Appends the number of points (256 as 00) and the fixed 00 after it.
void append_points(Code data_code, Bytes& out, std::uint32_t points) {
  append_number(data_code, out, points & 0xFF, 1);
  append_number(data_code, out, 0, 1);
}

Result<Bytes> encode_read(const Settings& settings, const std::vector<ReadWay>& ways,
                          const Read& read) {
  const Span& span = read.span;
  if (const auto reached = check_reach(settings.model, span); !reached) return fail(reached);
  const bool by_bits = read.way == kBitWay;
  const auto way = way_for(
      ways, read.way, span, [&] { return device_name(settings.model, span); },
      by_bits ? "read as bits" : "read as words");
  if (!way) return fail(way);
  Bytes out = begun(settings, by_bits ? one_e::Command::read_bits : one_e::Command::read_words);
  append_device(settings.code, out, span);
  append_points(settings.code, out, by_bits ? span.bits : span.bits / 16);
  return out;
}

/// `most` is the largest number of bits in one write.
Result<Bytes> encode_write(const Settings& settings, std::uint32_t most, const Write& write) {
  const Span& span = write.span;
  if (const auto allowed = check_reached_write(settings.model, span); !allowed)
    return fail(allowed);
  const bool bits = width_of(span.space) == 1 && !is_words(span, kAlign);
  if (const auto why = why_wrong_image(write, most); !why.empty())
    return refuse(device_name(settings.model, span) + ": " + why);
  Bytes out = begun(settings, bits ? one_e::Command::write_bits : one_e::Command::write_words);
  append_device(settings.code, out, span);
  append_points(settings.code, out, bits ? span.bits : span.bits / 16);
  if (bits)
    append_bits(settings.code, out, write.image, span.bits);
  else
    append_image(settings.code, out, write.image, 2);
  // An odd count of bits is padded with 0.
  if (bits && settings.code == Code::ascii && span.bits % 2 != 0) out.push_back('0');
  return out;
}

Result<Bytes> encode_scattered(const Settings& settings, const Scatter& scatter) {
  const auto step = item_bits(scatter, kRandomBits, kRandomWords, kAlign);
  if (!step) return fail(step);
  std::uint32_t points = 0;
  for (const Write& part : scatter.parts) {
    if (const auto allowed = check_reached_write(settings.model, part.span); !allowed)
      return fail(allowed);
    if (const auto why = why_wrong_image(part); !why.empty())
      return refuse(device_name(settings.model, part.span) + ": " + why);
    points += part.span.bits / *step;
  }
  Bytes out =
      begun(settings, *step == 1 ? one_e::Command::random_bits : one_e::Command::random_words);
  append_points(settings.code, out, points);
  for (const Write& part : scatter.parts)
    for (std::uint32_t done = 0; done < part.span.bits; done += *step) {
      append_device(settings.code, out, {part.span.space, part.span.first_bit + done, *step});
      const Bytes value = extract_bits(part.image, done, *step);
      append_image(settings.code, out, value, value.size());
    }
  return out;
}

Result<Bytes> encode_control(const Settings& settings, const Control& control) {
  if (control.kind == Control::Kind::reset)
    return fail(ErrorCode::unsupported, "1E frames have no reset of the line");
  // SH-080008 18.2 lists the commands of an E71: 13 to 15 are not among them.
  if (!is_fx3(settings.model))
    return fail(ErrorCode::unsupported, "1E frames have no RUN, STOP and model for " +
                                            std::string(to_string(settings.model)) + ": use mc-3e");
  const one_e::Command command = control.kind == Control::Kind::run    ? one_e::Command::run
                                 : control.kind == Control::Kind::stop ? one_e::Command::stop
                                                                       : one_e::Command::model;
  return begun(settings, command);
}

}  // namespace

Result<Bytes> OneE::encode(const Request& request, std::uint16_t /*tag*/) const {
  if (const auto* read = std::get_if<Read>(&request))
    return encode_read(settings_, read_ways(read->span.space), *read);
  if (const auto* write = std::get_if<Write>(&request))
    return encode_write(settings_, max_write_bits(write->span.space), *write);
  if (const auto* scatter = std::get_if<Scatter>(&request))
    return encode_scattered(settings_, *scatter);
  if (const auto* control = std::get_if<Control>(&request))
    return encode_control(settings_, *control);
  if (const auto* force = std::get_if<Force>(&request))
    return encode_write(settings_, max_write_bits(force->space), write_of(*force));
  return fail(ErrorCode::unsupported, "1E frames have neither an enquiry nor scattered reads");
}

// ---- answers -----------------------------------------------------------------------------------

namespace one_e {

std::optional<Bytes> from_ascii(ByteView frame) {
  if (!is_hex(frame)) return std::nullopt;
  return *bytes_in(frame);
}

std::string_view model_coded(int model_code) {
  if (model_code == kFx3u) return to_string(Model::fx3u);
  return model_code == kFx3g ? to_string(Model::fx3g) : std::string_view{};
}

std::string refusal(int end_code, std::optional<int> abnormal_code) {
  std::string text = hex_text(static_cast<std::uint32_t>(end_code), 2);
  if (abnormal_code) text += " " + hex_text(static_cast<std::uint32_t>(*abnormal_code), 2);
  return text.append(": ").append(refusal_of(device_code(end_code, abnormal_code)).text);
}

}  // namespace one_e

namespace {

/// Decodes the answer that begins at the front of `frame`. nullopt: more bytes are needed.
Decoded reply_in(Code data_code, const Request& request, std::uint8_t command, ByteView frame) {
  const std::string_view mistake = likely_mistake(data_code, frame[0]);
  std::optional<Bytes> binary = Bytes(frame.begin(), frame.end());
  if (data_code == Code::ascii) binary = one_e::from_ascii(frame);
  if (!binary) return garbled("an answer that is not all hex digits" + std::string(mistake));
  const Bytes& bytes = *binary;
  if (bytes.empty()) return std::nullopt;
  if (bytes[0] != (command | one_e::kAnswer))
    return garbled("an answer that begins with " + hex_text(bytes[0], 2) + " where " +
                   hex_text(command | one_e::kAnswer, 2) + " is due" + std::string(mistake));
  if (bytes.size() < kAnswerHead) return std::nullopt;

  Reply reply;
  const std::uint8_t end_code = bytes[1];
  std::size_t length = kAnswerHead;
  if (end_code == 0) {
    length += data_bytes(request);
  } else if (end_code == kWithReason || bytes.size() > length) {
    length += 2;  // the abnormal code; an E71 may send it with other end codes, too
  }
  if (bytes.size() < length) return std::nullopt;
  if (frame.size() > wire_size(data_code, length))
    return garbled(std::to_string(frame.size()) + " bytes where " +
                   std::to_string(wire_size(data_code, length)) + " were due");
  reply.consumed = frame.size();
  if (end_code != 0) {
    const auto abnormal = length > kAnswerHead ? std::optional<int>(bytes[2]) : std::nullopt;
    reply.kind = Reply::Kind::nak;
    reply.device_code = device_code(end_code, abnormal);
    reply.text = "nak " + one_e::refusal(end_code, abnormal);
    return reply;
  }
  const ByteView data = frame.subspan(wire_size(data_code, kAnswerHead));
  if (data.empty()) return reply;
  reply.kind = Reply::Kind::data;
  const auto* read = std::get_if<Read>(&request);
  const bool by_bits = read != nullptr && read->way == kBitWay;
  auto image = by_bits ? bits_in(data_code, data, read->span.bits)
                       : image_in(data_code, data, read == nullptr ? 1 : 2);
  if (!image)
    return garbled("data " + to_hex(ByteView(bytes).subspan(kAnswerHead)) + " are not bits");
  reply.image = std::move(*image);
  return reply;
}

}  // namespace

Decoded OneE::decode(const Request& request, std::uint16_t tag, ByteView rx) const {
  const auto sent = encode(request, tag);
  if (!sent) return fail(sent);
  const auto command = static_cast<std::uint8_t>(*number_at(settings_.code, *sent, 0, 1));
  std::size_t at = 0;
  while (at < rx.size()) {
    const ByteView rest = rx.subspan(at);
    // No answer begins like a request, so this is the echo.
    const auto same = static_cast<std::size_t>(
        std::mismatch(rest.begin(), rest.end(), sent->begin(), sent->end()).first - rest.begin());
    if (same == sent->size()) {
      at += same;
      continue;
    }
    if (same == rest.size()) break;
    auto reply = reply_in(settings_.code, request, command, rest);
    if (reply && *reply) {
      (*reply)->began = at;
      (*reply)->consumed += at;
    }
    return reply;
  }
  return std::nullopt;
}

bool OneE::may_pass_for_answer(ByteView bytes) const {
  const auto is_answer = [](int first) {
    const int command = first & ~one_e::kAnswer;
    return (first & one_e::kAnswer) != 0 &&
           (command <= code(one_e::Command::random_words) ||
            (command >= code(one_e::Command::run) && command <= code(one_e::Command::loop_back)));
  };
  for (std::size_t at = 0; at < bytes.size(); ++at) {
    if (settings_.code == Code::binary) {
      if (is_answer(bytes[at])) return true;
      continue;
    }
    const int high = hex_digit(bytes[at]);
    const int low = at + 1 < bytes.size() ? hex_digit(bytes[at + 1]) : high == 9 ? 3 : 0;
    if (high >= 0 && low >= 0 && is_answer(high << 4 | low)) return true;
  }
  return false;
}

LineLength OneE::line_length(const Request& request) const {
  LineLength length;
  if (const auto frame = encode(request, 0))
    length.request_chars = static_cast<std::uint32_t>(frame->size());
  length.reply_chars =
      static_cast<std::uint32_t>(wire_size(settings_.code, kAnswerHead + data_bytes(request)));
  return length;
}

std::chrono::milliseconds OneE::gives_up_after() const {
  return std::chrono::milliseconds(settings_.timer * kTimerStepMs);
}

std::optional<Request> OneE::probe(std::uint32_t number) const {
  // Two more bits add a byte. Every series has M0 up, and 1E frames reach it.
  return Read{span_of(Space::m, {0, 2 * (number % kProbes)}), kBitWay};
}

std::uint32_t OneE::shorter_by(const Read& read) const {
  // Two bits take one byte of an answer.
  return read.way == kBitWay ? 2 : std::max<std::uint32_t>(16, width_of(read.span.space));
}

RefusalMeaning OneE::meaning_of(const Request& request, int device_code) const {
  const Refusal& reason = refusal_of(device_code);
  return brings_data(request) ? reason.for_read : reason.otherwise;
}

// ---- model, RUN and STOP -----------------------------------------------------------------------

std::optional<std::string> OneE::model_from(const std::vector<Bytes>& images) const {
  if (images.empty() || images[0].empty()) return std::nullopt;
  const std::string_view name = one_e::model_coded(images[0][0]);
  return name.empty() ? std::nullopt : std::optional(std::string(name));
}

SpecialDevices OneE::special_devices() const {
  return is_fx3(settings_.model) ? special_devices_of_fx() : SpecialDevices{};
}

Request OneE::run_state() const {
  if (is_fx3(settings_.model) && settings_.model != Model::unknown_fx)
    return Read{span_of(Space::special_m, {8000, 8000}), kBitWay};
  // No device that 1E frames surely reach shows the run state. This read shows that the PLC is
  // there.
  return Read{span_of(Space::d, {0, 0}), kWordWay};
}

std::optional<bool> OneE::run_state_from(ByteView image) const {
  const bool tells = is_fx3(settings_.model) && settings_.model != Model::unknown_fx;
  return tells ? PlcServices::run_state_from(image) : std::nullopt;
}

std::string OneE::run_hint() const {
  return "an FX3 starts and stops by this command at any position of its RUN/STOP switch, unless "
         "it has an error; an E71 module has no remote RUN and STOP in 1E frames";
}

}  // namespace fxagent::mc
