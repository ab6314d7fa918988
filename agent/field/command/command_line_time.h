// Computes the line time of an admitted command before anything is sent. Bounds are made of it, and
// it decides whether others run between the parts of the command. Pure. Field thread.
#pragma once

#include <chrono>
#include <span>

#include "agent/commands/admitted_command.h"
#include "agent/config/model.h"
#include "protocol/codec.h"
#include "protocol/plan/plan.h"

namespace fxagent {

/// Contract: RUN and STOP are verified by the RUN state for up to 2 s.
inline constexpr std::chrono::milliseconds kRunStateVerifiedWithin{2000};

/// Stores in `admitted` the line time of each target and, if the line speed is known, of all its
/// exchanges. `limits` as for reads_of(). Returns the time of all its
/// exchanges if each ends well, with the time in which RUN and STOP are verified.
std::chrono::nanoseconds set_line_times(const Codec& codec, const DeviceConfig& device,
                                        std::span<const Holes::Limit> limits,
                                        std::chrono::nanoseconds char_time,
                                        AdmittedCommand& admitted);

/// True if others run between the exchanges of this target: an array that takes longer than 2 s.
bool gives_way(const AdmittedTarget& target);
/// True if others run within this command: between the targets of a list, or within such an array.
bool gives_way(const AdmittedCommand& admitted);

/// True if the target is read before it is written: for `expect`, or because its last word also
/// holds data of something else.
bool is_read_first(const Codec& codec, const AdmittedTarget& target);
/// True if the target is read back after its ACK.
bool is_verified(const AdmittedCommand& admitted, const AdmittedTarget& target);

}  // namespace fxagent
