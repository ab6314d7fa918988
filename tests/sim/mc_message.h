// The commands of 3E, 4E, 3C and 4C, independent of the frame that carries them: requests in binary
// or ASCII code, and the numbers of a reply.
// Source: MELSEC Communication Protocol Reference Manual SH-080008.
#pragma once

#include <optional>
#include <vector>

#include "tests/sim/bytes.h"
#include "tests/sim/model.h"

namespace fxsim {

enum class McCode : std::uint8_t { binary, ascii };

/// Reads fields one after another. A field that is missing or not hexadecimal reads as 0 and is
/// recorded.
class McReader final {
 public:
  McReader(ByteView bytes, McCode code) : rest_(bytes), code_(code) {}

  /// Reads a number of `size` bytes, low byte first, or of twice as many digits.
  std::uint32_t number(unsigned size);
  /// Reads a number of `count` digits in `base`; leading zeros may be blanks. ASCII only.
  std::uint32_t digits(unsigned count, unsigned base);
  /// Returns `count` bytes or characters unchanged.
  ByteView raw(std::size_t count);
  /// Reads `count` points with values 0 to 15: a nibble each (high nibble first), or a character
  /// each.
  std::vector<std::uint32_t> points(unsigned count);

  McCode code() const { return code_; }
  std::size_t left() const { return rest_.size(); }
  bool cut_off() const { return cut_off_; }
  bool unreadable() const { return unreadable_; }

 private:
  std::uint32_t numeral(unsigned count, unsigned base, bool blanks);

  ByteView rest_;
  McCode code_;
  bool cut_off_ = false;
  bool unreadable_ = false;
};

/// Appends a number of `size` bytes to `out`, as McReader::number() reads it.
void append_mc(Bytes& out, McCode code, std::uint32_t value, unsigned size);
void append_mc_points(Bytes& out, McCode code, const std::vector<std::uint32_t>& points);

/// A row of consecutive devices, or one device of a random access.
struct McAccess {
  std::optional<Kind> kind;  // nullopt: the PLC does not know the device
  std::uint32_t number = 0;
  unsigned points = 1;                // in the unit of the command
  bool is_double = false;             // random access only
  bool is_bit_block = false;          // block access only
  std::vector<std::uint32_t> values;  // write only: a point, a word or a double word each
};

struct McRequest {
  enum class Shape : std::uint8_t {
    whole,
    cut_off,     // data missing at the end
    excess,      // extra data at the end
    unreadable,  // ASCII that is not a number
    unknown,     // no such command or subcommand
  };

  std::uint16_t command = 0;
  std::uint16_t subcommand = 0;
  Shape shape = Shape::whole;
  std::size_t used = 0;  // bytes that belong to it, as far as its shape shows
  std::vector<McAccess> accesses;
  unsigned words = 0;    // random access: words; block access: word blocks
  unsigned doubles = 0;  // random access: double words; block access: bit blocks
  std::uint32_t mode = 0;
  std::uint32_t clear_mode = 0;
  Bytes text;  // loopback only
};

/// Parses a request. `body` begins with the command.
McRequest read_mc_request(ByteView body, McCode code, Family family);

}  // namespace fxsim
