// From points to exchanges and back: the reads with the least line time, the writes of a value.
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
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
    return per_exchange + per_char * length.planned_chars();
  }
};

/// What a device and its line add to the characters of an exchange.
struct LineTiming {
  std::chrono::nanoseconds char_time{0};
  std::chrono::nanoseconds gap{0};         ///< silence that the config asks for before a request
  std::chrono::nanoseconds turnaround{0};  ///< the device's own time
  bool enquires_always = false;            ///< an enquiry goes before each request
};
/// Line time of one exchange that ends well, from the end of the one before it, at the most:
/// whatever the values are.
std::chrono::nanoseconds exchange_time(const Codec& codec, const Request& request,
                                       const LineTiming& timing);

/// One read of a plan and the points it brings, by their index in the list given to make_plan().
struct PlannedRead {
  Read read;
  std::vector<std::uint32_t> points;
};

/// Where a point's image comes from: `count` consecutive reads, one unless the point was cut;
/// 0: there is no read for it.
struct PointSource {
  std::uint32_t first_read = 0;
  std::uint32_t count = 0;
};

/// What a device was found to refuse, although its documents allow it.
struct Holes {
  /// No read may hold bits of `space` on both sides of `at`.
  struct Cut {
    std::uint16_t space = 0;
    std::uint32_t at = 0;
    friend bool operator==(const Cut&, const Cut&) = default;
  };
  /// No read of `space` may be longer.
  struct Limit {
    std::uint16_t space = 0;
    std::uint32_t bits = 0;
    friend bool operator==(const Limit&, const Limit&) = default;
  };
  /// No Gather by the command may have more parts; 0: the device lacks it.
  struct GatherLimit {
    std::uint8_t gather = 0;
    std::uint32_t parts = 0;
    friend bool operator==(const GatherLimit&, const GatherLimit&) = default;
  };
  std::vector<Cut> cuts;
  std::vector<Limit> limits;
  std::vector<Span> missing;  ///< no read may hold the whole of one of these
  std::vector<GatherLimit> gather_limits;
  std::vector<Span> apart;  ///< no Gather may touch one of these
  /// A Gather that touches one of these holds such parts only, and at most `most_suspects`: one of
  /// them may be refused and take others with it.
  std::vector<Span> suspects;
  std::uint32_t most_suspects = 1;
  /// Parts of any other Gather, in a plan that is to read a suspect. Other plans are not held down:
  /// their suspects may be read in an hour, and what is too much for them they find by themselves.
  std::uint32_t most_others = 0xFFFFFFFF;

  /// Whether a read of `span` is known to be refused.
  bool forbid(const Span& span) const;
};

/// Reads of a plan that one exchange brings, by their index in Plan::reads. Valid as long as it.
class ReadIndices final {
 public:
  explicit ReadIndices(std::uint32_t only) : only_(only) {}
  explicit ReadIndices(std::span<const std::uint32_t> several) : several_(several) {}
  std::size_t size() const { return several_.empty() ? 1 : several_.size(); }
  std::uint32_t operator[](std::size_t i) const { return several_.empty() ? only_ : several_[i]; }

 private:
  std::uint32_t only_ = 0;
  std::span<const std::uint32_t> several_;  ///< empty: `only_`
};

/// One exchange of a plan: a read by itself, or the parts of a Gather.
struct PlannedExchange {
  std::vector<std::uint32_t> reads;  ///< indices in Plan::reads, rising; never empty
};

struct Plan {
  std::vector<PlannedRead> reads;
  /// What is sent, in order. Empty where nothing goes together: then each read is an exchange.
  std::vector<PlannedExchange> exchanges;
  std::vector<PointSource> sources;        ///< one for each point given, in their order
  std::vector<std::uint32_t> unreachable;  ///< points that no way of this model reaches
  std::vector<std::uint32_t> refused;      ///< points that the device's holes leave no read for
  std::chrono::nanoseconds line_time{0};   ///< all exchanges, by the cost given
  /// What the search took of the processor: reads that it has weighed, and frames that it has
  /// looked into for room. Some for each point, however many there are.
  std::size_t weighed = 0;

  std::uint32_t exchange_count() const {
    return static_cast<std::uint32_t>(exchanges.empty() ? reads.size() : exchanges.size());
  }
  /// The reads of an exchange below exchange_count().
  ReadIndices reads_in(std::uint32_t exchange) const {
    return exchanges.empty() ? ReadIndices(exchange) : ReadIndices(exchanges[exchange].reads);
  }
  /// What brings these reads: those of an exchange, or any one of them by itself.
  Request request(const ReadIndices& which) const;
  /// Gives each of these reads its own out of the image that answered request(); `images` has one
  /// for each of `reads`.
  void share_out(const ReadIndices& which, Bytes image, std::span<Bytes> images) const;
};

/// The reads of `points` with the least total line time under the codec's limits: exact, by dynamic
/// programming over each space. Where the protocol can read several places by one frame, what is
/// best sent so is (gathering.h: how exact that is). A point lies whole in one read wherever one
/// read can hold it; a longer one (an array) is cut at unit borders and gets consecutive reads, as
/// does one that lies across a border of its space (AddressSpace::borders()). `max_block_bytes`
/// lowers every way's max_bits (0: leaves it). No read is one that `holes` forbid.
Plan make_plan(const Codec& codec, std::span<const Point> points, const LineCost& cost,
               std::uint32_t max_block_bytes, const Holes& holes = {});

/// What of `points` these reads of `plan` bring, by space and place, without what nobody asked for.
std::vector<Span> asked_in(const Plan& plan, const ReadIndices& which,
                           std::span<const Point> points);

/// Two reads in place of one: [its first bit, left_end) and [right_first, its end).
struct Halves {
  std::uint32_t left_end = 0;
  std::uint32_t right_first = 0;  ///< more than left_end where nobody asked for what is between
  friend bool operator==(const Halves&, const Halves&) = default;
};
/// How `planned` can be cut nearest to its middle without tearing an element of its points; nullopt
/// where its way cannot read less.
std::optional<Halves> halves_of(const Codec& codec, std::span<const Point> points,
                                const PlannedRead& planned);

/// The image of point number `index` out of the images of the plan's reads (`images[r]` answers
/// `plan.reads[r]`; those of other reads may be empty), its first bit at bit 0. unsupported: not
/// all of it was read.
Result<Bytes> image_of(const Plan& plan, std::span<const Bytes> images, const Point& point,
                       std::size_t index);

/// The value of point number `index`, as image_of() brings it. Errors as image_of() and unpack().
Result<Value> value_of(const Plan& plan, std::span<const Bytes> images, const Point& point,
                       std::size_t index);

/// The requests that write `image` to the point, as they are to be sent: one force for a bit, one
/// write where a frame can hold it and no border lies inside, else several. bad_request: the codec
/// cannot write this span.
Result<std::vector<Request>> plan_write(const Codec& codec, const Point& point, ByteView image);

}  // namespace fxagent
