#include "protocol/mc/one_e_frame.h"

namespace fxagent::mc::one_e {

void Writer::number(std::uint32_t value, std::size_t bytes) {
  if (data_code_ == Code::ascii) return append_hex(frame_, value, static_cast<int>(2 * bytes));
  for (std::size_t i = 0; i < bytes; ++i, value >>= 8)
    frame_.push_back(static_cast<std::uint8_t>(value & 0xFF));
}

void Writer::device(std::uint16_t device_code, std::uint32_t number_of_device) {
  if (data_code_ == Code::ascii) number(device_code, 2);
  number(number_of_device, 4);
  if (data_code_ == Code::binary) number(device_code, 2);
}

void Writer::bits(ByteView image, std::size_t count) {
  const auto bit = [&](std::size_t i) { return i < count ? image[i / 8] >> (i % 8) & 1U : 0U; };
  for (std::size_t i = 0; i < count; i += 2) number(bit(i) << 4 | bit(i + 1), 1);
}

void Writer::words(ByteView image) {
  for (std::size_t at = 0; at + 2 <= image.size(); at += 2)
    number(static_cast<std::uint32_t>(image[at] | image[at + 1] << 8), 2);
}

std::optional<Bytes> from_ascii(ByteView frame) {
  Bytes bytes;
  bytes.reserve(frame.size() / 2);
  for (std::size_t i = 0; i < frame.size(); ++i) {
    const int digit = hex_digit(frame[i]);
    if (digit < 0) return std::nullopt;
    if (i % 2 == 0)
      bytes.push_back(static_cast<std::uint8_t>(digit << 4));
    else
      bytes.back() |= static_cast<std::uint8_t>(digit);
  }
  if (frame.size() % 2 != 0) bytes.pop_back();
  return bytes;
}

std::optional<Bytes> image_of_bits(ByteView data, std::size_t count) {
  Bytes image((count + 7) / 8);
  for (std::size_t i = 0; i < count; ++i) {
    const unsigned half = i % 2 == 0 ? data[i / 2] >> 4U : data[i / 2] & 0xFU;
    if (half > 1) return std::nullopt;
    image[i / 8] |= static_cast<std::uint8_t>(half << (i % 8));
  }
  return image;
}

Bytes image_of_words(Code data_code, ByteView data) {
  Bytes image(data.begin(), data.end());
  if (data_code == Code::ascii)
    for (std::size_t at = 0; at + 2 <= image.size(); at += 2) std::swap(image[at], image[at + 1]);
  return image;
}

}  // namespace fxagent::mc::one_e
