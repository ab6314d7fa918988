// The memory of a protocol's devices: names and ranges, reads, and writable places. It builds no
// frames; codec.h does.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "protocol/value/point.h"
#include "protocol/value/result.h"

namespace fxagent {

/// A command that reads several places in one frame (random read, blocks), and the limits of that
/// frame. Its parts may be reads of different spaces.
struct GatherCommand {
  std::uint8_t gather = 1;  ///< number of the command, above 0
  std::uint32_t max_parts = 1;
  std::uint32_t max_bits = 0xFFFFFFFF;  ///< all parts together
};

/// One way to read part of a space: a command, and the reads that it can do. Such a read starts at
/// a multiple of `align_bits` from the start of the space and lies inside [first_bit, end_bit). Its
/// length is a multiple of `unit_bits`, at most `max_bits`. All lengths are in bits of the image.
struct ReadWay {
  std::uint8_t way = 0;  ///< number of this way, copied to Read::way
  /// A point is read by the lowest tier that reaches it. No read serves points of two tiers.
  std::uint8_t tier = 0;
  std::uint32_t first_bit = 0;
  std::uint32_t end_bit = 0;
  std::uint32_t align_bits = 8;
  std::uint32_t unit_bits = 8;
  std::uint32_t max_bits = 512;
  std::uint32_t max_gap_bits = 0xFFFFFFFF;  ///< longest run of unrequested bits inside a read
  /// 0: a read by this way is an exchange of its own. Otherwise it is a part of a Gather by the
  /// GatherCommand of this number, if need be the only part, and the limits above are those of a
  /// part: the size of a block, or of a random read unit_bits 16 and max_bits 32 (double word).
  /// Such a way has a `way` number of its own.
  std::uint8_t gather = 0;
};

/// The devices that a codec reaches, divided into spaces (value/span.h). Returned by
/// Codec::addresses() and valid as long as that codec. The manual of the series lists the devices
/// that exist; the manual of the protocol lists those that it reaches. protocol/README.md names
/// both.
class AddressSpace {
 public:
  virtual ~AddressSpace() = default;

  // Names and ranges.

  /// Parses an address as the engineer writes it. `type` decides if a name has two meanings (T5:
  /// the contact as bool, otherwise the value). Without a type such a name means the value. Error:
  /// bad_request if the name is unknown to this protocol or the model lacks the number; the text
  /// states the valid range.
  virtual Result<Address> parse_address(std::string_view text,
                                        std::optional<DataType> type) const = 0;
  /// True if a command must give a type with `text` to make it unambiguous (T5, ST5, C5, LC5).
  virtual bool needs_type(std::string_view /*text*/) const { return false; }
  /// Parses a range of an allow list: "M100-M199", "M100..M199" or one device. Error: bad_request
  /// as parse_address(), and if the ends are of two kinds, if T, ST, C or LC lacks its N, S or C,
  /// or if the range includes a device that is never written (M8034-M8037, M8118, SM8034-SM8037).
  virtual Result<Span> parse_range(std::string_view text) const = 0;
  /// Returns the device's name for the first device of `span` ("D100"). Every span has a name, even
  /// if this model lacks it.
  virtual std::string name_of(const Span& span) const = 0;
  /// Checks that every device of `span` exists in this model. Error: bad_request names the first
  /// that does not.
  virtual Result<void> check_range(const Span& span) const = 0;
  /// Returns the byte order of a 32-bit value for which neither tag nor command gives one. `cdab`
  /// is the order of all Mitsubishi PLCs.
  virtual ByteOrder default_order() const { return ByteOrder::cdab; }

  // Reads and writes.

  /// Returns the ways to read the space, best first. Empty if this model has no such space.
  virtual std::vector<ReadWay> read_ways(std::uint16_t space) const = 0;
  /// Returns the commands that read several places in one frame. Empty if the protocol or this
  /// model has none: then no way names one, and the planner does not try to combine reads.
  virtual std::vector<GatherCommand> gathers() const { return {}; }
  /// Returns the bits at which reads and writes of the space must be split although all of it
  /// exists. Devices from such a bit on may be stored elsewhere.
  virtual std::vector<std::uint32_t> borders(std::uint16_t /*space*/) const { return {}; }
  /// Checks that `span` may be written, in this shape. Error: bad_request if the write would
  /// overwrite neighbouring bits (half bytes), or if it touches a device that is never written
  /// (M8034-M8037, M8118: they switch RUN and STOP or open the program memory).
  virtual Result<void> check_write(const Span& span) const = 0;
  /// Returns the largest number of bits of `space` in one Write; 0 if the space cannot be written.
  virtual std::uint32_t max_write_bits(std::uint16_t space) const = 0;
};

/// Returns the first and the last device of `span`, "D100 to D103"; of a single device "D100".
inline std::string names_of(const AddressSpace& addresses, const Span& span) {
  const std::string first = addresses.name_of({span.space, span.first_bit, 1});
  const std::string last = addresses.name_of({span.space, span.end_bit() - 1, 1});
  return first == last ? first : first + " to " + last;
}

}  // namespace fxagent
