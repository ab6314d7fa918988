// The running cycle of one group: takes the answers to its reads and makes the sample at its end,
// if there is something to report. Also finds tags whose bytes in the device are not a value of
// their type, and floats that make sense only in another word order. Pure: time is an argument, no
// I/O. Field thread.
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
#include "agent/field/poll/cycle_reads.h"
#include "agent/field/poll/report_by_exception.h"
#include "agent/handover/telemetry.h"
#include "agent/steady_time.h"
#include "protocol/codec.h"
#include "protocol/plan/plan.h"

namespace fxagent {

struct NoValue {
  std::uint32_t tag = 0;  ///< in DeviceConfig::tags
  std::string why;        ///< includes the raw value
  std::string hint;       ///< names the other word order; empty: none
};

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
  /// Returns copies of the points of tags(). Not stored: a plant has many tags and few new plans.
  std::vector<Point> points() const;
  /// The reads of the cycle. take() passes on their answers, overwritten() what commands write.
  CycleReads& reads() { return reads_; }
  const CycleReads& reads() const { return reads_; }

  /// Begins a new cycle by `plan`, whose points are points(). Discards what was collected.
  void use(Plan plan, std::uint64_t findings);
  /// The PLC is another model than that of `codec`: `of_plc` is for its own. Tags whose places have
  /// another name there are bad. Null: it is not.
  void compare(const Codec& codec, const Codec* of_plc);
  /// Begins a new cycle. `findings`: BusDoubt::findings() at this moment.
  void begin(std::uint64_t findings);

  /// Counts one repeat of the current read. False: the config allows no more.
  bool may_repeat();
  /// Takes the result of these reads, as CycleReads::take(). They are not repeated any more.
  void take(ReadIndices reads, Exchange exchange);

  /// Returns the sample to publish at once after a command has written or read back `tag`, one of
  /// tags(). The tag has this value until this cycle reads it.
  Telemetry written(std::uint32_t tag, Value value, std::int64_t now_ms);

  /// Records that a command has written `span`, or may have. No older value is reported afterwards.
  /// With `image`, which covers the span, the images read so far take it over. Without, the tags in
  /// the span are bad with `why` until they are read again.
  void overwritten(const Span& span, const Bytes* image, BadReason why);

  /// Ends the cycle. Returns its sample without device and sequence number, or nullopt if the group
  /// has nothing new to report. Discards the data, so that no sample repeats them. Everything is
  /// bad_frame if the bus is `doubted`, or if foreign bytes were found since begin(): any answer
  /// may be the wrong one. The next cycle is due at `next`.
  std::optional<Telemetry> finish(bool doubted, std::uint64_t findings, std::int64_t now_ms,
                                  SteadyTime now, SteadyTime next = {});

  /// Returns and clears the tags without a value that finish() has found. Each is found once, or
  /// again after it was a value for 1 minute.
  std::vector<NoValue> take_no_values() { return std::exchange(no_values_, {}); }

  /// Returns the first bad tag; nullopt if all are good.
  std::optional<ReportByException::BadTag> first_bad() const { return report_.first_bad(); }

 private:
  using TagOutcome = std::variant<Value, BadReason>;

  TagReading reading_of(std::size_t index, bool doubtful) const;
  /// Notes in no_values_ what is odd about the reading of tags()[index].
  void check_value(std::size_t index, const TagReading& reading, SteadyTime now);
  void forget_older(std::uint32_t read);

  const DeviceConfig& device_;
  const std::uint32_t group_;
  ReportByException report_;
  CycleReads reads_;  ///< the points of their plan are points()
  /// Tag → its outcome by a command, until it is read again.
  std::unordered_map<std::uint32_t, TagOutcome> newer_;
  std::vector<NoValue> no_values_;
  std::unordered_map<std::uint32_t, SteadyTime> none_at_;  ///< tag → when it last held no value
  std::unordered_set<std::uint32_t> odd_orders_;  ///< tags found with a likelier word order
  std::unordered_set<std::uint32_t> renamed_;     ///< tags with another name on the PLC
  std::uint32_t replies_ = 0;
  SteadyTime first_reply_{};
  SteadyTime last_reply_{};
  std::int64_t last_reply_ms_ = 0;
  std::uint64_t findings_ = 0;
  int repeats_ = 0;
};

}  // namespace fxagent
