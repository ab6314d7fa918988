// What polls and commands take on their line, by the config: one arithmetic for the plans of the
// field, for the bound of commands and for `fxagent plan`. Pure; any thread.
#pragma once

#include <chrono>
#include <optional>
#include <span>

#include "agent/config/config.h"
#include "protocol/plan.h"

namespace fxagent {

/// The background_question() is asked so often (CONTRACT: 10 s).
inline constexpr std::chrono::milliseconds kQuestionInterval{10000};

/// What a device is asked beside the reads of its groups: whether its PLC runs, where the protocol
/// can tell; else, where it has no tags, whether it is there. nullopt: nothing.
std::optional<Request> background_question(const Codec& codec, bool has_tags);

/// What `device` and its line add to the characters of an exchange, with the device's own time as
/// configured. `char_time` as in LinkConfig; 0 leaves only what does not depend on the speed.
LineTiming timing_of(const DeviceConfig& device, std::chrono::nanoseconds char_time);

/// What the planner is to weigh for `device`. `turnaround` is its own time, configured or measured.
LineCost cost_of(const DeviceConfig& device, std::chrono::nanoseconds char_time,
                 std::chrono::nanoseconds turnaround);

/// Line time of all exchanges of a plan.
std::chrono::nanoseconds poll_time(const Codec& codec, const Plan& plan, const LineTiming& timing);

/// The reads of `point` by itself, as a command sends them: each by itself where any way allows it.
Plan reads_of(const Codec& codec, const DeviceConfig& device, const Point& point);
/// Their line time.
std::chrono::nanoseconds read_time(const Codec& codec, const DeviceConfig& device,
                                   const Point& point, const LineTiming& timing);

/// Line time of commands sent one after the other, each with the read that must come before it.
std::chrono::nanoseconds write_time(const Codec& codec, std::span<const Request> requests,
                                    const LineTiming& timing);

/// The longest exchange that a command may find on the wire: one of `plans` (none: the device
/// has no tags), or the background_question().
std::chrono::nanoseconds longest_poll(const Codec& codec, std::span<const Plan* const> plans,
                                      const LineTiming& timing);

}  // namespace fxagent
