#include "protocol/mc/body.h"

#include <algorithm>
#include <span>

namespace fxagent::mc {
namespace {

constexpr std::uint32_t kLongCodes = 2;  // bit of the subcommand

}  // namespace

std::optional<std::uint32_t> number_at(Code code, ByteView wire, std::size_t at,
                                       std::size_t bytes) {
  return number_in(form_of(code), wire.subspan(wire_size(code, at), wire_size(code, bytes)));
}

void append_number(Code code, Bytes& out, std::uint32_t value, std::size_t bytes) {
  if (code == Code::ascii) return append_hex(out, value, static_cast<int>(2 * bytes));
  for (std::size_t i = 0; i < bytes; ++i, value >>= 8)
    out.push_back(static_cast<std::uint8_t>(value));
}

void append_image(Code code, Bytes& out, ByteView image, std::size_t value_bytes) {
  if (code == Code::binary) {
    out.insert(out.end(), image.begin(), image.end());
    return;
  }
  for (std::size_t at = 0; at + value_bytes <= image.size(); at += value_bytes)
    append_number(code, out, *number_at(Code::binary, image, at, value_bytes), value_bytes);
}

Result<Bytes> image_in(Code code, ByteView wire, std::size_t value_bytes) {
  if (code == Code::binary) return Bytes(wire.begin(), wire.end());
  auto image = bytes_in(wire);
  if (!image) return image;
  for (std::span left(*image); left.size() >= value_bytes; left = left.subspan(value_bytes))
    std::ranges::reverse(left.first(value_bytes));
  return image;
}

void append_bits(Code code, Bytes& out, ByteView image, std::uint32_t bits) {
  const auto bit = [&](std::uint32_t i) { return i < bits && (image[i / 8] >> (i % 8) & 1) != 0; };
  if (code == Code::ascii) {
    for (std::uint32_t i = 0; i < bits; ++i) out.push_back(bit(i) ? '1' : '0');
    return;
  }
  for (std::uint32_t i = 0; i < bits; i += 2)
    out.push_back(static_cast<std::uint8_t>((bit(i) ? 0x10 : 0) | (bit(i + 1) ? 1 : 0)));
}

Result<Bytes> bits_in(Code code, ByteView wire, std::uint32_t bits) {
  Bytes image((bits + 7) / 8);
  for (std::uint32_t i = 0; i < bits; ++i) {
    const std::uint8_t byte = code == Code::ascii ? wire[i] : wire[i / 2];
    const int value = code == Code::ascii ? byte - '0' : (i % 2 == 0 ? byte >> 4 : byte & 0x0F);
    if (value != 0 && value != 1)
      return garbled("data " + to_hex(ByteView(&byte, 1)) + " is neither 0 nor 1");
    if (value == 1) image[i / 8] |= static_cast<std::uint8_t>(1U << (i % 8));
  }
  return image;
}

Body::Body(const Dialect& dialect, bool long_codes, std::uint32_t command, std::uint32_t subcommand)
    : dialect_(dialect), long_codes_(long_codes) {
  number(command, 2);
  number(subcommand | (long_codes ? kLongCodes : 0), 2);
}

void Body::device(std::uint16_t space_id, std::uint32_t bit) {
  const auto space = static_cast<Space>(space_id);
  const DeviceKind& kind = kind_of(space);
  const std::uint32_t number = kind.first_number + bit / kind.bits;
  if (error_.empty()) error_ = why_not_named(dialect_, space, number, long_codes_);
  if (dialect_.code == Code::binary) {
    append_number(Code::binary, out_, number, long_codes_ ? 4 : 3);
    append_number(Code::binary, out_, kind.binary, long_codes_ ? 2 : 1);
    return;
  }
  std::string name(long_codes_ ? kind.letters : kind.ascii);
  name.resize(long_codes_ ? 4 : 2, '*');
  const std::string digits = digits_of(number, ascii_base_of(dialect_.model, space));
  const std::size_t room = long_codes_ ? 8 : 6;
  name.append(room - std::min(room, digits.size()), '0').append(digits);
  out_.insert(out_.end(), name.begin(), name.end());
}

Result<Bytes> Body::take() {
  if (!error_.empty()) return fail(ErrorCode::unsupported, std::move(error_));
  return std::move(out_);
}

std::string why_not_named(const Dialect& dialect, Space space, std::uint32_t number,
                          bool long_codes) {
  const bool is_binary = dialect.code == Code::binary;
  // Six digits, in binary code as three bytes, or eight with the codes of iQ-R.
  std::uint64_t beyond = 1;
  for (int digit = 0; digit < (long_codes ? 8 : 6); ++digit)
    beyond *= is_binary ? 16 : ascii_base_of(dialect.model, space);
  if (number < beyond && is_binary) return {};
  const std::string name = device_name(dialect.model, space, number);
  const std::string cure =
      is_serial(dialect.frame) ? ": use mc-4c with format 5" : ": use `code` binary";
  if (number >= beyond)
    return name + " has more digits than a request to this model has room for" +
           (is_binary ? ": set `model`" : cure);
  if (has_doubtful_digits(dialect, space) && number >= kCertain)
    return name +
           ": whether an FX5 takes the digits of X and Y as octal in ASCII code is not known" +
           cure;
  if (!long_codes && kind_of(space).ascii.empty())
    return name + " has no certain name in ASCII code on this model" + cure;
  return {};
}

}  // namespace fxagent::mc
