// Plans exchanges for points, and extracts values from their answers: the reads with the least line
// time, and the writes of a value.
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "protocol/codec.h"
#include "protocol/value/point.h"
#include "protocol/value/value.h"

namespace fxagent {

/// Cost of an exchange besides its own characters.
struct LineCost {
  std::chrono::nanoseconds per_char{0};  ///< 10 bits at 9600 baud: 1.0417 ms
  /// The device's own time plus the gap before a request.
  std::chrono::nanoseconds per_exchange{0};

  std::chrono::nanoseconds of(const LineLength& length) const {
    return per_exchange + per_char * length.planned_chars();
  }
};

/// Time that a device and its line add to the characters of an exchange.
struct LineTiming {
  std::chrono::nanoseconds char_time{0};
  std::chrono::nanoseconds gap{0};         ///< silence before a request, from the config
  std::chrono::nanoseconds turnaround{0};  ///< the device's own time
  bool enquires_always = false;            ///< an enquiry precedes each request
};
/// Returns the longest line time of one successful exchange, whatever its values, counted from the
/// end of the previous exchange. Includes the enquiry if `enquires_always`.
std::chrono::nanoseconds exchange_time(const Codec& codec, const Request& request,
                                       const LineTiming& timing);

/// One read of a plan and the points in it, by their index in the list given to make_plan().
struct PlannedRead {
  Read read;
  std::vector<std::uint32_t> points;
};

/// The reads that hold a point's image: `count` consecutive ones. 1 unless the point was split; 0
/// if no read holds it.
struct PointSource {
  std::uint32_t first_read = 0;
  std::uint32_t count = 0;
};

/// Places and lengths that a device refuses although its documents allow them.
struct Holes {
  /// No read may contain bits of `space` on both sides of `at`.
  struct Cut {
    std::uint16_t space = 0;
    std::uint32_t at = 0;
    friend bool operator==(const Cut&, const Cut&) = default;
  };
  /// No read of `space` may be longer than `bits`.
  struct Limit {
    std::uint16_t space = 0;
    std::uint32_t bits = 0;
    friend bool operator==(const Limit&, const Limit&) = default;
  };
  /// No Gather by this command may have more parts than `parts`. 0: the device lacks the command.
  struct GatherLimit {
    std::uint8_t gather = 0;
    std::uint32_t parts = 0;
    friend bool operator==(const GatherLimit&, const GatherLimit&) = default;
  };
  std::vector<Cut> cuts;
  std::vector<Limit> limits;
  std::vector<Span> missing;  ///< no read may contain the whole of one of these
  std::vector<GatherLimit> gather_limits;
  std::vector<Span> apart;  ///< no Gather may touch one of these
  /// A Gather that touches one of these consists only of such parts, at most `most_suspects`: one
  /// of them may be refused and cause the others to fail.
  std::vector<Span> suspects;
  std::uint32_t most_suspects = 1;
  /// Largest number of parts of any other Gather, in a plan that reads a suspect. Other plans have
  /// no such limit: the suspects may belong to a group that is read once an hour.
  std::uint32_t most_others = 0xFFFFFFFF;
};

/// Reads that one exchange returns, by their index in Plan::reads. Valid as long as the plan, or
/// the index, that it views.
using ReadIndices = std::span<const std::uint32_t>;

struct Plan {
  std::vector<PlannedRead> reads;
  /// Exchanges in the order of sending: a read sent alone, or the parts of a Gather, as ascending
  /// indices in `reads`, never none.
  std::vector<std::vector<std::uint32_t>> exchanges;
  std::vector<PointSource> sources;        ///< one for each given point, in the same order
  std::vector<std::uint32_t> unreachable;  ///< points that no way of this model can read
  std::vector<std::uint32_t> refused;      ///< points that the device's holes leave no read for
  std::chrono::nanoseconds line_time{0};   ///< of all exchanges, by the given cost
  /// Processor cost of the search: reads weighed, and frames checked for room. In proportion to the
  /// number of points.
  std::size_t weighed = 0;

  std::uint32_t exchange_count() const { return static_cast<std::uint32_t>(exchanges.size()); }
  /// Returns the request for these reads: all of one exchange, or any single read.
  Request request(ReadIndices which) const;
  /// Splits the image that answered request() into those of its reads. `images` has one entry for
  /// each of `reads`.
  void share_out(ReadIndices which, Bytes image, std::span<Bytes> images) const;
};

/// Returns the reads of `points` with the least total line time under the codec's limits. Exact, by
/// dynamic programming over each space. If the protocol can read several places in one frame, reads
/// are combined where that is cheaper; gathering.h states how exact that is.
///
/// A point lies whole in one read if one read can hold it. A longer one (an array) is split at unit
/// borders into consecutive reads, and so is a point across a border of its space
/// (AddressSpace::borders()). If answers carry no numbers, neighbouring exchanges have answers of
/// different length where the lengths allow it. `max_block_bytes` lowers max_bits of every way (0:
/// no change). The plan contains no read that `holes` forbid.
Plan make_plan(const Codec& codec, std::span<const Point> points, const LineCost& cost,
               std::uint32_t max_block_bytes, const Holes& holes = {});

/// Returns the parts of `points` that these reads of `plan` return, sorted by space and place.
/// Leaves out the gaps that no point covers.
std::vector<Span> asked_in(const Plan& plan, ReadIndices which, std::span<const Point> points);

/// Two reads that replace one: [its first bit, left_end) and [right_first, its end).
struct Halves {
  std::uint32_t left_end = 0;
  std::uint32_t right_first = 0;  ///< above left_end if no point needs the bits between
  friend bool operator==(const Halves&, const Halves&) = default;
};
/// Returns the split of `planned` nearest to its middle that cuts no element of its points. nullopt
/// if its way cannot read less.
std::optional<Halves> halves_of(const Codec& codec, std::span<const Point> points,
                                const PlannedRead& planned);

/// Extracts the image of point number `index`, with its first bit at bit 0. `images[r]` answers
/// `plan.reads[r]`; images of reads that do not hold the point may be empty. Error: unsupported if
/// not all of the point was read.
Result<Bytes> image_of(const Plan& plan, std::span<const Bytes> images, const Point& point,
                       std::size_t index);

/// Returns the value of point number `index`. Errors as image_of() and unpack().
Result<Value> value_of(const Plan& plan, std::span<const Bytes> images, const Point& point,
                       std::size_t index);

/// Returns the requests that write `image` to the point, in sending order: one force for a bit; one
/// write if a frame can hold it and no border lies inside; otherwise several. Error: bad_request if
/// the codec cannot write this span.
Result<std::vector<Request>> plan_write(const Codec& codec, const Point& point, ByteView image);

}  // namespace fxagent
