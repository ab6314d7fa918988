// The body of a request, piece by piece, in either code; and numbers out of an answer. For the
// codec's own files.
#pragma once

#include <optional>
#include <string>
#include <utility>

#include "protocol/bytes.h"
#include "protocol/mc/dialect.h"

namespace fxagent::mc {

/// Bytes that a number of `bytes` bytes takes on the wire: as many, or two digits for each.
constexpr std::size_t wire_size(Code code, std::size_t bytes) {
  return code == Code::ascii ? 2 * bytes : bytes;
}

/// The number of `bytes` bytes that begins at `at` of `wire`, which holds it: low byte first, or as
/// digits, the highest first. nullopt: not digits.
std::optional<std::uint32_t> number_at(Code code, ByteView wire, std::size_t at, std::size_t bytes);

/// Appends `value` as number_at() reads it.
void append_number(Code code, Bytes& out, std::uint32_t value, std::size_t bytes);

/// Appends an image of 16-bit or 32-bit values, low byte first, as they go onto the wire.
void append_image(Code code, Bytes& out, ByteView image, std::size_t value_bytes);
/// The same back, `wire` being a whole number of values. bad_frame: not digits.
Result<Bytes> image_in(Code code, ByteView wire, std::size_t value_bytes);

/// Appends the first `bits` bits of `image`: two in a byte, the first one in the high half; or a
/// character for each.
void append_bits(Code code, Bytes& out, ByteView image, std::uint32_t bits);
/// The same back. bad_frame: something but 0 and 1.
Result<Bytes> bits_in(Code code, ByteView wire, std::uint32_t bits);

class Body final {
 public:
  /// `subcommand` without the bit that iQ-R codes set.
  Body(const Dialect& dialect, bool long_codes, std::uint32_t command, std::uint32_t subcommand);

  void number(std::uint32_t value, std::size_t bytes) {
    append_number(dialect_.code, out_, value, bytes);
  }
  /// The device that holds this bit of the space. unsupported: this code has no name or no certain
  /// digits for it.
  Result<void> device(std::uint16_t space, std::uint32_t bit);
  Bytes& bytes() { return out_; }
  Bytes take() { return std::move(out_); }

 private:
  const Dialect& dialect_;
  bool long_codes_;
  Bytes out_;
};

/// Bytes that one device takes in a body.
std::size_t device_size(Code code, bool long_codes);

/// Why a device cannot be named in ASCII code on this model; empty: it can.
std::string why_not_named(const Dialect& dialect, Space space, std::uint32_t number);

}  // namespace fxagent::mc
