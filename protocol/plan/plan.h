// Plans the reads of points with the least time on the line, and extracts the values from their
// answers. Also plans the writes of a value. Pure; any thread.
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "protocol/codec.h"
#include "protocol/plan/holes.h"
#include "protocol/value/point.h"
#include "protocol/value/value.h"

namespace fxagent {

/// Line time of an exchange: its characters, and a part that every exchange has.
struct LineCost {
  std::chrono::nanoseconds per_char{0};  ///< 10 bits at 9600 baud: 1.0417 ms
  /// The device's own time plus the gap before a request.
  std::chrono::nanoseconds per_exchange{0};

  std::chrono::nanoseconds of(const LineLength& length) const {
    return per_exchange + per_char * length.planned_chars();
  }
};

struct PlannedRead {
  Read read;
  std::vector<std::uint32_t> points;  ///< in it, wholly or in part
};

/// The consecutive reads that hold a point's image.
struct PointSource {
  std::uint32_t first_read = 0;
  std::uint32_t count = 0;  ///< 1 unless the point was split; 0 if no read holds it
};

/// Reads that one exchange returns, by their index in Plan::reads. Valid as long as the plan, or
/// the index, that it views.
using ReadIndices = std::span<const std::uint32_t>;

/// A point is named by its index in the list given to make_plan().
struct Plan {
  std::vector<PlannedRead> reads;
  /// Exchanges in the order of sending: a read sent alone, or the parts of a Gather, as ascending
  /// indices in `reads`, never none.
  std::vector<std::vector<std::uint32_t>> exchanges;
  std::vector<PointSource> sources;        ///< by point
  std::vector<std::uint32_t> unreachable;  ///< points that no way of this model can read
  std::vector<std::uint32_t> refused;      ///< points for which the device's holes leave no read
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

/// Extracts the image of point number `index`, with its first bit at bit 0. `images[r]` answers
/// `plan.reads[r]`; images of reads that do not hold the point may be empty. Error: unsupported if
/// not all of the point was read.
Result<Bytes> image_of(const Plan& plan, std::span<const Bytes> images, const Point& point,
                       std::size_t index);

/// Returns the value of point number `index`. Errors as image_of() and unpack().
Result<Value> value_of(const Plan& plan, std::span<const Bytes> images, const Point& point,
                       std::size_t index);

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

/// Returns the requests that write `image` to the point, in sending order: one force for a bit; one
/// write if a frame can hold it and no border lies inside; otherwise several. Error: bad_request if
/// the codec cannot write this span.
Result<std::vector<Request>> plan_write(const Codec& codec, const Point& point, ByteView image);

}  // namespace fxagent
