// The results of commands, as far as they can be made without a wire: the one place where a
// CommandResult begins. Pure functions.
#pragma once

#include <string>
#include <string_view>

#include "agent/commands/admitted_command.h"
#include "agent/messages.h"

namespace fxagent {

/// The frame of a result for `command`: ids, times, op, topics; status is for the caller to set.
CommandResult result_of(const Command& command);
/// A target's name and place, without an outcome.
TargetResult result_of(const AdmittedTarget& target);

/// What became of a command as a whole became of each of its targets: sets `status` and `reason` of
/// all, and `detail` of the command.
void set_outcome(CommandResult& result, CommandStatus status, Reason reason, std::string detail);
/// What is said of a command of which something may have left when the agent ended.
inline constexpr std::string_view kInterrupted =
    "the agent ended while the command was under way: it may or may not have been carried out";
/// UNKNOWN_OUTCOME: something of it may have left when the agent ended.
void set_interrupted(CommandResult& result);
/// FAILED: it waited when the agent ended, and nothing of it was sent. A read is always FAILED.
void set_interrupted_unsent(CommandResult& result);

/// Why no wire will see an admitted command any more.
inline constexpr std::string_view kStopping = "the agent is stopping";
inline constexpr std::string_view kReconfigured = "the config of the device was changed";
/// The answer to it: nothing was sent.
CommandResult not_sent(const AdmittedCommand& admitted, std::string_view why = kStopping);

}  // namespace fxagent
