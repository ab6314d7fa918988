// What a link knows of each of its devices: the loop, the polls and the commands share it.
#pragma once

#include <bitset>
#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "agent/config/config.h"
#include "agent/field/bus.h"
#include "agent/field/device_state.h"
#include "agent/field/foreign_bytes.h"
#include "agent/field/hole_map.h"
#include "agent/field/measured_turnaround.h"
#include "agent/field/percentile_window.h"
#include "agent/field/poll_cycle.h"
#include "agent/field/poll_scheduler.h"
#include "agent/messages.h"

namespace fxagent {

/// By the calendar, UTC.
inline std::int64_t now_ms() { return utc_ms(std::chrono::system_clock::now()); }

/// One group of one device: its cycle, and what its plan was made of.
struct GroupPoll {
  GroupPoll(const DeviceConfig& device, std::uint32_t index) : cycle(device, index) {}

  PollCycle cycle;
  PollScheduler::GroupId id = 0;
  std::uint32_t holes_version = 0;         ///< HoleMap::version() that the plan was made under
  std::chrono::nanoseconds turnaround{0};  ///< the device's own time that it was made with
  /// Reads that the running cycle was refused because something is missing, and their line time.
  std::uint32_t refusals = 0;
  std::chrono::nanoseconds refused_time{0};
};

/// A device as its link knows it: its codec of the moment, its plans, its state.
struct LinkDevice {
  /// `device_config` outlives it.
  LinkDevice(const DeviceConfig& device_config, std::uint32_t device_index)
      : LinkDevice(
            std::shared_ptr<const DeviceConfig>(std::shared_ptr<const void>(), &device_config),
            device_index) {}
  LinkDevice(DeviceConfig&& device_config, std::uint32_t device_index) = delete;
  LinkDevice(std::shared_ptr<const DeviceConfig> device_config, std::uint32_t device_index)
      : owned(std::move(device_config)),
        config(*owned),
        index(device_index),
        codec(config.codec),
        turnaround(config.turnaround),
        state(device_index, *config.codec, now_ms()) {
    station.codec = codec;
    station.device = config.name;
    station.timeout = config.timeout;
    station.gap = config.gap;
    station.enquire = config.enquire;
    station.echo = config.echo;
  }

  /// The configs that have this device and this one own it.
  const std::shared_ptr<const DeviceConfig> owned;
  const DeviceConfig& config;
  const std::uint32_t index;  ///< in Config::devices
  /// It leaves the link: nothing of it begins any more, what is under way ends, and nothing at all
  /// goes out after this time.
  std::optional<SteadyTime> leaves_by{};
  std::shared_ptr<const Codec> codec;  ///< the config's, or that of the model found by asking
  Station station;
  PollScheduler::DeviceId id = 0;
  std::unique_ptr<HoleMap> holes;  ///< null: it has refused nothing so far, as most devices
  MeasuredTurnaround turnaround;
  std::vector<std::unique_ptr<GroupPoll>> groups;
  std::optional<PollScheduler::GroupId> question_group;
  std::vector<Bytes> model_images;  ///< answers so far to the questions of compare_model()
  /// Its groups are not read at once again before, however often it comes and goes.
  SteadyTime at_once_from{};
  std::uint64_t seq = 0;
  PercentileWindow late_ms;
  std::uint64_t collected = 0;
  std::uint64_t suppressed = 0;
  /// When what is no answer is looked at again, and which of its causes were told since when.
  SteadyTime foreign_bytes_from{};
  SteadyTime foreign_told_since{};
  std::bitset<ForeignBytes::kCauses> foreign_told;
  bool asked_in_vain = false;  ///< the last exchange had no answer
  std::string gateway_says;    ///< why a gateway answered in its place, last; empty: none did
  std::vector<std::string> refusals_told;  ///< reasons that the log has since it was online
  DeviceState state;

  HoleMap& found_holes() {
    if (holes == nullptr) holes = std::make_unique<HoleMap>();
    return *holes;
  }
};
using LinkDevices = std::vector<std::unique_ptr<LinkDevice>>;

}  // namespace fxagent
