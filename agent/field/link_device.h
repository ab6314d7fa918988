// What a link's worker knows of each of its devices, for the files that the worker is written in.
#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <unordered_map>
#include <utility>
#include <vector>

#include "agent/commands/admission.h"
#include "agent/config/config.h"
#include "agent/field/device_state.h"
#include "agent/field/hole_map.h"
#include "agent/field/link_worker.h"
#include "agent/field/percentile_window.h"
#include "agent/field/poll_scheduler.h"
#include "agent/field/report_by_exception.h"
#include "agent/messages.h"
#include "protocol/plan.h"

namespace fxagent {

/// By the calendar, UTC.
inline std::int64_t now_ms() { return utc_ms(std::chrono::system_clock::now()); }

/// One group of one device and the cycle it is in.
struct LinkWorker::GroupPoll {
  GroupPoll(const DeviceConfig& device, std::uint32_t index)
      : group(index), report(device, index) {}

  std::uint32_t group;
  ReportByException report;
  PollScheduler::GroupId id = 0;
  Plan plan;                        ///< its points are report.tags(), in order
  std::uint32_t holes_version = 0;  ///< HoleMap::version() that the plan was made under
  std::chrono::nanoseconds planned_turnaround{0};  ///< the device's own time that it was made with

  // The running cycle.
  std::vector<Bytes> images;                       ///< beside plan.reads
  std::vector<std::optional<BadReason>> failures;  ///< beside plan.reads
  std::unordered_map<std::uint32_t, Value> newer;  ///< tag → what a command has written meanwhile
  std::optional<SteadyTime> first_reply;
  SteadyTime last_reply{};
  std::int64_t last_reply_ms = 0;
  std::uint32_t replies = 0;
  std::uint64_t findings = 0;  ///< BusDoubt::findings() when it began
  std::uint32_t next_read = 0;
  int repeats = 0;

  void begin(std::uint64_t findings_now) {
    findings = findings_now;
    images.assign(plan.reads.size(), {});
    failures.assign(plan.reads.size(), std::nullopt);
    newer.clear();
    first_reply.reset();
    last_reply_ms = 0;
    replies = 0;
    next_read = 0;
    repeats = 0;
  }
};

/// A device as this worker knows it: its codec of the moment, its plans, its state.
struct LinkWorker::Device {
  Device(const DeviceConfig& device_config, std::uint32_t device_index, Journaling journaling,
         std::shared_ptr<CommandRoom> room)
      : config(device_config),
        index(device_index),
        codec(device_config.codec),
        admission(config, journaling, std::move(room)),
        state(device_index, *device_config.codec, now_ms()) {
    station.codec = codec.get();
    station.timeout = config.timeout;
    station.gap = config.gap;
    station.enquire = config.enquire;
    station.echo = config.echo;
    turnaround = config.turnaround;
  }

  const DeviceConfig& config;
  const std::uint32_t index;
  std::shared_ptr<const Codec> codec;  ///< the config's, or that of the model found by asking
  Station station;
  CommandAdmission admission;
  PollScheduler::DeviceId id = 0;
  HoleMap holes;
  std::chrono::nanoseconds turnaround{0};  ///< its own time: the config's, or as it was measured
  std::chrono::nanoseconds turnaround_sum{0};  ///< of the exchanges counted
  std::uint32_t turnarounds = 0;
  std::vector<std::unique_ptr<GroupPoll>> groups;
  std::optional<PollScheduler::GroupId> run_state_group;
  std::uint64_t seq = 0;
  std::size_t waiting = 0;  ///< commands queued
  PercentileWindow late_ms;
  std::uint64_t collected = 0;
  std::uint64_t suppressed = 0;
  DeviceState state;
};

}  // namespace fxagent
