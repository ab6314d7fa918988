// From points to exchanges and back: the reads with the least line time, the writes of a value.
#pragma once

#include <chrono>
#include <cstdint>
#include <span>
#include <vector>

#include "protocol/codec.h"
#include "protocol/point.h"

namespace fxagent {

/// What an exchange costs besides its own characters.
struct LineCost {
  std::chrono::nanoseconds per_char{0};  ///< 10 bits at 9600 baud: 1.0417 ms
  std::chrono::nanoseconds per_exchange{
      0};  ///< the device's own time plus the gap before a request

  std::chrono::nanoseconds of(const LineLength& length) const {
    return per_exchange +
           per_char * (length.request_chars + length.reply_chars + length.closing_chars);
  }
};

/// One read of a plan and the points it brings, by their index in the list given to make_plan().
struct PlannedRead {
  Read read;
  std::vector<std::uint32_t> points;
};

/// Where a point's image comes from: `count` consecutive reads, one unless the point was cut;
/// 0: no way of this model reaches it.
struct PointSource {
  std::uint32_t first_read = 0;
  std::uint32_t count = 0;
};

struct Plan {
  std::vector<PlannedRead> reads;
  std::vector<PointSource> sources;        ///< one for each point given, in their order
  std::vector<std::uint32_t> unreachable;  ///< points that no way of this model reaches
  std::chrono::nanoseconds line_time{0};   ///< all reads, by the cost given
};

/// The reads of `points` with the least total line time under the codec's limits: exact, by dynamic
/// programming over each space. A point lies whole in one read wherever one read can hold it; a
/// longer one (an array) is cut at unit borders and gets consecutive reads. `max_block_bytes`
/// lowers every way's max_bits (0: leaves it).
Plan make_plan(const Codec& codec, std::span<const Point> points, const LineCost& cost,
               std::uint32_t max_block_bytes);

/// The value of point number `index` out of the images of the plan's reads (`images[r]` answers
/// `plan.reads[r]`; those of other reads may be empty). Errors as unpack().
Result<Value> value_of(const Plan& plan, std::span<const Bytes> images, const Point& point,
                       std::size_t index);

/// The orders that write `image` to the point, in the order they are to be sent: one force for a
/// bit, one write where a frame can hold it, else several. bad_request: the codec cannot write this
/// span.
Result<std::vector<Request>> plan_write(const Codec& codec, const Point& point, ByteView image);

}  // namespace fxagent
