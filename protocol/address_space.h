// The device memory behind a codec: names of its places, and the limits of reads and writes. Builds
// no frames; codec.h does.
//
// Each kind of memory is a space, a run of bits with a number (value/span.h). A name stands for a
// Span of a space, so everything above the codecs treats D100 of a PLC and the register hr:100 of a
// Modbus device alike. With the codec of an FX3U:
//
//   parse_address("D100", …)   16 bits from bit 1600 of the space of D
//   parse_range("D100-D199")   1600 bits from there
//   name_of(…)                 "D100" for either span
//   read_ways(…)               the commands that read D, with the limits of each
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "protocol/read_way.h"
#include "protocol/value/point.h"
#include "protocol/value/result.h"

namespace fxagent {

/// Returned by Codec::addresses() and valid as long as that codec. Const and without state; any
/// thread. Sources: the manual of the series lists the devices that exist, the manual of the
/// protocol those that it reaches. protocol/README.md names both.
class AddressSpace {
 public:
  virtual ~AddressSpace() = default;

  // ---- from a name to its place, and back

  /// Returns the place that `text` names: "D100", "X17", "K4M0". `type` decides between two
  /// meanings of a name: T5 is the contact as bool, otherwise the value, also without a type.
  /// Error: bad_request if this protocol has no such name, or if the model lacks the device; the
  /// text states the valid range.
  virtual Result<Address> parse_address(std::string_view text,
                                        std::optional<DataType> type) const = 0;
  /// True for a name with two meanings (T5, ST5, C5, LC5). A command that uses it must give a type.
  virtual bool needs_type(std::string_view /*text*/) const { return false; }
  /// Returns the place of a range as in allow lists: "M100-M199", "M100..M199" or one device.
  /// Error: bad_request as parse_address(); if the ends are of two kinds; if T, ST, C or LC lacks
  /// its N, S or C; or if the range includes a device that is never written (check_write()).
  virtual Result<Span> parse_range(std::string_view text) const = 0;
  /// Returns the name of the first device of `span`: "D100". It has one even if this model lacks
  /// the device.
  virtual std::string name_of(const Span& span) const = 0;
  /// Checks that this model has every device of `span`. Error: bad_request names the first that it
  /// lacks.
  virtual Result<void> check_range(const Span& span) const = 0;

  // ---- reads

  /// Returns the ways to read the space, best first. Empty if this model has no such space.
  virtual std::vector<ReadWay> read_ways(std::uint16_t space) const = 0;
  /// Returns the commands that read several places in one frame. Empty if the protocol or this
  /// model has none; then no way names one.
  virtual std::vector<GatherCommand> gathers() const { return {}; }
  /// Returns the bits of the space at which a frame must end and the next one begin, although both
  /// sides exist: a device may store them in different places.
  virtual std::vector<std::uint32_t> borders(std::uint16_t /*space*/) const { return {}; }
  /// Returns the byte order of a 32-bit value for which neither tag nor command gives one. `cdab`
  /// is the order of all Mitsubishi PLCs.
  virtual ByteOrder default_order() const { return ByteOrder::cdab; }

  // ---- writes

  /// Checks that `span` may be written. Error: bad_request if a frame would also overwrite
  /// neighbouring bits (part of a byte or word), or if the span touches a device that is never
  /// written: M8034-M8037, M8118 and SM8034-SM8037 switch RUN and STOP or all outputs, or open the
  /// program memory.
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
