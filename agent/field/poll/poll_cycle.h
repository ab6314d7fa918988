// The running cycle of one group: collects the data of its reads and makes the sample at its end,
// if there is something to report. Pure: time is an argument, no I/O. Field thread.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <unordered_map>
#include <unordered_set>
#include <utility>
#include <variant>
#include <vector>

#include "agent/config/model.h"
#include "agent/field/bus/exchange.h"
#include "agent/field/poll/report_by_exception.h"
#include "agent/steady_time.h"
#include "agent/telemetry.h"
#include "protocol/plan/plan.h"

namespace fxagent {

class PollCycle final {
 public:
  /// `device` must outlive the cycle; `group` is an index in DeviceConfig::groups.
  PollCycle(const DeviceConfig& device, std::uint32_t group);

  std::uint32_t group() const { return group_; }
  /// The group's current settings. Those in DeviceConfig are as of the device's beginning.
  const GroupConfig& settings() const { return report_.group(); }
  /// Applies interval, publish and max_silent of `group`; the cycle goes on.
  void adjust(const GroupConfig& group) { report_.adjust(group); }
  /// Indices of the group's tags in DeviceConfig::tags, in order.
  const std::vector<std::uint32_t>& tags() const { return report_.tags(); }
  /// Returns copies of the points of tags(). Not stored: a plant has many tags and rarely a new
  /// plan.
  std::vector<Point> points() const;
  const Plan& plan() const { return plan_; }

  /// Reads the group by `plan`, whose points are points(), and discards what was collected. Begins
  /// a new cycle.
  void use(Plan plan, std::uint64_t findings);
  /// Begins a new cycle. `findings`: BusDoubt::findings() at this moment.
  void begin(std::uint64_t findings);

  /// Counts one repeat of the current read. False: the config allows no more.
  bool may_repeat();
  /// Takes the result of the exchange for these reads of plan(), sent as plan().request(). It is
  /// not repeated any more.
  void take(const ReadIndices& reads, Exchange exchange);
  void take(std::uint32_t read, Exchange exchange) { take(ReadIndices(read), std::move(exchange)); }
  /// Returns the indices in tags() of the points of these reads, in ascending order.
  std::vector<std::uint32_t> points_of(const ReadIndices& reads) const;
  /// Splits these reads, at least two in one exchange, into halves for the rest of this cycle. The
  /// halves come after the exchanges of plan().
  void read_halves(const ReadIndices& reads);
  /// Reads these of points() by `part` for the rest of this cycle. `part` is a plan of them alone;
  /// its exchanges come after those of plan(). A read of the same place as an earlier one already
  /// has its image: see has_images().
  void read_instead(const std::vector<std::uint32_t>& points, Plan part);
  /// True if this cycle has the images of all these reads.
  bool has_images(const ReadIndices& reads) const;
  /// Marks everything not read yet as bad for this reason.
  void give_up(BadReason why);

  /// Returns the sample to publish at once after a command has written or read back `tag`, one of
  /// tags(). The tag has this value until this cycle reads it.
  Telemetry written(std::uint32_t tag, Value value, std::int64_t now_ms);

  /// Records that a command has written `span`, or may have. No older value is reported afterwards.
  /// With `image`, which covers the span, the images read so far take it over. Without, the tags in
  /// the span are bad for the reason `why` until outdated() was read.
  void overwritten(const Span& span, const Bytes* image, BadReason why);
  /// Returns the read to repeat before any other, because a command may have changed its data. Each
  /// is repeated at most once in a cycle, so that a flood of commands cannot keep the cycle from
  /// ending.
  std::optional<std::uint32_t> outdated() const;

  /// Ends the cycle. Returns its sample without device and sequence number, or nullopt if the group
  /// has nothing new to report. Discards the data, so that no sample repeats them. Everything is
  /// bad_frame if the bus is `doubted`, or if foreign bytes were found since begin(): any answer
  /// may be the wrong one. The next cycle is due at `next`.
  std::optional<Telemetry> finish(bool doubted, std::uint64_t findings, std::int64_t now_ms,
                                  SteadyTime now, SteadyTime next = {});

  /// A tag whose bytes in the device are not a value of its type, or a float that makes sense only
  /// in another word order.
  struct NoValue {
    std::uint32_t tag = 0;
    std::string why;   ///< includes the raw value
    std::string hint;  ///< names the other word order; empty: none
  };
  /// Returns and clears the tags that finish() has found. A tag is returned once, and again after
  /// it was a value for 1 minute. A value in a doubtful word order is returned once.
  std::vector<NoValue> take_no_values() { return std::exchange(no_values_, {}); }

  /// Returns the reason of the first bad tag; nullopt if all are good.
  std::optional<BadReason> first_bad() const { return report_.first_bad(); }

 private:
  /// Age of an image, compared with what commands have written since.
  enum class Age : std::uint8_t {
    current,
    outdated,    ///< must be read again
    read_again,  ///< was outdated, and is current
    lost,        ///< outdated, and not read again in this cycle
  };

  using TagOutcome = std::variant<Value, BadReason>;

  TagReading reading_of(std::size_t index, bool doubtful) const;
  void note_no_value(std::size_t index, SteadyTime now);
  void note_order(std::size_t index, const Value& value);
  std::string order_hint_of(std::size_t index) const;
  std::optional<BadReason> failure_of(const PointSource& source, std::size_t index) const;
  void add_read(PlannedRead read);
  void take_images(const ReadIndices& reads, Exchange& exchange);
  void forget_older(std::uint32_t read);
  bool is_current(const PointSource& source) const;

  const DeviceConfig& device_;
  const std::uint32_t group_;
  ReportByException report_;
  Plan plan_;                                       ///< its points are report_.tags(), in order
  std::vector<Bytes> images_;                       ///< parallel to plan_.reads
  std::vector<std::optional<BadReason>> failures_;  ///< parallel to plan_.reads
  std::vector<Age> ages_;                           ///< parallel to plan_.reads
  /// Tag → its outcome by a command, until it is read again.
  std::unordered_map<std::uint32_t, TagOutcome> newer_;
  std::unordered_map<std::uint32_t, SteadyTime> no_value_at_;  ///< tag → when it last held no value
  std::vector<NoValue> no_values_;
  std::unordered_set<std::uint32_t> odd_orders_;  ///< tags that note_order() has reported
  std::optional<SteadyTime> first_reply_;
  SteadyTime last_reply_{};
  std::int64_t last_reply_ms_ = 0;
  std::uint32_t replies_ = 0;
  std::uint64_t findings_ = 0;
  int repeats_ = 0;
};

}  // namespace fxagent
