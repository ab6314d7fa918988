#include "protocol/fx/computer_link.h"

#include <algorithm>
#include <array>

#include "protocol/encoding.h"

namespace fxagent::fx {
namespace {

using Settings = ComputerLink::Settings;

// STX header, 256 bits, ETX, sum, CR LF.
constexpr std::size_t kLongestFrame = kLinkHeader + 256 + 1 + 2 + 2;

// Reasons in a NAK that decide whether the request is sent again.
constexpr int kSumMismatch = 0x02;
constexpr int kNoDevice = 0x06;

/// Codes of the models in answers to PC, JY992D69901 8.8; FX3 from JY997D16901, F4 from the
/// FX3U-ENET manual. The code of FX3S is unknown.
struct TypeCode {
  int code;
  Model model;
};
constexpr std::array<TypeCode, 6> kTypeCodes = {{{0xF2, Model::fx1s},
                                                 {0x8E, Model::fx0n},
                                                 {0x9E, Model::fx1n},
                                                 {0x9D, Model::fx2n},
                                                 {0xF3, Model::fx3u},
                                                 {0xF4, Model::fx3g}}};

/// Returns the characters of data in the answer to a read or to PC.
std::uint32_t data_chars(const Request& request) {
  const auto* read = std::get_if<Read>(&request);
  if (read == nullptr) return 2;
  return read->way == ComputerLink::kBitWay ? read->span.bits : read->span.bits / 4;
}

Result<Bytes> bits_of(ByteView data) {
  Bytes image((data.size() + 7) / 8);
  for (std::size_t i = 0; i < data.size(); ++i) {
    if (data[i] != '0' && data[i] != '1')
      return garbled("data " + to_hex(data.subspan(i, 1)) + " is neither 0 nor 1");
    if (data[i] == '1') image[i / 8] |= static_cast<std::uint8_t>(1U << (i % 8));
  }
  return image;
}

/// Converts numbers of `width` bytes, most significant digit first, to an image with the low byte
/// first.
Result<Bytes> numbers_in(ByteView data, std::size_t width) {
  Bytes image(data.size() / 2);
  for (std::size_t i = 0; i < image.size(); ++i) {
    const int byte = hex_byte(data.subspan(2 * i, 2));
    if (byte < 0)
      return garbled("data " + to_hex(data.subspan(2 * i, 2)) + " is not two hex digits");
    const std::size_t number = i / width * width;
    image[number + width - 1 - (i - number)] = static_cast<std::uint8_t>(byte);
  }
  return image;
}

Result<Bytes> image_of(const Request& request, ByteView data) {
  const auto* read = std::get_if<Read>(&request);
  if (read == nullptr) return numbers_in(data, 1);
  if (read->way == ComputerLink::kBitWay) return bits_of(data);
  const std::uint32_t bits = kind_of(static_cast<Space>(read->span.space)).bits;
  return numbers_in(data, std::max<std::uint32_t>(bits, 16) / 8);
}

}  // namespace

Result<std::shared_ptr<const Codec>> ComputerLink::make(const Options& options) {
  Settings settings;
  if (const auto* name = option<std::string>(options, "model"); name && *name != kAutoModel) {
    const auto known = model_named(*name);
    if (!known) return refuse("no model '" + *name + "'");
    settings.model = *known;
  }
  take_option(settings.station, options, "station", 0, 15);
  take_option(settings.max_block_bytes, options, "max_block_bytes", 2, 128);
  std::uint32_t format = settings.ends_with_cr_lf ? 4 : 1;
  take_option(format, options, "format", 1, 4);
  if (format != 1 && format != 4)
    return refuse("format must be 1 or 4: an FX has no format " + std::to_string(format));
  settings.ends_with_cr_lf = format == 4;
  std::uint32_t wait = settings.wait_tens * 10;
  take_option(wait, options, "message_wait_ms", 0, 150);
  if (wait % 10 != 0) return refuse("message_wait_ms must be a multiple of 10");
  settings.wait_tens = wait / 10;
  take_option(settings.sum_check, options, "sum_check");
  take_option(settings.acknowledge_data, options, "acknowledge_data");
  return std::make_shared<const ComputerLink>(settings);
}

// ---- answers -----------------------------------------------------------------------------------

namespace {

/// True if `header` has our station and PLC number.
bool is_ours(const Settings& settings, ByteView header) {
  return number_in(NumberForm::digits, header.subspan(1, 4)) == (settings.station << 8 | kLinkPc);
}

/// Returns the place after another station's frame that begins at `at`, or of the STX that cuts it
/// off. nullopt if its end has not arrived.
std::optional<std::size_t> behind_frame(const Settings& settings, ByteView rx, std::size_t at) {
  for (std::size_t i = at + 1; i < rx.size(); ++i) {
    if (rx[i] == kStx) return i;
    if (rx[i] != kEtx) continue;
    const std::size_t end = i + 1 + settings.sum_chars();
    return end <= rx.size() ? std::optional(end) : std::nullopt;
  }
  return std::nullopt;
}

/// False if format 4 is set and the frame does not end with CR LF.
bool ends_right(const Settings& settings, ByteView frame) {
  return !settings.ends_with_cr_lf || (frame[frame.size() - 2] == kCr && frame.back() == kLf);
}

/// Returns the frame that acknowledges data: ACK, station, PLC number [CR LF].
Bytes acknowledge(const Settings& settings) {
  Bytes frame{kAck};
  append_hex(frame, settings.station << 8 | kLinkPc, 4);
  if (settings.ends_with_cr_lf) frame.insert(frame.end(), {kCr, kLf});
  return frame;
}

Decoded data_reply(const Settings& settings, const Request& request, ByteView rx, std::size_t at) {
  const std::size_t chars = data_chars(request);
  const std::size_t etx = kLinkHeader + chars;
  const std::size_t length = etx + 1 + settings.sum_chars() + settings.terminator_chars();
  const ByteView frame = rx.subspan(at, std::min(length, rx.size() - at));
  const auto end = static_cast<std::size_t>(
      std::find(frame.begin() + kLinkHeader, frame.end(), kEtx) - frame.begin());
  if (end < etx && end < frame.size())
    return garbled(std::to_string(end - kLinkHeader) + " data characters given, " +
                   std::to_string(chars) + " expected");
  if (end != etx && frame.size() > etx)
    return garbled("more data characters given, " + std::to_string(chars) + " expected");
  if (frame.size() < length) return std::nullopt;
  if (settings.sum_check) {
    const ByteView given = frame.subspan(etx + 1, 2);
    const int sum = hex_byte(given);
    if (sum < 0) return garbled("sum " + to_hex(given) + " is not two hex digits");
    const std::uint8_t computed = byte_sum(frame.subspan(1, etx));
    if (sum != computed)
      return garbled("sum " + as_text(given) + " given, " + hex_text(computed, 2) + " computed");
  }
  if (!ends_right(settings, frame))
    return garbled("CR LF is missing after the data: format 4 ends with it");
  auto image = image_of(request, frame.subspan(kLinkHeader, chars));
  if (!image) return tl::make_unexpected(image.error());
  return Reply{.kind = Reply::Kind::data,
               .image = std::move(*image),
               .closing = settings.acknowledge_data ? acknowledge(settings) : Bytes{},
               .began = at,
               .consumed = at + length};
}

Decoded short_reply(const Settings& settings, ByteView rx, std::size_t at) {
  const bool nak = rx[at] == kNak;
  const std::size_t length = kLinkHeader + (nak ? 2U : 0U) + settings.terminator_chars();
  if (rx.size() - at < length) return std::nullopt;
  const ByteView frame = rx.subspan(at, length);
  if (!ends_right(settings, frame))
    return garbled("CR LF is missing after ACK or NAK: format 4 ends with it");
  if (!nak) return Reply{.began = at, .consumed = at + length};
  const ByteView code = frame.subspan(kLinkHeader, 2);
  const int reason = hex_byte(code);
  if (reason < 0) return garbled("NAK with the reason " + to_hex(code));
  return Reply{.kind = Reply::Kind::nak,
               .device_code = reason,
               .text = "nak " + as_text(code) + ": " + std::string(link_refusal(reason)),
               .began = at,
               .consumed = at + length};
}

}  // namespace

Decoded ComputerLink::decode(const Request& request, std::uint16_t tag, ByteView rx) const {
  if (const auto sent = encode(request, tag); !sent) return tl::make_unexpected(sent.error());
  if (!expects_reply(request)) return fail(ErrorCode::unsupported, "EOT is never answered");
  const bool wants_data = brings_data(request);
  // A PLC never sends ENQ: it is the echo of this request, and bytes before it are older.
  std::size_t at = rx.size();
  while (at > 0 && rx[at - 1] != kEnq) --at;
  const std::size_t begin = at;
  while (at < rx.size()) {
    const std::uint8_t first = rx[at];
    if (first != kStx && first != kAck && first != kNak) {
      ++at;
      continue;
    }
    if (first == kStx) {
      // If another STX cuts off a frame, continue at that STX.
      const auto stop = rx.begin() + static_cast<std::ptrdiff_t>(at) + 1;
      const auto again =
          std::find_if(stop, rx.end(), [](std::uint8_t c) { return c == kStx || c == kEtx; });
      if (again != rx.end() && *again == kStx) {
        at = static_cast<std::size_t>(again - rx.begin());
        continue;
      }
    }
    if (rx.size() - at < kLinkHeader) break;
    const bool ours = is_ours(settings_, rx.subspan(at, kLinkHeader));
    if (first == kStx && !(ours && wants_data)) {
      // A late answer of another station, or to an older request to this one.
      const auto next = behind_frame(settings_, rx, at);
      if (!next) break;
      at = *next;
    } else if (first == kStx) {
      return data_reply(settings_, request, rx, at);
    } else if (ours && !(first == kAck && wants_data)) {
      return short_reply(settings_, rx, at);
    } else {
      ++at;
    }
  }
  if (rx.size() - begin > 2 * kLongestFrame)
    return garbled(std::to_string(rx.size() - begin) +
                   " bytes without an answer; the longest has " + std::to_string(kLongestFrame));
  return std::nullopt;
}

bool ComputerLink::expects_reply(const Request& request) const {
  return request != Request(Control{Control::Kind::reset});
}

bool ComputerLink::may_pass_for_answer(ByteView bytes) const {
  for (std::size_t at = 0; at < bytes.size(); ++at) {
    if (bytes[at] != kStx && bytes[at] != kAck && bytes[at] != kNak && bytes[at] != kEnq) continue;
    // Station and PLC number must follow, as far as they have arrived.
    const ByteView header =
        bytes.subspan(at + 1, std::min<std::size_t>(kLinkHeader, bytes.size() - at) - 1);
    if (is_hex(header)) return true;
  }
  return false;
}

LineLength ComputerLink::line_length(const Request& request) const {
  LineLength length;
  length.request_chars = request_chars(request);
  if (!expects_reply(request)) return length;
  length.reply_chars = kLinkHeader + settings_.terminator_chars();
  if (brings_data(request)) {
    if (settings_.acknowledge_data) length.closing_chars = length.reply_chars;
    length.reply_chars = kLinkHeader + data_chars(request) + 1 + settings_.sum_chars() +
                         settings_.terminator_chars();
  }
  return length;
}

// ---- probe, model, RUN and STOP ----------------------------------------------------------------

std::optional<Request> ComputerLink::probe(std::uint32_t number) const {
  Read probe = std::get<Read>(run_state());
  probe.span.bits += (number % kProbes);
  return probe;
}

std::optional<std::string> ComputerLink::model_from(const std::vector<Bytes>& images) const {
  if (images.empty() || images[0].empty()) return std::nullopt;
  const std::string_view name = link_model(images[0][0]);
  return name.empty() ? std::nullopt : std::optional(std::string(name));
}

std::shared_ptr<const Codec> ComputerLink::with_model(std::string_view model) const {
  const auto known = model_named(model);
  if (!known) return nullptr;
  Settings settings = settings_;
  settings.model = *known;
  return std::make_shared<const ComputerLink>(settings);
}

Request ComputerLink::run_state() const {
  return Read{span_of(Space::special_m, {8000, 8000}), kBitWay};
}

std::string ComputerLink::run_hint() const {
  return "the PLC's RUN/STOP switch (and its RUN terminal) must be at STOP: the link can only stop "
         "a PLC that it set running";
}

RefusalMeaning ComputerLink::meaning_of(const Request& request, int device_code) const {
  const auto* control = std::get_if<Control>(&request);
  const bool runs_or_stops = control != nullptr && (control->kind == Control::Kind::run ||
                                                    control->kind == Control::Kind::stop);
  if (device_code == kSumMismatch && !runs_or_stops) return RefusalMeaning::curable;
  const bool too_much = device_code == kNoDevice && std::holds_alternative<Read>(request);
  return too_much ? RefusalMeaning::hole : RefusalMeaning::final;
}

std::string_view link_refusal(int code) {
  switch (code) {
    case kSumMismatch:
      return "the PLC found a wrong sum";
    case 0x03:
      return "the PLC is set to another format or procedure (D8120)";
    case kNoDevice:
      return "the device does not exist, or too many points";
    case 0x07:
      return "the data are not hex digits";
    case 0x0A:
    case 0x10:
      return "the PLC number is not FF";
    case 0x18:
      return "remote RUN or STOP is not possible";
    default:
      return "a reason that the manual does not list";
  }
}

std::string_view link_model(int code) {
  for (const TypeCode& known : kTypeCodes)
    if (known.code == code) return to_string(known.model);
  return {};
}

}  // namespace fxagent::fx
