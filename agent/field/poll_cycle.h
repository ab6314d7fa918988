// The running cycle of one group: what its reads have brought so far, and at its end the sample, if
// there is anything to say. Pure: time is an argument, no I/O. Field thread.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <unordered_map>
#include <unordered_set>
#include <utility>
#include <variant>
#include <vector>

#include "agent/config/config.h"
#include "agent/field/exchange.h"
#include "agent/field/report_by_exception.h"
#include "agent/messages.h"
#include "protocol/plan.h"

namespace fxagent {

class PollCycle final {
 public:
  /// `device` outlives the cycle; `group` is an index in DeviceConfig::groups.
  PollCycle(const DeviceConfig& device, std::uint32_t group);

  std::uint32_t group() const { return group_; }
  /// Indices of the group's tags in DeviceConfig::tags, in order.
  const std::vector<std::uint32_t>& tags() const { return report_.tags(); }
  /// The points of tags(), copied: a plant has many tags and seldom a new plan.
  std::vector<Point> points() const;
  const Plan& plan() const { return plan_; }

  /// From now on the group is read like this. Its points are points(). What was collected is gone.
  void use(Plan plan, std::uint64_t findings);
  /// A new cycle. `findings`: BusDoubt::findings() at this moment.
  void begin(std::uint64_t findings);

  /// Counts one repeat of the read under way. False: the config allows no further one.
  bool may_repeat();
  /// Takes the end of the exchange that was to bring these reads of plan(), by plan().request();
  /// it is not repeated any more.
  void take(const ReadIndices& reads, Exchange exchange);
  void take(std::uint32_t read, Exchange exchange) { take(ReadIndices(read), std::move(exchange)); }
  /// Indices in tags() of what these reads were to bring, rising.
  std::vector<std::uint32_t> points_of(const ReadIndices& reads) const;
  /// What goes together, at least two reads, goes in halves for the rest of this cycle: they come
  /// behind the exchanges of plan().
  void read_halves(const ReadIndices& reads);
  /// For the rest of this cycle these of points() are read by `part`, a plan of them alone: its
  /// exchanges come behind those of plan(). What was read already by a read of the same place is
  /// there as has_images() says.
  void read_instead(const std::vector<std::uint32_t>& points, Plan part);
  /// Whether this cycle has all that these reads bring.
  bool has_images(const ReadIndices& reads) const;
  /// What was not read yet is bad for this reason.
  void give_up(BadReason why);

  /// A command has just written or read back `tag`, one of tags(): the sample to publish at once.
  /// Until this cycle has read the tag for itself, it has this value.
  Telemetry written(std::uint32_t tag, Value value, std::int64_t now_ms);

  /// A command has just written `span`, or may have: no value that is older is said any more. With
  /// `image`, which covers the span, it was written like this, and what this cycle has read has it
  /// from now on. Without, the tags there are bad for the reason `why` until outdated() was read.
  void overwritten(const Span& span, const Bytes* image, BadReason why);
  /// The read that is to be repeated before any other, because a command may have changed what it
  /// brought. Each is repeated once in a cycle, so that no flood of commands keeps it from its end.
  std::optional<std::uint32_t> outdated() const;

  /// The sample of the cycle, without device and number; nullopt where the group has nothing new to
  /// say. What was read is gone then: no sample has it a second time. Everything is bad_frame where
  /// the bus is `doubted`, or where foreign bytes were found since begin(): any of the answers may
  /// be the wrong one. The next cycle is due at `next`.
  std::optional<Telemetry> finish(bool doubted, std::uint64_t findings, std::int64_t now_ms,
                                  SteadyTime now, SteadyTime next = {});

  /// A tag whose bytes in the device are no value of its type, or a float that makes sense in
  /// another word order only.
  struct NoValue {
    std::uint32_t tag = 0;
    std::string why;   ///< with the raw value
    std::string hint;  ///< names the other word order; empty: there is none
  };
  /// Returns those that finish() has found: each once, and again after it was a value for a minute.
  /// A value in a doubtful word order comes once.
  std::vector<NoValue> take_no_values() { return std::exchange(no_values_, {}); }

  /// The reason of the first bad tag; nullopt where all are good.
  std::optional<BadReason> first_bad() const { return report_.first_bad(); }

 private:
  /// What an image is beside what commands have written since.
  enum class Age : std::uint8_t {
    current,
    outdated,    ///< to be read again
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
  std::vector<Bytes> images_;                       ///< beside plan_.reads
  std::vector<std::optional<BadReason>> failures_;  ///< beside plan_.reads
  std::vector<Age> ages_;                           ///< beside plan_.reads
  /// Tag → what has become of it by a command, until it is read anew.
  std::unordered_map<std::uint32_t, TagOutcome> newer_;
  std::unordered_map<std::uint32_t, SteadyTime> no_value_at_;  ///< tag → when it was none last
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
