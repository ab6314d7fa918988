#include "protocol/fx/computer_link.h"

#include <algorithm>
#include <array>
#include <utility>

#include "protocol/checklist.h"
#include "protocol/encoding.h"
#include "protocol/mc/body.h"
#include "protocol/mc/serial_frame.h"

namespace fxagent::fx {
namespace {

using Settings = ComputerLink::Settings;

// STX header, 256 bits, ETX, sum, CR LF.
constexpr std::size_t kLongestFrame = kLinkHeader + 256 + 1 + 2 + 2;

// Reasons in a NAK that decide whether the request is sent again.
constexpr int kSumMismatch = 0x02;
constexpr int kNoDevice = 0x06;

// Codes of the models in answers to PC, JY992D69901 8.8; FX3 from JY997D16901, F4 from the
// FX3U-ENET manual. The code of FX3S is unknown.
constexpr std::pair<int, Model> kTypeCodes[] = {{0xF2, Model::fx1s}, {0x8E, Model::fx0n},
                                                {0x9E, Model::fx1n}, {0x9D, Model::fx2n},
                                                {0xF3, Model::fx3u}, {0xF4, Model::fx3g}};

/// Returns the characters of data in the answer to a request; 0: it has none.
std::uint32_t data_chars(const Request& request) {
  const auto* read = std::get_if<Read>(&request);
  if (read == nullptr) return is_identify(request) ? 2 : 0;
  return read->way == ComputerLink::kBitWay ? read->span.bits : read->span.bits / 4;
}

Result<Bytes> image_of(const Request& request, ByteView data) {
  const auto* read = std::get_if<Read>(&request);
  if (read == nullptr) return bytes_in(data);
  if (read->way == ComputerLink::kBitWay)
    return mc::bits_in(mc::Code::ascii, data, read->span.bits);
  const std::uint32_t bits = width_of(read->span.space);
  return mc::image_in(mc::Code::ascii, data, std::max<std::uint32_t>(bits, 16) / 8);
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
  take_option(settings.max_block_bytes, options, "max_block_bytes", 2, 128);  // 64 words
  take_option(settings.format, options, "format", 1, 4);
  if (settings.format != 1 && settings.format != 4)
    return refuse("format must be 1 or 4: an FX has no format " + std::to_string(settings.format));
  std::uint32_t wait = settings.wait_tens * 10;
  take_option(wait, options, "message_wait_ms", 0, 150);
  if (wait % 10 != 0) return refuse("message_wait_ms must be a multiple of 10");
  settings.wait_tens = wait / 10;
  take_option(settings.sum_check, options, "sum_check");
  take_option(settings.acknowledge_data, options, "acknowledge_data");
  return made(settings);
}

// ---- answers -----------------------------------------------------------------------------------

namespace {

/// Returns the frame that acknowledges data: ACK, station, PLC number [CR LF].
Bytes acknowledge(const Settings& settings) {
  Bytes frame = mc::serial_header(settings);
  frame.insert(frame.begin(), kAck);
  if (settings.format == 4) frame.insert(frame.end(), {kCr, kLf});
  return frame;
}

}  // namespace

Decoded ComputerLink::decode(const Request& request, std::uint16_t tag, ByteView rx) const {
  if (const auto sent = encode(request, tag); !sent) return fail(sent);
  if (!expects_reply(request)) return fail(ErrorCode::unsupported, "EOT is never answered");
  Decoded answer = mc::serial_answer(settings_, 0, data_chars(request), rx);
  if (!answer) return answer;
  if (!*answer) {
    // Bytes before the echo of the request are older. An answer may begin with the last character
    // that begins one.
    const auto echo = std::find(rx.rbegin(), rx.rend(), kEnq);
    const auto size = static_cast<std::size_t>(echo - rx.rbegin());
    constexpr std::array kBegins{kStx, kAck, kNak};
    const auto begin = std::find_first_of(rx.rbegin(), echo, kBegins.begin(), kBegins.end());
    const auto noise = begin == echo ? size : static_cast<std::size_t>(echo - begin) - 1;
    if (noise > 2 * kLongestFrame || size > 3 * kLongestFrame)
      return garbled(std::to_string(size) + " bytes without an answer; the longest has " +
                     std::to_string(kLongestFrame));
    return std::nullopt;
  }
  Reply& reply = **answer;
  if (reply.kind == Reply::Kind::nak) {
    const ByteView code = rx.subspan(reply.began + kLinkHeader, 2);
    reply.device_code = hex_byte(code);
    if (reply.device_code < 0) return garbled("NAK with the reason " + to_hex(code));
    reply.text = "nak " + as_text(code) + ": " + std::string(link_refusal(reply.device_code));
  } else if (reply.kind == Reply::Kind::data) {
    auto image = image_of(request, reply.image);
    if (!image) return fail(image);
    reply.image = std::move(*image);
    if (settings_.acknowledge_data) reply.closing = acknowledge(settings_);
  }
  return answer;
}

bool ComputerLink::expects_reply(const Request& request) const {
  return request != Request(Control{Control::Kind::reset});
}

bool ComputerLink::may_pass_for_answer(ByteView bytes) const {
  return mc::may_be_serial_answer(settings_, bytes);
}

LineLength ComputerLink::line_length(const Request& request) const {
  LineLength length;
  if (const auto frame = encode(request, 0))
    length.request_chars = static_cast<std::uint32_t>(frame->size());
  if (!expects_reply(request)) return length;
  const auto reply_chars = [&](std::uint32_t data) {
    return static_cast<std::uint32_t>(mc::serial_answer_length(settings_, data));
  };
  const std::uint32_t data = data_chars(request);
  length.reply_chars = reply_chars(data);
  if (data != 0 && settings_.acknowledge_data) length.closing_chars = reply_chars(0);
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
  constexpr std::pair<int, std::string_view> kReasons[] = {
      {kSumMismatch, "the PLC found a wrong sum"},
      {0x03, "the PLC is set to another format or procedure (D8120)"},
      {kNoDevice, "the device does not exist, or too many points"},
      {0x07, "the data are not hex digits"},
      {0x0A, "the PLC number is not FF"},
      {0x10, "the PLC number is not FF"},
      {0x18, "remote RUN or STOP is not possible"}};
  for (const auto& [known, text] : kReasons)
    if (known == code) return text;
  return "a reason that the manual does not list";
}

std::string_view link_model(int code) {
  for (const auto& [known, model] : kTypeCodes)
    if (known == code) return to_string(model);
  return {};
}

// ---- D8120 --------------------------------------------------------------------------------------

std::optional<std::uint16_t> d8120(const Options& options, const LineDefaults& line) {
  // Bits 4 to 7 are 3 for the first speed, 4 for the next, and so on.
  constexpr std::array kSpeeds{300, 600, 1200, 2400, 4800, 9600, 19200, 38400};
  constexpr std::uint32_t kFirstSpeed = 3;
  const auto* speed = std::ranges::find(kSpeeds, line.baud);
  if (speed == kSpeeds.end()) return std::nullopt;
  std::uint32_t word = 1U << 14U;  // computer link
  word |= (kFirstSpeed + static_cast<std::uint32_t>(speed - kSpeeds.begin())) << 4U;
  if (line.data_bits == 8) word |= 1U << 0U;
  if (line.parity == Parity::odd) word |= 1U << 1U;
  if (line.parity == Parity::even) word |= 3U << 1U;
  if (line.stop_bits == 2) word |= 1U << 3U;
  if (const auto* sum = option<bool>(options, "sum_check"); !sum || *sum) word |= 1U << 13U;
  if (const auto* format = option<std::int64_t>(options, "format"); format && *format == 4)
    word |= 1U << 15U;
  return static_cast<std::uint16_t>(word);
}

std::string d8120_for(const Options& options, const LineDefaults& line) {
  const auto word = d8120(options, line);
  if (!word) return "does D8120 have the speed, data bits and parity of this port";
  return "is D8120 H" + hex_text(*word, 4) + " (" + to_string(line) + ", RS-485)";
}

}  // namespace fxagent::fx
