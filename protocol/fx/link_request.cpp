// Requests of the computer link: the ways to read, and the frames that carry reads, writes and
// commands.
#include <algorithm>
#include <string>
#include <string_view>

#include "protocol/fx/computer_link.h"
#include "protocol/mc/body.h"
#include "protocol/mc/dialect.h"
#include "protocol/mc/serial_frame.h"

namespace fxagent::fx {
namespace {

using Settings = ComputerLink::Settings;

/// Points of one frame, JY992D69901 7.7.1.
struct PointLimits {
  std::uint32_t br, wr, wr_of_bits, wr_of_dwords, bw, ww, ww_of_bits, ww_of_dwords, bt, wt;
};
constexpr PointLimits kNarrow{54, 13, 13, 6, 46, 11, 10, 6, 10, 6};  // FX0N, FX1S
constexpr PointLimits kWide{256, 64, 32, 32, 160, 64, 10, 32, 20, 10};

/// Returns the limits of a model. An unknown model gets those that fit all models.
const PointLimits& limits_of(Model model) {
  const bool narrow = model == Model::unknown_fx || model == Model::fx0n || model == Model::fx1s;
  return narrow ? kNarrow : kWide;
}

/// Characters of a device name: five, or seven in the Q commands, which alone reach R.
constexpr std::size_t kShortName = 5;
constexpr std::size_t kLongName = 7;
std::size_t name_chars(std::uint16_t space) {
  return space == id(Space::r) ? kLongName : kShortName;
}

/// Appends "X0040": letters and number, `chars` in total.
void append_device(Bytes& out, std::uint16_t space, std::uint32_t bit, std::size_t chars) {
  std::string name = device_name({space, bit, 1});
  name.insert(kind_of(static_cast<Space>(space)).letters.size(), chars - name.size(), '0');
  out.insert(out.end(), name.begin(), name.end());
}

std::string_view read_command(const Read& read) {
  if (read.span.space == id(Space::r)) return "QR";
  return read.way == ComputerLink::kBitWay ? "BR" : "WR";
}

/// Appends the number of points; 256 is written as 00.
void append_points(Bytes& out, std::uint32_t points) { append_hex(out, points & 0xFF, 2); }

/// WW and WT write words of a bit device from a multiple of this on.
constexpr std::uint32_t kAlign = 8;

/// Checks a write. BW and BT replace exactly the bits that they name, so each bit is checked alone.
/// WW of bits carries only whole words.
Result<void> check_exact(Model model, const Span& span) {
  const bool few_bits = is_addressed(span.space) && width_of(span.space) == 1 && span.bits != 0 &&
                        span.bits <= kWide.bw;
  if (!few_bits) return fx::check_write(model, span);
  for (std::uint32_t i = 0; i < span.bits; ++i)
    if (auto allowed = fx::check_write(model, {span.space, span.first_bit + i, 1}); !allowed)
      return allowed;
  return {};
}

/// Returns a request frame: ENQ station pc command wait area [sum] [CR LF].
Bytes framed(const Settings& settings, std::string_view command, ByteView area) {
  Bytes message(command.begin(), command.end());
  append_hex(message, settings.wait_tens, 1);
  message.insert(message.end(), area.begin(), area.end());
  return mc::serial_request(settings, 0, message);
}

Result<Bytes> encode_read(const Settings& settings, const std::vector<ReadWay>& ways,
                          const Read& read) {
  const Span& span = read.span;
  const std::string_view command = read_command(read);
  const auto way = way_for(
      ways, read.way, span, [&] { return device_name(span); }, "read by " + std::string(command));
  if (!way) return fail(way);
  Bytes area;
  append_device(area, span.space, span.first_bit, name_chars(span.space));
  append_points(area, span.bits / way->unit_bits);
  return framed(settings, command, area);
}

Result<Bytes> encode_write(const Settings& settings, const Write& write) {
  const Span& span = write.span;
  if (const auto allowed = check_exact(settings.model, span); !allowed) return fail(allowed);
  const PointLimits& limits = limits_of(settings.model);
  const std::uint32_t bits = width_of(span.space);
  const bool by_bits = bits == 1 && !mc::is_words(span, kAlign);
  const std::uint32_t unit = by_bits ? 1 : std::max<std::uint32_t>(bits, 16);
  const std::uint32_t most = by_bits      ? limits.bw
                             : bits == 1  ? limits.ww_of_bits
                             : bits == 16 ? limits.ww
                                          : limits.ww_of_dwords;
  if (const auto why = why_wrong_image(write, most * unit); !why.empty())
    return refuse(device_name(span) + ": " + why);
  Bytes area;
  append_device(area, span.space, span.first_bit, name_chars(span.space));
  append_points(area, span.bits / unit);
  if (by_bits)
    mc::append_bits(mc::Code::ascii, area, write.image, span.bits);
  else
    mc::append_image(mc::Code::ascii, area, write.image, unit / 8);
  const bool extension = span.space == id(Space::r);
  return framed(settings, by_bits ? "BW" : (extension ? "QW" : "WW"), area);
}

Result<Bytes> encode_scatter(const Settings& settings, const Scatter& scatter) {
  const PointLimits& limits = limits_of(settings.model);
  const auto step = mc::item_bits(scatter, limits.bt, limits.wt, kAlign);
  if (!step) return fail(step);
  Bytes items;
  std::uint32_t points = 0;
  const bool long_names = std::ranges::any_of(
      scatter.parts, [](const Write& part) { return part.span.space == id(Space::r); });
  for (const Write& part : scatter.parts) {
    const Span& span = part.span;
    if (const auto allowed = check_exact(settings.model, span); !allowed) return fail(allowed);
    if (const auto why = why_wrong_image(part); !why.empty())
      return refuse(device_name(span) + ": " + why);
    for (std::uint32_t done = 0; done < span.bits; done += *step, ++points) {
      append_device(items, span.space, span.first_bit + done, long_names ? kLongName : kShortName);
      const Bytes value = extract_bits(part.image, done, *step);
      if (*step == 1)
        mc::append_bits(mc::Code::ascii, items, value, 1);
      else
        mc::append_image(mc::Code::ascii, items, value, 2);
    }
  }
  Bytes area;
  append_points(area, points);
  area.insert(area.end(), items.begin(), items.end());
  return framed(settings, *step == 1 ? "BT" : (long_names ? "QT" : "WT"), area);
}

}  // namespace

std::vector<ReadWay> ComputerLink::read_ways(std::uint16_t space_id) const {
  std::vector<ReadWay> ways;
  if (!is_addressed(space_id)) return ways;
  const auto space = static_cast<Space>(space_id);
  const std::uint32_t bits = kind_of(space).bits;
  const PointLimits& limits = limits_of(settings_.model);
  const auto add = [&](const Span& run, std::uint8_t id, std::uint32_t align, std::uint32_t unit,
                       std::uint32_t points) {
    if (run.bits < unit) return;
    const std::uint32_t most = std::min(points * unit, settings_.max_block_bytes * 8);
    ways.push_back({.way = id,
                    .first_bit = run.first_bit,
                    .end_bit = run.end_bit(),
                    .align_bits = align,
                    .unit_bits = unit,
                    .max_bits = std::max(most / unit * unit, unit)});
  };
  // Only FX3 have the Q commands, so R is not read before the model is known.
  if (space == Space::r && settings_.model == Model::unknown_fx) return ways;
  for (const Numbers& numbers : numbers_of(settings_.model, space)) {
    const Span run = span_of(space, numbers);
    if (bits == 1) add(run, kBitWay, 1, 1, limits.br);
    if (bits == 16) add(run, kWordWay, 16, 16, limits.wr);
    if (bits == 32) add(run, kWordWay, 32, 32, limits.wr_of_dwords);
    // The words of a bit device may extend past the last one. While the model is unknown, so is
    // that device, and bits are read one by one.
    if (bits == 1 && !mc::is_contact(space) && settings_.model != Model::unknown_fx)
      add(run, kWordWay, 8, 16, limits.wr_of_bits);
  }
  return ways;
}

std::uint32_t ComputerLink::max_write_bits(std::uint16_t space) const {
  if (!is_addressed(space)) return 0;
  const std::uint32_t bits = width_of(space);
  const PointLimits& limits = limits_of(settings_.model);
  // For bits, as many whole bytes as BW carries: a remainder shorter than a word must fit, too.
  const std::uint32_t unit = std::max<std::uint32_t>(bits, 8);
  const std::uint32_t most = bits == 1    ? limits.bw
                             : bits == 16 ? limits.ww * bits
                                          : limits.ww_of_dwords * bits;
  return std::max(std::min(most, settings_.max_block_bytes * 8) / unit * unit, unit);
}

Result<Bytes> ComputerLink::encode(const Request& request, std::uint16_t /*tag*/) const {
  if (const auto* read = std::get_if<Read>(&request))
    return encode_read(settings_, read_ways(read->span.space), *read);
  if (const auto* write = std::get_if<Write>(&request)) return encode_write(settings_, *write);
  if (const auto* scatter = std::get_if<Scatter>(&request))
    return encode_scatter(settings_, *scatter);
  if (const auto* force = std::get_if<Force>(&request))
    return encode_write(settings_, write_of(*force));
  if (const auto* control = std::get_if<Control>(&request)) {
    switch (control->kind) {
      case Control::Kind::identify:
        return framed(settings_, "PC", {});
      case Control::Kind::run:
        return framed(settings_, "RR", {});
      case Control::Kind::stop:
        return framed(settings_, "RS", {});
      case Control::Kind::reset:
        return settings_.format == 4 ? Bytes{kEot, kCr, kLf} : Bytes{kEot};
    }
  }
  return fail(ErrorCode::unsupported, "the computer link has no enquiry of its own");
}

}  // namespace fxagent::fx
