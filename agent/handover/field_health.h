// Counters of the field, for health and metrics.
#pragma once

#include <chrono>
#include <cstdint>
#include <string>
#include <vector>

#include "agent/handover/duration_histogram.h"

namespace fxagent {

/// Percentiles p50 and p99 of a duration, in ms; 0 if nothing was measured.
struct Percentiles {
  double p50 = 0;
  double p99 = 0;
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
