// The state that a link keeps of each device, and what the parts of a link share: its loop, its
// polls and its commands.
#pragma once

#include <bitset>
#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "agent/config/model.h"
#include "agent/field/bus/bus.h"
#include "agent/field/bus/unexpected_bytes.h"
#include "agent/field/link/device_state.h"
#include "agent/field/poll/hole_map.h"
#include "agent/field/poll/measured_turnaround.h"
#include "agent/field/poll/poll_cycle.h"
#include "agent/field/poll/poll_scheduler.h"
#include "agent/handover/field_health.h"
#include "agent/handover/outbox.h"
#include "agent/steady_time.h"

namespace fxagent {

/// Keeps a flag true while an operation is in progress. Clears it even if an exception or a
/// cancelled coroutine ends the operation.
class Raised final {
 public:
  explicit Raised(bool& flag) : flag_(flag) { flag_ = true; }
  Raised(const Raised&) = delete;
  Raised& operator=(const Raised&) = delete;
  ~Raised() { flag_ = false; }

 private:
  bool& flag_;
};

/// One group of one device: its cycle and the inputs of its plan.
struct GroupPoll {
  GroupPoll(const DeviceConfig& device, std::uint32_t index) : cycle(device, index) {}

  PollCycle cycle;
  PollScheduler::GroupId id = 0;
  SteadyTime began{};                      ///< start of the last cycle
  std::uint32_t holes_version = 0;         ///< HoleMap::version() when the plan was made
  std::chrono::nanoseconds turnaround{0};  ///< the device's own time when the plan was made
  /// Reads of the running cycle that were refused for a missing place, and their line time.
  std::uint32_t refusals = 0;
  std::chrono::nanoseconds refused_time{0};
  /// Answers of the running cycle. One counts as invalid only if it closed the connection.
  enum class Answers : std::uint8_t { none, only_invalid, valid } answers = Answers::none;
};

/// A device of a link: its current codec, its plans, its state.
struct LinkDevice {
  LinkDevice(std::shared_ptr<const DeviceConfig> device_config, std::uint32_t device_index)
      : owned(std::move(device_config)), config(*owned), index(device_index) {}

  /// Owned by this device and by every config that has it.
  const std::shared_ptr<const DeviceConfig> owned;
  /// As of its beginning. A reload may have given its groups other settings: PollCycle::settings().
  const DeviceConfig& config;
  const std::uint32_t index;  ///< in Config::devices
  /// Set when the device leaves the link. It begins nothing more, ends what is in progress, and
  /// sends nothing at all after this time.
  std::optional<SteadyTime> leaves_by{};
  /// The config's, or that of the model found by asking.
  std::shared_ptr<const Codec> codec = config.codec;
  std::shared_ptr<const Codec> codec_of_plc;  ///< DeviceStatus::codec_of_plc
  Station station{.codec = config.codec,
                  .device = config.name,
                  .timeout = config.timeout,
                  .gap = config.gap,
                  .enquire = config.enquire,
                  .echo = config.echo};
  PollScheduler::DeviceId id = 0;
  std::unique_ptr<HoleMap> holes;  ///< null until the device refuses something; most never do
  MeasuredTurnaround turnaround{config.turnaround};
  std::vector<std::unique_ptr<GroupPoll>> groups;
  std::optional<PollScheduler::GroupId> question_group;
  std::vector<Bytes> model_images;  ///< answers so far to the questions of compare_model()
  int asked_again = 0;              ///< times that ModelQuestions has asked again at once
  /// Earliest time of its next PollScheduler::read_at_once().
  SteadyTime at_once_from{};
  std::uint64_t seq = 0;
  PercentileWindow late_ms;
  std::uint64_t collected = 0;
  std::uint64_t suppressed = 0;
  /// Next time to examine foreign bytes.
  SteadyTime unexpected_bytes_from{};
  /// Start of the 24 h for which `logged_causes` holds.
  SteadyTime causes_logged_since{};
  std::bitset<UnexpectedBytes::kCauses> logged_causes;
  std::string gateway_says;  ///< last reason of a gateway that answered in its place; empty: none
  std::vector<std::string> logged_refusals;  ///< reasons logged since it was online
  DeviceState state{index, *config.codec, utc_now_ms()};

  /// Logs why the device or its gateway refuses requests, each reason once until it is online.
  void log_refusal_once(const std::string& reason);
  /// Logs the first bytes in place of an answer and their likely cause, once a day for each cause.
  void log_foreign_bytes(const Exchange& exchange);
  HoleMap& found_holes() {
    if (holes == nullptr) holes = std::make_unique<HoleMap>();
    return *holes;
  }
};
using LinkDevices = std::vector<std::unique_ptr<LinkDevice>>;

/// What the parts of one link share. All of it must outlive them.
struct LinkParts {
  const LinkConfig& config;
  std::uint32_t index;  ///< in Config::links
  Bus& bus;
  PollScheduler& scheduler;
  const LinkDevices& devices;  ///< may be filled later
  Outbox& outbox;
};

}  // namespace fxagent
