// The reads of one poll cycle and their answers: the image of each, or the reason why it has none.
// Knows which images commands have outdated since. Pure. Field thread.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "agent/field/bus/exchange.h"
#include "agent/handover/telemetry.h"
#include "protocol/plan/plan.h"

namespace fxagent {

class CycleReads final {
 public:
  const Plan& plan() const { return plan_; }
  /// Sets the plan of the cycles from the next begin() on.
  void use(Plan plan) { plan_ = std::move(plan); }
  /// Begins a cycle: discards all answers.
  void begin();

  /// Takes the result of the exchange for these reads of plan(), sent as plan().request(). Moves
  /// the image out of it.
  void take(ReadIndices reads, Exchange& exchange);
  /// Marks everything not read yet as bad for this reason.
  void give_up(BadReason why);
  void discard_images();

  /// Returns the indices in the plan's points of the points of these reads, in ascending order.
  std::vector<std::uint32_t> points_of(ReadIndices reads) const;
  /// Splits these reads, at least two in one exchange, into halves for the rest of this cycle. The
  /// halves come after the exchanges of plan().
  void read_halves(ReadIndices reads);
  /// Reads these points of the plan by `part` for the rest of this cycle. `part` is a plan of them
  /// alone; its exchanges come after those of plan(). A read of the same place as an earlier one
  /// already has its image: see has_images().
  void read_instead(const std::vector<std::uint32_t>& points, Plan part);
  /// True if this cycle has the images of all these reads.
  bool has_images(ReadIndices reads) const;

  /// Records that a command has written `span`, or may have. With `image`, which covers the span,
  /// the images take it over. Without, those that overlap the span are outdated.
  void overwritten(const Span& span, const Bytes* image);
  /// Returns the read to repeat before any other, because a command may have changed its data. Each
  /// is repeated at most once in a cycle, so that a flood of commands cannot keep the cycle from
  /// ending.
  std::optional<std::uint32_t> outdated() const;

  // Of a point, by its index in the plan's points:
  /// False if a command may have changed its data since they were read.
  bool is_current(std::size_t index) const;
  /// Returns why this cycle has nothing for the point; nullopt if it has.
  std::optional<BadReason> failure_of(std::size_t index) const;
  /// Returns the value of the bytes read for it, as the value of `point`. Call only if failure_of()
  /// is nullopt. Errors as value_of() of the plan.
  Result<Value> value_of(std::size_t index, const Point& point) const;

 private:
  /// Age of an image, compared with what commands have written since.
  enum class Age : std::uint8_t {
    current,
    outdated,    ///< must be read again
    read_again,  ///< was outdated, and is current
    lost,        ///< outdated, and not read again in this cycle
  };

  void add_read(PlannedRead read);

  Plan plan_;
  std::vector<Bytes> images_;                       ///< parallel to plan_.reads
  std::vector<std::optional<BadReason>> failures_;  ///< parallel to plan_.reads
  std::vector<Age> ages_;                           ///< parallel to plan_.reads
};

}  // namespace fxagent
