// Decides what one group reports after a cycle: which tags are good, which are bad since when, and
// if there is anything to report at all (publish: on_change). Pure: time is an argument. Field
// thread.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <variant>
#include <vector>

#include "agent/config/model.h"
#include "agent/handover/telemetry.h"
#include "agent/steady_time.h"

namespace fxagent {

class ReportByException final {
 public:
  /// `device` must outlive the report.
  ReportByException(const DeviceConfig& device, std::uint32_t group);

  /// Applies interval, publish and max_silent of `group`. When on_change is switched on,
  /// the next cycle reports.
  void adjust(const GroupConfig& group);
  const GroupConfig& group() const { return group_; }

  /// Indices of the group's tags in DeviceConfig::tags, in order.
  const std::vector<std::uint32_t>& tags() const { return tags_; }

  /// Takes the readings of a cycle, known at `ts_ms`: one for each of tags() in that sequence,
  /// either with a good value or bad without one. Returns them, bad ones with their last good
  /// value, or nullopt if the group has nothing new to report: on_change without a change, or a
  /// device that is still silent. `now` and `next` serve max_silent only: if the next cycle at
  /// `next` would be too late, on_change reports now. A silent device reports no sooner than
  /// max_silent.
  std::optional<std::vector<TagReading>> cycle(std::vector<TagReading> readings, std::int64_t ts_ms,
                                               SteadyTime now, SteadyTime next = {});

  /// Returns the reading to publish at once after a command has written or read back `tag`.
  /// Afterwards on_change compares with this value.
  TagReading written(std::uint32_t tag, Value value, std::int64_t ts_ms);

  /// Discards the last good value of `tag`, because a command has written there, or may have.
  void overwritten(std::uint32_t tag);

  struct BadTag {
    std::uint32_t tag = 0;  ///< index in DeviceConfig::tags
    BadReason why{};
    friend bool operator==(const BadTag&, const BadTag&) = default;
  };
  /// Returns the first bad tag; nullopt if none is bad.
  std::optional<BadTag> first_bad() const;

 private:
  /// A stored value: a number or a boolean in place, anything else on the heap.
  class Kept final {
   public:
    Kept() = default;
    explicit Kept(const Value& value);
    Value value() const;

   private:
    std::variant<std::monostate, bool, std::int64_t, double, std::unique_ptr<const Value>> kept_;
  };
  // A plant has one for each of its tags, so it is small.
  struct State {
    Kept value;  ///< last good
    std::int64_t value_ms = 0;
    std::optional<BadReason> bad;
    std::optional<BadReason> sent_bad;
    bool was_sent = false;
  };

  std::size_t index_of(std::uint32_t tag) const;
  bool is_long_silent(SteadyTime now, SteadyTime next) const;
  bool differs(std::size_t index, const Value& fresh) const;
  void add_last_good(TagReading& bad, std::size_t index) const;

  const DeviceConfig& device_;
  GroupConfig group_;
  std::vector<std::uint32_t> tags_;
  std::vector<State> states_;  ///< parallel to tags_
  /// Parallel to tags_, for the bad ones; empty while none is bad.
  std::vector<std::int64_t> bad_since_ms_;
  std::vector<Kept> sent_;  ///< on_change, parallel to tags_: last published good values
  std::optional<SteadyTime> last_sent_;
};

}  // namespace fxagent
