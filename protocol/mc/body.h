// Builds the body of a request in either code, and extracts numbers from an answer. Only for the
// files of the MC codecs and of the computer link.
#pragma once

#include <optional>
#include <string>

#include "protocol/encoding.h"
#include "protocol/mc/dialect.h"
#include "protocol/value/bytes.h"

namespace fxagent::mc {

/// Returns the size on the wire of a number of `bytes` bytes: the same, or two digits for each.
constexpr std::size_t wire_size(Code code, std::size_t bytes) {
  return code == Code::ascii ? 2 * bytes : bytes;
}

constexpr NumberForm form_of(Code code) {
  return code == Code::ascii ? NumberForm::digits : NumberForm::low_first;
}

/// Returns the number of `bytes` bytes from byte `at` on, both counted in binary code, whatever the
/// code of `wire` is: low byte first, or as digits, highest first. `wire` must contain it. nullopt:
/// not digits.
std::optional<std::uint32_t> number_at(Code code, ByteView wire, std::size_t at, std::size_t bytes);

/// Appends `value` in the form that number_at() reads.
void append_number(Code code, Bytes& out, std::uint32_t value, std::size_t bytes);

/// Appends an image of 16-bit or 32-bit values, low byte first, in its form on the wire.
void append_image(Code code, Bytes& out, ByteView image, std::size_t value_bytes);
/// Converts it back. `wire` must be a whole number of values. Error: bad_frame if it is not digits.
Result<Bytes> image_in(Code code, ByteView wire, std::size_t value_bytes);

/// Appends the first `bits` bits of `image`: two in a byte, the first in the high half; or one
/// character for each.
void append_bits(Code code, Bytes& out, ByteView image, std::uint32_t bits);
/// Converts them back. Error: bad_frame if there is anything but 0 and 1.
Result<Bytes> bits_in(Code code, ByteView wire, std::uint32_t bits);

class Body final {
 public:
  /// `subcommand` is given without the bit for the codes of iQ-R.
  Body(const Dialect& dialect, bool long_codes, std::uint32_t command, std::uint32_t subcommand);

  void number(std::uint32_t value, std::size_t bytes) {
    append_number(dialect_.code, out_, value, bytes);
  }
  /// Appends the device that contains this bit of the space. If it has no name, take() fails.
  void device(std::uint16_t space, std::uint32_t bit);
  Bytes& bytes() { return out_; }
  /// Error: unsupported if this code has no name, no certain digits or no room for the digits of
  /// one of the devices.
  Result<Bytes> take();

 private:
  const Dialect& dialect_;
  bool long_codes_;
  Bytes out_;
  std::string error_;  ///< why the first such device has no name; empty: all have one
};

/// Returns why a request cannot name a device; empty if it can. `long_codes`: those of iQ-R.
std::string why_not_named(const Dialect& dialect, Space space, std::uint32_t number,
                          bool long_codes);

}  // namespace fxagent::mc
