// Counters of the whole fleet, and times with their percentiles. One thread.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "tests/fleet/reconnect.h"

namespace fxfleet {

/// Durations in microseconds. Percentiles sort a copy.
class Durations final {
 public:
  void add(Time::duration duration);
  void clear() { values_.clear(); }
  std::size_t size() const { return values_.size(); }
  /// Returns the time in ms that `share` of the durations do not exceed; 0 without durations.
  double percentile_ms(double share) const;

 private:
  std::vector<std::uint32_t> values_;
};

struct Figures {
  std::size_t connected = 0;  ///< players with a CONNACK, now
  std::vector<Time> connacks;
  std::uint64_t attempts = 0;
  std::uint64_t failures = 0;  ///< attempts that were refused or timed out
  std::uint64_t losses = 0;
  std::uint64_t refusals = 0;  ///< PUBACKs and SUBACKs of 0x80 and above
  std::uint64_t published = 0;
  std::uint64_t received = 0;
  std::uint64_t samples_made = 0;
  std::uint64_t samples_acknowledged = 0;
  std::uint64_t history_messages = 0;
  std::uint64_t commands_received = 0;
  std::uint64_t commands_carried_out = 0;
  Durations acknowledgements;

  /// Returns the most CONNACKs in any one second since the `from`th.
  std::size_t most_connects_in_a_second(std::size_t from) const;
};

}  // namespace fxfleet
