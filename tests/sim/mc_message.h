// The commands of 3E, 4E, 3C and 4C, whatever frame carries them: what a request says, in binary or
// ASCII code, and the numbers of an answer.
// Source: MELSEC Communication Protocol Reference Manual SH-080008.
#pragma once

#include <optional>
#include <vector>

#include "tests/sim/bytes.h"
#include "tests/sim/model.h"

namespace fxsim {

enum class McCode : std::uint8_t { binary, ascii };

/// Reads fields one after the other. What is not there or not hexadecimal reads as 0 and is noted.
class McReader final {
 public:
  McReader(ByteView bytes, McCode code) : rest_(bytes), code_(code) {}

  /// A number of `size` bytes: low byte first, or twice as many digits.
  std::uint32_t number(unsigned size);
  /// A number written in digits of `base`; leading zeros may be blanks. ASCII only.
  std::uint32_t digits(unsigned count, unsigned base);
  /// As they are: `count` bytes or characters.
  ByteView raw(std::size_t count);
  /// `count` points: a nibble each, the first one high, or a character each. Values 0 to 15.
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

/// The opposite: a number of `size` bytes behind `out`.
void append_mc(Bytes& out, McCode code, std::uint32_t value, unsigned size);
void append_mc_points(Bytes& out, McCode code, const std::vector<std::uint32_t>& points);

/// Devices in a row, or one of those picked out.
struct McAccess {
  std::optional<Kind> kind;  // none: the PLC knows no such device
  std::uint32_t number = 0;
  unsigned points = 1;                // of the unit of the command
  bool is_double = false;             // of a random access
  bool is_bit_block = false;          // of blocks
  std::vector<std::uint32_t> values;  // of a write: a point, a word or a double word each
};

struct McRequest {
  enum class Shape : std::uint8_t {
    whole,
    cut_off,     // more would have to come
    excess,      // more came
    unreadable,  // ASCII that is no number
    unknown,     // no such command or subcommand
  };

  std::uint16_t command = 0;
  std::uint16_t subcommand = 0;
  Shape shape = Shape::whole;
  std::size_t used = 0;  // bytes that belong to it, as far as its shape tells
  std::vector<McAccess> accesses;
  unsigned words = 0;    // of a random access, or word blocks
  unsigned doubles = 0;  // of a random access, or bit blocks
  std::uint32_t mode = 0;
  std::uint32_t clear_mode = 0;
  Bytes text;  // of a loopback
};

/// `body` begins with the command.
McRequest read_mc_request(ByteView body, McCode code, Family family);

}  // namespace fxsim
