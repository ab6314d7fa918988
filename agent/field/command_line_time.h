// What an admitted command will take on its line, before anything is sent: its planned line time,
// which bounds are made of, and whether it lets others between its parts. Pure. Field thread.
#pragma once

#include <chrono>

#include "agent/commands/admitted_command.h"
#include "agent/config/config.h"
#include "protocol/codec.h"

namespace fxagent {

/// CONTRACT: RUN and STOP are verified by the RUN state for up to 2 s.
inline constexpr std::chrono::milliseconds kRunStateVerifiedWithin{2000};

/// Line time of all exchanges of `admitted` when each ends well.
std::chrono::nanoseconds line_time_of(const Codec& codec, const DeviceConfig& device,
                                      std::chrono::nanoseconds char_time,
                                      const AdmittedCommand& admitted);
/// Notes in `admitted` what its targets and, where the speed of the line is known, its own
/// exchanges take.
void set_line_times(const Codec& codec, const DeviceConfig& device,
                    std::chrono::nanoseconds char_time, AdmittedCommand& admitted);

/// Whether others have their turns between the exchanges of this target: an array that takes longer
/// than 2 s.
bool gives_way(const AdmittedTarget& target);
/// Whether others have their turns in the midst of it: between the targets of a list, and within
/// such an array.
bool gives_way(const AdmittedCommand& admitted);

/// Whether the target is read before it is written: for `expect`, or since its last word is shared
/// with what is not its own.
bool is_read_first(const Codec& codec, const AdmittedTarget& target);
/// Whether the target is read back after its ACK.
bool is_verified(const AdmittedCommand& admitted, const AdmittedTarget& target);

}  // namespace fxagent
