#include "protocol/fx/computer_link.h"

#include <algorithm>
#include <array>

#include "protocol/fx/link_frame.h"
#include "protocol/scatter.h"

namespace fxagent::fx {
namespace {

using namespace link;

constexpr std::uint32_t kPc = 0xFF;  // PLC number of every FX
// ENQ header, command, wait, number of points. The head device stands between the last two.
constexpr std::uint32_t kReadRequest = kHeader + 2 + 1 + 2;
// STX header, 256 bits, ETX, sum, CR LF.
constexpr std::size_t kLongestFrame = kHeader + 256 + 1 + 2 + 2;

/// Points of one frame, JY992D69901 7.7.1.
struct PointLimits {
  std::uint32_t br, wr, wr_of_bits, wr_of_dwords, bw, ww, ww_of_bits, ww_of_dwords, bt, wt;
};
constexpr PointLimits kNarrow{54, 13, 13, 6, 46, 11, 10, 6, 10, 6};  // FX0N, FX1S
constexpr PointLimits kWide{256, 64, 32, 32, 160, 64, 10, 32, 20, 10};

/// Returns the limits of a model. An unknown model gets those that fit all models.
const PointLimits& limits_of(Model model) {
  const bool narrow = model == Model::unknown || model == Model::fx0n || model == Model::fx1s;
  return narrow ? kNarrow : kWide;
}

/// False for timer and counter contacts, which are reached only bit by bit.
bool has_word_way(Space space) { return space != Space::ts && space != Space::cs; }

bool is_bit_space(std::uint16_t space) { return kind_of(static_cast<Space>(space)).bits == 1; }

void append_decimal(Bytes& out, std::uint32_t number, std::size_t digits, std::uint32_t base) {
  const std::size_t begin = out.size();
  out.resize(begin + digits, '0');
  for (std::size_t i = digits; i > 0; --i, number /= base)
    out[begin + i - 1] = static_cast<std::uint8_t>('0' + number % base);
}

/// Characters of a device name: five, or seven in the Q commands, which alone reach R.
constexpr std::size_t kShortName = 5;
constexpr std::size_t kLongName = 7;
std::size_t name_chars(std::uint16_t space) {
  return space == id(Space::r) ? kLongName : kShortName;
}

/// Appends "X0040": letters and number, `chars` in total.
void append_device(Bytes& out, std::uint16_t space, std::uint32_t bit, std::size_t chars) {
  const DeviceKind& kind = kind_of(static_cast<Space>(space));
  out.insert(out.end(), kind.letters.begin(), kind.letters.end());
  append_decimal(out, kind.first_number + bit / kind.bits, chars - kind.letters.size(),
                 kind.octal ? 8 : 10);
}

std::string_view read_command(const Read& read) {
  if (read.span.space == id(Space::r)) return "QR";
  return read.way == ComputerLink::kBitWay ? "BR" : "WR";
}

/// Appends the number of points; 256 is written as 00.
void append_points(Bytes& out, std::uint32_t points) { append_hex(out, points & 0xFF, 2); }

/// Appends the first `bits` bits of an image, one character each, lowest first.
void append_bits(Bytes& out, ByteView image, std::uint32_t bits) {
  for (std::uint32_t i = 0; i < bits; ++i)
    out.push_back((image[i / 8] >> (i % 8) & 1) != 0 ? '1' : '0');
}

/// Appends an image as numbers of `width` bytes, most significant digit first.
void append_numbers(Bytes& out, ByteView image, std::size_t width) {
  for (std::size_t at = 0; at + width <= image.size(); at += width)
    for (std::size_t i = width; i > 0; --i) append_hex(out, image[at + i - 1], 2);
}

/// True if WW and WT can carry the span of a bit device: whole words from a multiple of eight.
bool is_bit_words(const Span& span) {
  return has_word_way(static_cast<Space>(span.space)) && span.first_bit % 8 == 0 &&
         span.bits % 16 == 0;
}

bool brings_data(const Request& request) {
  const auto* control = std::get_if<Control>(&request);
  return std::holds_alternative<Read>(request) ||
         (control != nullptr && control->kind == Control::Kind::identify);
}

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
    const int high = hex_digit(data[2 * i]);
    const int low = hex_digit(data[2 * i + 1]);
    if (high < 0 || low < 0)
      return garbled("data " + to_hex(data.subspan(2 * i, 2)) + " is not two hex digits");
    const std::size_t number = i / width * width;
    image[number + width - 1 - (i - number)] = static_cast<std::uint8_t>(high * 16 + low);
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

/// Checks a write. BW and BT replace exactly the bits that they name, so each bit is checked alone.
/// WW of bits carries only whole words.
Result<void> check_exact(Model model, const Span& span) {
  const bool few_bits = span.space < id(Space::tc) && is_bit_space(span.space) && span.bits != 0 &&
                        span.bits <= kWide.bw;
  if (!few_bits) return check_write(model, span);
  for (std::uint32_t i = 0; i < span.bits; ++i)
    if (auto allowed = check_write(model, {span.space, span.first_bit + i, 1}); !allowed)
      return allowed;
  return {};
}

/// Unit in which a Scatter is sent.
enum class Carrier : std::uint8_t { bits, words };

std::optional<Carrier> carrier_of(const std::vector<Write>& parts, const PointLimits& limits) {
  std::uint64_t bits = 0;
  bool all_bits = !parts.empty();
  bool all_words = !parts.empty();
  for (const Write& part : parts) {
    if (part.span.space >= id(Space::tc)) return std::nullopt;
    const std::uint32_t unit = kind_of(static_cast<Space>(part.span.space)).bits;
    bits += part.span.bits;
    all_bits = all_bits && unit == 1;
    all_words = all_words && (unit == 16 || (unit == 1 && is_bit_words(part.span)));
  }
  if (all_bits && bits <= limits.bt) return Carrier::bits;
  if (all_words && bits <= limits.wt * 16) return Carrier::words;
  return std::nullopt;
}

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

constexpr int kSumMismatch = 0x02;
constexpr int kNoDevice = 0x06;

}  // namespace

std::uint8_t link_sum(ByteView bytes) {
  std::uint32_t sum = 0;
  for (const std::uint8_t byte : bytes) sum += byte;
  return static_cast<std::uint8_t>(sum);
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

Result<std::shared_ptr<const Codec>> ComputerLink::make(const Options& options) {
  Settings settings;
  if (const auto* name = option<std::string>(options, "model"); name && *name != kAutoModel) {
    const auto known = model_named(*name);
    if (!known) return refuse("no model '" + *name + "'");
    settings.model = *known;
  }
  const auto number = [&](std::string_view key, std::int64_t fallback, std::int64_t least,
                          std::int64_t most) {
    const auto* value = option<std::int64_t>(options, key);
    return static_cast<std::uint32_t>(std::clamp(value ? *value : fallback, least, most));
  };
  settings.station = number("station", settings.station, 0, 15);
  settings.max_block_bytes = number("max_block_bytes", settings.max_block_bytes, 2, 128);
  const std::uint32_t format = number("format", settings.ends_with_cr_lf ? 4 : 1, 1, 4);
  if (format != 1 && format != 4)
    return refuse("format must be 1 or 4: an FX has no format " + std::to_string(format));
  settings.ends_with_cr_lf = format == 4;
  const std::uint32_t wait = number("message_wait_ms", settings.wait_tens * 10, 0, 150);
  if (wait % 10 != 0) return refuse("message_wait_ms must be a multiple of 10");
  settings.wait_tens = wait / 10;
  if (const auto* flag = option<bool>(options, "sum_check")) settings.sum_check = *flag;
  if (const auto* flag = option<bool>(options, "acknowledge_data"))
    settings.acknowledge_data = *flag;
  return std::make_shared<const ComputerLink>(settings);
}

// ---- addresses and ranges ----------------------------------------------------------------------

Result<Address> ComputerLink::parse_address(std::string_view text,
                                            std::optional<DataType> type) const {
  return fx::parse_address(settings_.model, text, type);
}

bool ComputerLink::needs_type(std::string_view text) const { return fx::needs_type(text); }

Result<Span> ComputerLink::parse_range(std::string_view text) const {
  return fx::parse_range(settings_.model, text);
}

Result<void> ComputerLink::check_range(const Span& span) const {
  return fx::check_range(settings_.model, span);
}

Result<void> ComputerLink::check_write(const Span& span) const {
  return fx::check_write(settings_.model, span);
}

std::string ComputerLink::name_of(const Span& span) const { return device_name(span); }

// ---- ways to read ------------------------------------------------------------------------------

std::vector<ReadWay> ComputerLink::read_ways(std::uint16_t space_id) const {
  std::vector<ReadWay> ways;
  if (space_id >= id(Space::tc)) return ways;
  const auto space = static_cast<Space>(space_id);
  const std::uint32_t bits = kind_of(space).bits;
  const PointLimits& limits = limits_of(settings_.model);
  const auto add = [&](const Span& run, std::uint8_t id, std::uint32_t align, std::uint32_t unit,
                       std::uint32_t points) {
    if (run.bits < unit) return;
    ReadWay way;
    way.way = id;
    way.first_bit = run.first_bit;
    way.end_bit = run.end_bit();
    way.align_bits = align;
    way.unit_bits = unit;
    const std::uint32_t block = settings_.max_block_bytes * 8;
    way.max_bits = std::max(std::min(points * unit, block) / unit * unit, unit);
    ways.push_back(way);
  };
  // Only FX3 have the Q commands, so R is not read before the model is known.
  if (space == Space::r && settings_.model == Model::unknown) return ways;
  for (const Numbers& numbers : numbers_of(settings_.model, space)) {
    const Span run = span_of(space, numbers);
    if (bits == 1) add(run, kBitWay, 1, 1, limits.br);
    if (bits == 16) add(run, kWordWay, 16, 16, limits.wr);
    if (bits == 32) add(run, kWordWay, 32, 32, limits.wr_of_dwords);
    // The words of a bit device may extend past the last one. While the model is unknown, so is
    // that device, and bits are read one by one.
    if (bits == 1 && has_word_way(space) && settings_.model != Model::unknown)
      add(run, kWordWay, 8, 16, limits.wr_of_bits);
  }
  return ways;
}

std::uint32_t ComputerLink::max_write_bits(std::uint16_t space) const {
  if (space >= id(Space::tc)) return 0;
  const std::uint32_t bits = kind_of(static_cast<Space>(space)).bits;
  const PointLimits& limits = limits_of(settings_.model);
  // For bits, as many whole bytes as BW carries: a remainder shorter than a word must fit, too.
  const std::uint32_t unit = std::max<std::uint32_t>(bits, 8);
  const std::uint32_t most = bits == 1    ? limits.bw
                             : bits == 16 ? limits.ww * bits
                                          : limits.ww_of_dwords * bits;
  return std::max(std::min(most, settings_.max_block_bytes * 8) / unit * unit, unit);
}

ByteOrder ComputerLink::default_order() const { return ByteOrder::cdab; }

// ---- requests ----------------------------------------------------------------------------------

Bytes ComputerLink::framed(std::string_view command, ByteView area) const {
  Bytes frame{kEnq};
  frame.reserve(kHeader + command.size() + 1 + area.size() + sum_chars() + terminator_chars());
  append_hex(frame, settings_.station, 2);
  append_hex(frame, kPc, 2);
  frame.insert(frame.end(), command.begin(), command.end());
  append_hex(frame, settings_.wait_tens, 1);
  frame.insert(frame.end(), area.begin(), area.end());
  if (settings_.sum_check) append_hex(frame, link_sum(ByteView(frame).subspan(1)), 2);
  if (settings_.ends_with_cr_lf) frame.insert(frame.end(), {kCr, kLf});
  return frame;
}

Result<Bytes> ComputerLink::encode_read(const Read& read) const {
  const Span& span = read.span;
  for (const ReadWay& way : read_ways(span.space)) {
    if (way.way != read.way || span.first_bit < way.first_bit || span.bits > way.end_bit ||
        span.first_bit > way.end_bit - span.bits)
      continue;
    if (span.first_bit % way.align_bits != 0 || span.bits % way.unit_bits != 0 || span.bits == 0 ||
        span.bits > way.max_bits)
      return refuse("read of " + std::to_string(span.bits) + " bits from " + device_name(span) +
                    ": at most " + std::to_string(way.max_bits) + ", in steps of " +
                    std::to_string(way.unit_bits));
    Bytes area;
    append_device(area, span.space, span.first_bit, name_chars(span.space));
    append_points(area, span.bits / way.unit_bits);
    return framed(read_command(read), area);
  }
  return fail(ErrorCode::unsupported, device_name(span) + ": " + std::to_string(span.bits) +
                                          " bits cannot be read by " +
                                          std::string(read_command(read)) + " on this model");
}

Result<Bytes> ComputerLink::encode_write(const Write& write) const {
  const Span& span = write.span;
  if (const auto allowed = check_exact(settings_.model, span); !allowed)
    return tl::make_unexpected(allowed.error());
  const PointLimits& limits = limits_of(settings_.model);
  const std::uint32_t bits = kind_of(static_cast<Space>(span.space)).bits;
  const bool by_bits = bits == 1 && !is_bit_words(span);
  const std::uint32_t unit = by_bits ? 1 : std::max<std::uint32_t>(bits, 16);
  const std::uint32_t most = by_bits      ? limits.bw
                             : bits == 1  ? limits.ww_of_bits
                             : bits == 16 ? limits.ww
                                          : limits.ww_of_dwords;
  if (span.bits > most * unit || write.image.size() != (span.bits + 7) / 8)
    return refuse("write of " + std::to_string(span.bits) + " bits with " +
                  std::to_string(write.image.size()) + " bytes to " + device_name(span) +
                  ": at most " + std::to_string(most * unit) + " bits");
  Bytes area;
  append_device(area, span.space, span.first_bit, name_chars(span.space));
  append_points(area, span.bits / unit);
  if (by_bits)
    append_bits(area, write.image, span.bits);
  else
    append_numbers(area, write.image, unit / 8);
  const bool extension = span.space == id(Space::r);
  return framed(by_bits ? "BW" : (extension ? "QW" : "WW"), area);
}

Result<Bytes> ComputerLink::encode_scatter(const Scatter& scatter) const {
  const auto carrier = carrier_of(scatter.parts, limits_of(settings_.model));
  if (!carrier) return fail(ErrorCode::unsupported, "no frame carries these writes together");
  Bytes items;
  std::uint32_t points = 0;
  const bool long_names =
      std::any_of(scatter.parts.begin(), scatter.parts.end(),
                  [](const Write& part) { return part.span.space == id(Space::r); });
  for (const Write& part : scatter.parts) {
    const Span& span = part.span;
    if (const auto allowed = check_exact(settings_.model, span); !allowed)
      return tl::make_unexpected(allowed.error());
    if (part.image.size() != (span.bits + 7) / 8)
      return refuse(device_name(span) + ": " + std::to_string(part.image.size()) + " bytes for " +
                    std::to_string(span.bits) + " bits");
    const std::uint32_t step = *carrier == Carrier::bits ? 1 : 16;
    for (std::uint32_t done = 0; done < span.bits; done += step, ++points) {
      append_device(items, span.space, span.first_bit + done, long_names ? kLongName : kShortName);
      const Bytes value = extract_bits(part.image, done, step);
      if (*carrier == Carrier::bits)
        append_bits(items, value, 1);
      else
        append_numbers(items, value, 2);
    }
  }
  Bytes area;
  append_points(area, points);
  area.insert(area.end(), items.begin(), items.end());
  return framed(*carrier == Carrier::bits ? "BT" : (long_names ? "QT" : "WT"), area);
}

Result<Bytes> ComputerLink::encode(const Request& request, std::uint16_t /*tag*/) const {
  if (const auto* read = std::get_if<Read>(&request)) return encode_read(*read);
  if (const auto* write = std::get_if<Write>(&request)) return encode_write(*write);
  if (const auto* scatter = std::get_if<Scatter>(&request)) return encode_scatter(*scatter);
  if (const auto* force = std::get_if<Force>(&request)) {
    if (force->space < id(Space::tc) && !is_bit_space(force->space))
      return refuse(device_name({force->space, force->bit, 1}) +
                    " is a word: only bits can be forced");
    return encode_write(write_of(*force));
  }
  if (const auto* control = std::get_if<Control>(&request)) {
    switch (control->kind) {
      case Control::Kind::identify:
        return framed("PC", {});
      case Control::Kind::run:
        return framed("RR", {});
      case Control::Kind::stop:
        return framed("RS", {});
      case Control::Kind::reset:
        return settings_.ends_with_cr_lf ? Bytes{kEot, kCr, kLf} : Bytes{kEot};
    }
  }
  return fail(ErrorCode::unsupported, "the computer link has no enquiry of its own");
}

// ---- answers -----------------------------------------------------------------------------------

bool ComputerLink::is_ours(ByteView header) const {
  std::uint32_t number = 0;
  for (const std::uint8_t c : header.subspan(1, 4)) {
    const int digit = hex_digit(c);
    if (digit < 0) return false;
    number = number << 4 | static_cast<std::uint32_t>(digit);
  }
  return number == (settings_.station << 8 | kPc);
}

std::optional<std::size_t> ComputerLink::behind_frame(ByteView rx, std::size_t at) const {
  for (std::size_t i = at + 1; i < rx.size(); ++i) {
    if (rx[i] == kStx) return i;
    if (rx[i] != kEtx) continue;
    const std::size_t end = i + 1 + sum_chars();
    return end <= rx.size() ? std::optional(end) : std::nullopt;
  }
  return std::nullopt;
}

Result<std::optional<Reply>> ComputerLink::data_reply(const Request& request, ByteView rx,
                                                      std::size_t at) const {
  const std::size_t chars = data_chars(request);
  const std::size_t etx = kHeader + chars;
  const std::size_t length = etx + 1 + sum_chars() + terminator_chars();
  const ByteView frame = rx.subspan(at, std::min(length, rx.size() - at));
  const auto end = static_cast<std::size_t>(std::find(frame.begin() + kHeader, frame.end(), kEtx) -
                                            frame.begin());
  if (end < etx && end < frame.size())
    return garbled(std::to_string(end - kHeader) + " data characters given, " +
                   std::to_string(chars) + " expected");
  if (end != etx && frame.size() > etx)
    return garbled("more data characters given, " + std::to_string(chars) + " expected");
  if (frame.size() < length) return std::optional<Reply>{};
  if (settings_.sum_check) {
    const ByteView given = frame.subspan(etx + 1, 2);
    const int high = hex_digit(given[0]);
    const int low = hex_digit(given[1]);
    if (high < 0 || low < 0) return garbled("sum " + to_hex(given) + " is not two hex digits");
    const std::uint8_t computed = link_sum(frame.subspan(1, etx));
    if (high * 16 + low != computed) {
      Bytes expected;
      append_hex(expected, computed, 2);
      return garbled("sum " + as_text(given) + " given, " + as_text(expected) + " computed");
    }
  }
  if (settings_.ends_with_cr_lf && (frame[length - 2] != kCr || frame[length - 1] != kLf))
    return garbled("CR LF is missing after the data: format 4 ends with it");
  auto image = image_of(request, frame.subspan(kHeader, chars));
  if (!image) return tl::make_unexpected(image.error());
  Reply reply;
  reply.kind = Reply::Kind::data;
  reply.image = std::move(*image);
  reply.began = at;
  reply.consumed = at + length;
  if (settings_.acknowledge_data) {
    reply.closing.push_back(kAck);
    append_hex(reply.closing, settings_.station, 2);
    append_hex(reply.closing, kPc, 2);
    if (settings_.ends_with_cr_lf) reply.closing.insert(reply.closing.end(), {kCr, kLf});
  }
  return std::optional<Reply>(std::move(reply));
}

Result<std::optional<Reply>> ComputerLink::short_reply(ByteView rx, std::size_t at) const {
  const bool nak = rx[at] == kNak;
  const std::size_t length = kHeader + (nak ? 2U : 0U) + terminator_chars();
  if (rx.size() - at < length) return std::optional<Reply>{};
  const ByteView frame = rx.subspan(at, length);
  if (settings_.ends_with_cr_lf && (frame[length - 2] != kCr || frame[length - 1] != kLf))
    return garbled("CR LF is missing after ACK or NAK: format 4 ends with it");
  Reply reply;
  reply.began = at;
  reply.consumed = at + length;
  if (nak) {
    const ByteView code = frame.subspan(kHeader, 2);
    const int high = hex_digit(code[0]);
    const int low = hex_digit(code[1]);
    if (high < 0 || low < 0) return garbled("NAK with the reason " + to_hex(code));
    reply.kind = Reply::Kind::nak;
    reply.device_code = high * 16 + low;
    reply.text = "nak " + as_text(code) + ": " + std::string(link_refusal(reply.device_code));
  }
  return std::optional<Reply>(std::move(reply));
}

Result<std::optional<Reply>> ComputerLink::decode(const Request& request, std::uint16_t tag,
                                                  ByteView rx) const {
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
    if (rx.size() - at < kHeader) break;
    const bool ours = is_ours(rx.subspan(at, kHeader));
    if (first == kStx && !(ours && wants_data)) {
      // A late answer of another station, or to an older request to this one.
      const auto next = behind_frame(rx, at);
      if (!next) break;
      at = *next;
    } else if (first == kStx) {
      return data_reply(request, rx, at);
    } else if (ours && !(first == kAck && wants_data)) {
      return short_reply(rx, at);
    } else {
      ++at;
    }
  }
  if (rx.size() - begin > 2 * kLongestFrame)
    return garbled(std::to_string(rx.size() - begin) +
                   " bytes without an answer; the longest has " + std::to_string(kLongestFrame));
  return std::optional<Reply>{};
}

bool ComputerLink::expects_reply(const Request& request) const {
  return request != Request(Control{Control::Kind::reset});
}

bool ComputerLink::may_pass_for_answer(ByteView bytes) const {
  for (std::size_t at = 0; at < bytes.size(); ++at) {
    if (bytes[at] != kStx && bytes[at] != kAck && bytes[at] != kNak && bytes[at] != kEnq) continue;
    // Station and PLC number must follow, as far as they have arrived.
    const ByteView header =
        bytes.subspan(at + 1, std::min<std::size_t>(kHeader, bytes.size() - at) - 1);
    if (std::all_of(header.begin(), header.end(), [](std::uint8_t c) { return hex_digit(c) >= 0; }))
      return true;
  }
  return false;
}

LineLength ComputerLink::line_length(const Request& request) const {
  LineLength length;
  const std::uint32_t tail = sum_chars() + terminator_chars();
  if (const auto* read = std::get_if<Read>(&request)) {
    length.request_chars =
        kReadRequest + static_cast<std::uint32_t>(name_chars(read->span.space)) + tail;
  } else if (const auto frame = encode(request, 0)) {
    length.request_chars = static_cast<std::uint32_t>(frame->size());
  }
  if (!expects_reply(request)) return length;
  length.reply_chars = kHeader + terminator_chars();
  if (brings_data(request)) {
    if (settings_.acknowledge_data) length.closing_chars = length.reply_chars;
    length.reply_chars = kHeader + data_chars(request) + 1 + tail;
  }
  return length;
}

Explanation ComputerLink::explain(ByteView frame, std::optional<Direction> direction) const {
  return explain_link_frame(settings_.model, frame, direction);
}

// ---- probe, model, RUN and STOP ----------------------------------------------------------------

std::optional<Request> ComputerLink::resync() const { return Control{Control::Kind::reset}; }

std::optional<Request> ComputerLink::probe(std::uint32_t number) const {
  Read probe = std::get<Read>(run_state());
  probe.span.bits += (number % kProbes);
  return probe;
}

std::vector<Request> ComputerLink::identify() const { return {Control{Control::Kind::identify}}; }

std::optional<std::string> ComputerLink::model_from(const std::vector<Bytes>& images) const {
  if (images.empty() || images[0].empty()) return std::nullopt;
  const std::string_view name = link_model(images[0][0]);
  return name.empty() ? std::nullopt : std::optional(std::string(name));
}

std::string ComputerLink::model() const { return std::string(to_string(settings_.model)); }

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

std::optional<bool> ComputerLink::run_state_from(ByteView image) const {
  if (image.empty()) return std::nullopt;
  return (image[0] & 1) != 0;
}

Request ComputerLink::run_request(bool run) const {
  return Control{run ? Control::Kind::run : Control::Kind::stop};
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

std::optional<Request> ComputerLink::combine(const std::vector<Request>& requests) const {
  auto scatter = scatter_of(requests);
  if (!scatter || !encode_scatter(*scatter)) return std::nullopt;
  return Request(std::move(*scatter));
}

}  // namespace fxagent::fx
