// What one group says after a cycle: which tags are good, which are bad since when, and whether
// there is anything to say at all (publish: on_change). Pure: time is an argument. Field thread.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <variant>
#include <vector>

#include "agent/config/config.h"
#include "agent/messages.h"

namespace fxagent {

class ReportByException final {
 public:
  /// `device` outlives the report.
  ReportByException(const DeviceConfig& device, std::uint32_t group);

  /// Indices of the group's tags in DeviceConfig::tags, in order.
  const std::vector<std::uint32_t>& tags() const { return tags_; }

  /// Takes what a cycle brought, known at `ts_ms`: a reading for each of tags(), in that order,
  /// with a good value, or bad without one. Returns them with what bad ones had before; nullopt
  /// where the group has nothing new to say: on_change without a change, or a device that is still
  /// silent. `now` measures max_silent only, and so does `next`, when the next cycle is due: where
  /// that would be too late, on_change speaks now. A device that is silent speaks no sooner than
  /// max_silent.
  std::optional<std::vector<TagReading>> cycle(std::vector<TagReading> readings, std::int64_t ts_ms,
                                               SteadyTime now, SteadyTime next = {});

  /// A command has just written or read back `tag`: the reading to publish at once. on_change
  /// compares with this value from now on.
  TagReading written(std::uint32_t tag, Value value, std::int64_t ts_ms);

  /// A command has written, or may have, where `tag` lies: its last good value is none any more.
  void overwritten(std::uint32_t tag);

  /// How many tags are bad, and the reason of the first; nullopt where none is.
  std::optional<BadReason> first_bad() const;

 private:
  /// A value at rest: a number or a boolean in place, anything else on the heap.
  class Kept final {
   public:
    Kept() = default;
    explicit Kept(const Value& value);
    Value value() const;

   private:
    std::variant<std::monostate, bool, std::int64_t, double, std::unique_ptr<const Value>> kept_;
  };
  // There is one for each tag of the plant.
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
  const GroupConfig& group_;
  std::vector<std::uint32_t> tags_;
  std::vector<State> states_;  ///< beside tags_
  /// Beside tags_, for those that are bad; empty while none is.
  std::vector<std::int64_t> bad_since_ms_;
  std::vector<Kept> sent_;  ///< on_change, beside tags_: last good values that were published
  std::optional<SteadyTime> last_sent_;
};

}  // namespace fxagent
