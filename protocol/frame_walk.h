// Explains frames for Codec::explain(). A protocol lists the fields of each kind of frame in a
// table, and FrameWalk reads a frame along it and shows them. The protocol's own class, derived
// from FrameWalk, reads the fields that no other protocol has. device_walk.h has those of protocols
// that name devices in their requests.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "protocol/codec.h"
#include "protocol/encoding.h"
#include "protocol/value/bytes.h"

namespace fxagent {

/// True if all of `wire` is ASCII text without control characters.
bool is_printable(ByteView wire);
/// Returns data as they are if they are text, otherwise "02 30 03".
std::string data_text(NumberForm form, ByteView data);

/// Returns a good explanation without fields, of a request unless `direction` says otherwise.
Explanation begin_explanation(std::optional<Direction> direction);
/// Makes the explanation bad, and returns it. The first error is kept.
Explanation& wrong(Explanation& out, std::string error);
/// Fills in both sums. They must be equal; lower case is accepted.
Explanation& judge_sum(Explanation& out, std::string given, std::uint8_t computed);
/// Appends the numbers in `data` as values, each of `digits` hex digits. Bit devices get the bits
/// of each number instead, lowest first. Of 8 digits in bytes the low word comes first.
void add_values(Explanation& out, NumberForm form, ByteView data, std::size_t digits,
                std::uint32_t device_bits = 16);
/// Appends `count` bits of one digit each as values. False, and no values, if one is not 0 or 1.
/// `data` must be long enough.
bool add_bits(Explanation& out, NumberForm form, ByteView data, std::size_t count);

class FrameWalk;

/// A field of a frame. `read` reads and shows it. `digits` is its width in hex digits, two a byte;
/// 0 if the width is not fixed.
struct Field {
  void (*read)(FrameWalk&, const Field&) = nullptr;
  std::string_view name;
  std::size_t digits = 0;
};

template <class Walk>
void read_field(void (Walk::*reader)(const Field&), FrameWalk& walk, const Field& field) {
  (static_cast<Walk&>(walk).*reader)(field);
}
/// Returns a field for the tables of a walk. `reader` is a function of its class or of FrameWalk.
template <auto reader>
constexpr Field read_by(std::string_view name, std::size_t digits = 0) {
  return {[](FrameWalk& walk, const Field& field) { read_field(reader, walk, field); }, name,
          digits};
}

/// The fields of one kind of frame, in the order of the wire. The last ones may be unused.
using Fields = std::array<Field, 6>;

/// Reads a frame from the front. Reads and shows nothing more after the first fault.
class FrameWalk {
 public:
  FrameWalk(Explanation& out, NumberForm form, ByteView frame)
      : out_(out), form_(form), left_(frame) {}
  virtual ~FrameWalk() = default;

  /// Reads the fields of a table.
  void walk(const Fields& fields);

  // Fields of any frame. rest() is everything that is left.
  void decimal(const Field& field) { show(field.name, std::to_string(number(field))); }
  void hex(const Field& field);
  void rest(const Field& field);

 protected:
  /// Returns the error if the frame ends before `what`.
  virtual std::string cut_before(std::string_view what) const;

  bool is_text() const { return form_ == NumberForm::digits; }
  bool good() const { return out_.ok; }
  void fault(std::string error) { wrong(out_, std::move(error)); }
  void show(std::string_view name, std::string_view text);

  /// Returns the digits that are left.
  std::size_t left() const { return is_text() ? left_.size() : 2 * left_.size(); }
  /// Takes digits from the front; empty, with a fault, if there are fewer.
  ByteView take(std::size_t digits, std::string_view what);
  /// Takes a number; 0, with a fault, if there is none.
  std::uint32_t number(std::size_t digits, std::string_view what);
  std::uint32_t number(const Field& field);

  Explanation& out_;
  NumberForm form_;
  ByteView left_;
};

}  // namespace fxagent
