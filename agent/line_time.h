// Bus time of polls and commands, computed from the config. The field's plans, the bound of
// commands and `fxagent plan` all use this arithmetic. Pure; any thread.
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "agent/config/model.h"
#include "protocol/plan/plan.h"

namespace fxagent {

/// Time that a device and its line add to the characters of an exchange.
struct LineTiming {
  std::chrono::nanoseconds char_time{0};
  std::chrono::nanoseconds gap{0};         ///< silence before a request, from the config
  std::chrono::nanoseconds turnaround{0};  ///< the device's own time
  bool enquires_always = false;            ///< an enquiry precedes each request
};
/// Returns that of `device`, with the configured turnaround. `char_time` as in LinkConfig; 0 leaves
/// only the part that does not depend on the speed.
LineTiming timing_of(const DeviceConfig& device, std::chrono::nanoseconds char_time);

/// Returns the longest line time of one successful exchange, whatever its values, counted from the
/// end of the previous exchange. Includes the enquiry if `enquires_always`.
std::chrono::nanoseconds exchange_time(const Codec& codec, const Request& request,
                                       const LineTiming& timing);

/// Interval of the background_question() (contract: 10 s).
inline constexpr std::chrono::milliseconds kQuestionInterval{10000};

/// Returns the question asked in addition to the reads of the groups: whether the PLC runs, if the
/// protocol supports it; otherwise, for a device without tags, whether the device is present.
/// nullopt: no question.
std::optional<Request> background_question(const Codec& codec, bool has_tags);

/// Returns the costs that the planner weighs for `device`. `turnaround` is configured or measured.
LineCost cost_of(const DeviceConfig& device, std::chrono::nanoseconds char_time,
                 std::chrono::nanoseconds turnaround);

/// The polls of a group, before its device has refused or delayed any.
struct GroupPlan {
  std::uint32_t group = 0;             ///< index in DeviceConfig::groups
  std::vector<const TagConfig*> tags;  ///< of the device
  std::vector<Point> points;           ///< of `tags`
  Plan plan;
};
/// Returns the polls of each group that has tags. `device` must outlive them.
std::vector<GroupPlan> group_plans(const Codec& codec, const DeviceConfig& device,
                                   std::chrono::nanoseconds char_time);

/// Returns the bus time of all exchanges of a plan.
std::chrono::nanoseconds poll_time(const Codec& codec, const Plan& plan, const LineTiming& timing);

/// Returns the reads of `point` alone, as a command sends them: one read a request if the device
/// allows it. `limits` are the longest reads that polls have found the device to answer.
Plan reads_of(const Codec& codec, const DeviceConfig& device, const Point& point,
              std::span<const Holes::Limit> limits);
/// Returns the bus time of reads_of().
std::chrono::nanoseconds read_time(const Codec& codec, const DeviceConfig& device,
                                   const Point& point, std::span<const Holes::Limit> limits,
                                   const LineTiming& timing);

/// Returns the bus time of commands sent in sequence, each preceded by the read that it requires.
std::chrono::nanoseconds write_time(const Codec& codec, std::span<const Request> requests,
                                    const LineTiming& timing);

/// Returns the longest exchange that a command may have to wait for: one of `plans` (empty if the
/// device has no tags), the background_question(), or a question that identifies the model.
std::chrono::nanoseconds longest_poll(const Codec& codec, std::span<const Plan* const> plans,
                                      const LineTiming& timing);

}  // namespace fxagent
