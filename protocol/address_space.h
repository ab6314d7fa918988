// What a protocol says about the memory of its devices: how places are named, which of them exist,
// what is read together, and what may be written. No frame is made here; the frames are codec.h.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "protocol/point.h"
#include "protocol/result.h"

namespace fxagent {

/// A command that reads several places by one frame (random read, blocks): what a Gather of one
/// frame may hold. Its parts are reads by the ways that name it, of any spaces.
struct GatherCommand {
  std::uint8_t gather = 1;  ///< ReadWay::gather of these ways; above 0
  std::uint32_t max_parts = 1;
  std::uint32_t max_bits = 0xFFFFFFFF;  ///< of all parts together
};

/// One way to read part of a space. A read by it starts at a multiple of `align_bits` from the
/// space's start, is a multiple of `unit_bits` long, at most `max_bits`, inside [first_bit,
/// end_bit). All lengths are in bits of the image.
struct ReadWay {
  std::uint8_t way = 0;  ///< goes into Read::way
  std::uint8_t tier =
      0;  ///< a point takes a way of the lowest tier that reaches it; tiers never mix
  std::uint32_t first_bit = 0;
  std::uint32_t end_bit = 0;
  std::uint32_t align_bits = 8;
  std::uint32_t unit_bits = 8;
  std::uint32_t max_bits = 512;
  std::uint32_t max_gap_bits =
      0xFFFFFFFF;  ///< bits that nobody asked for, at most so many in a row
  /// 0: a read by this way is an exchange of its own. Else it is sent in a Gather, by the
  /// GatherCommand of this number, if need be as its only part; the limits above are those of one
  /// part. Random read of words and double words: unit_bits 16, max_bits 32; blocks: as many as a
  /// block may have. Such a way has a number `way` of its own, too.
  std::uint8_t gather = 0;
};

/// The devices that a codec reaches, cut into spaces (point.h). Got from Codec::addresses() and
/// valid as long as that codec. Which devices exist is in the manual of the series and, for the
/// part that a protocol reaches, in that of the protocol: protocol/README.md names both.
class AddressSpace {
 public:
  virtual ~AddressSpace() = default;

  // Names and ranges.

  /// Reads an address as the engineer writes it. `type` decides where a name has two meanings
  /// (T5: contact as bool, else value); without it such a name means the value.
  /// bad_request: not a name of this protocol, or a number the model lacks; the text says which
  /// range is right.
  virtual Result<Address> parse_address(std::string_view text,
                                        std::optional<DataType> type) const = 0;
  /// True where `text` needs a type to be told apart in a command (T5, C5).
  virtual bool needs_type(std::string_view text) const = 0;
  /// A range for an allow list: "M100-M199", "M100..M199" or one device. bad_request as
  /// parse_address; the ends are of two kinds; T or C without N or S; or it holds what is never
  /// written (M8034-M8037, M8118).
  virtual Result<Span> parse_range(std::string_view text) const = 0;
  /// The device's words for `span`'s first device ("D100"). Any span has a name, also one that this
  /// model lacks.
  virtual std::string name_of(const Span& span) const = 0;
  /// Whether every device of `span` exists in this model; bad_request names the first that does
  /// not.
  virtual Result<void> check_range(const Span& span) const = 0;
  /// How the four bytes of a 32-bit value lie where neither tag nor command says so.
  virtual ByteOrder default_order() const = 0;

  // What is read together, and what may be written.

  /// The space's ways, best first. Empty where this model has no such space.
  virtual std::vector<ReadWay> read_ways(std::uint16_t space) const = 0;
  /// The commands that read several places by one frame. Empty where the protocol or this model has
  /// none; then no way names one, and the planner does not look for what could go together.
  virtual std::vector<GatherCommand> gathers() const { return {}; }
  /// Bits of the space that no read and no write may lie on both sides of, although all of it
  /// exists: the devices from there on may lie elsewhere.
  virtual std::vector<std::uint32_t> borders(std::uint16_t /*space*/) const { return {}; }
  /// Whether `span` may be written at all and in this shape: bad_request where it would overwrite
  /// bits beside it (half bytes), or touches what is never written (M8034-M8037, M8118: they switch
  /// RUN and STOP or open the program memory).
  virtual Result<void> check_write(const Span& span) const = 0;
  /// The most bits of `space` that one Write may carry; 0 where nothing of it is written.
  virtual std::uint32_t max_write_bits(std::uint16_t space) const = 0;
};

}  // namespace fxagent
