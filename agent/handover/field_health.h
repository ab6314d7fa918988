// Counters and measurements of the field, for health and metrics.
#pragma once

#include <algorithm>
#include <array>
#include <boost/circular_buffer.hpp>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace fxagent {

/// Percentiles p50 and p99 of a duration, in ms; 0 if nothing was measured.
struct Percentiles {
  double p50 = 0;
  double p99 = 0;
};

/// The last 256 measurements of one duration, for p50 and p99 in health. One thread.
class PercentileWindow final {
 public:
  void add(std::chrono::nanoseconds duration) {
    window_.push_back(std::chrono::duration<float, std::milli>(duration).count());
  }

  /// Returns the percentiles of the window in ms; 0 if it is empty.
  Percentiles percentiles() const {
    if (window_.empty()) return {};
    std::vector<float> sorted(window_.begin(), window_.end());
    std::sort(sorted.begin(), sorted.end());
    const auto at = [&](std::size_t percent) {
      return static_cast<double>(
          sorted[std::min(sorted.size() - 1, sorted.size() * percent / 100)]);
    };
    return {at(50), at(99)};
  }

 private:
  /// Grows with use: an idle link costs nothing.
  boost::circular_buffer_space_optimized<float> window_{256};
};

/// Counts durations in fixed buckets, for the histograms of metrics. An add() is a search among
/// thirteen numbers and two additions. One thread.
class DurationHistogram final {
 public:
  /// Upper bounds, inclusive. Durations above the last bound have a bucket of their own.
  static constexpr std::array<std::chrono::microseconds, 13> kBounds{
      std::chrono::microseconds(1'000),     std::chrono::microseconds(2'500),
      std::chrono::microseconds(5'000),     std::chrono::microseconds(10'000),
      std::chrono::microseconds(25'000),    std::chrono::microseconds(50'000),
      std::chrono::microseconds(100'000),   std::chrono::microseconds(250'000),
      std::chrono::microseconds(500'000),   std::chrono::microseconds(1'000'000),
      std::chrono::microseconds(2'500'000), std::chrono::microseconds(5'000'000),
      std::chrono::microseconds(10'000'000)};

  /// Counts a negative duration as 0.
  void add(std::chrono::nanoseconds duration) {
    const auto bound = std::ranges::lower_bound(kBounds, duration);
    ++counts_[static_cast<std::size_t>(bound - kBounds.begin())];
    sum_ += std::max(duration, std::chrono::nanoseconds(0));
  }

  /// Returns the count of each bucket: at or below its bound and above the previous one. The last
  /// bucket is above all bounds.
  const std::array<std::uint64_t, kBounds.size() + 1>& counts() const { return counts_; }
  std::chrono::nanoseconds sum() const { return sum_; }

 private:
  std::array<std::uint64_t, kBounds.size() + 1> counts_{};
  std::chrono::nanoseconds sum_{0};
};

/// Counters of one bus since the start.
struct BusCounters {
  std::uint64_t exchanges = 0;
  std::uint64_t timeouts = 0;
  std::uint64_t naks = 0;
  std::uint64_t bad_frames = 0;
  std::uint64_t unexpected_bytes = 0;  ///< received when no answer was due, or around one
  /// "press1: ...", the last answer that was missing, damaged or a NAK; empty: none.
  std::string last_error{};
  std::int64_t last_error_ms = 0;
};

struct LinkHealth : BusCounters {
  bool open = false;         ///< at present
  bool yielded = false;      ///< to another program, at present
  std::uint64_t doubts = 0;  ///< number of times unexpected bytes made the bus doubted
  bool doubted = false;
  double busy_percent = 0;
  double load_percent = 0;  ///< load of the bus that the poll intervals ask for; may exceed 100
  Percentiles turnaround_ms;
};

struct DeviceHealth {
  std::uint64_t polls = 0;
  std::uint64_t missed = 0;
  Percentiles late_ms;
  std::uint64_t collected = 0;   ///< samples taken, including suppressed ones
  std::uint64_t suppressed = 0;  ///< samples not reported because on_change found no change
  /// Smoothed time between two polls, by index in DeviceConfig::groups; 0: not known.
  std::vector<std::chrono::milliseconds> reached{};
};

/// Duration histograms of one link since the start, for metrics.
struct LinkDurations {
  DurationHistogram turnaround;  ///< the devices' own time, for each answered exchange
  DurationHistogram lateness;    ///< delay of the start of each poll cycle
};

/// Counters of the field, sent to the uplink at every health tick.
struct FieldHealth {
  std::vector<LinkHealth> links;         ///< by index in Config::links
  std::vector<DeviceHealth> devices;     ///< by index in Config::devices
  std::vector<LinkDurations> durations;  ///< parallel to `links`; empty: metrics are off
  // Totals of devices that a reload removed; `devices` no longer includes their counts.
  std::uint64_t ended_collected = 0;
  std::uint64_t ended_suppressed = 0;
};

}  // namespace fxagent
