// Builds the results of commands, as far as that needs no wire, and writes them as published and
// stored. Pure functions, any thread.
#pragma once

#include <chrono>
#include <cstddef>
#include <string>
#include <string_view>

#include "agent/commands/admitted_command.h"
#include "agent/handover/command_message.h"

namespace fxagent {

/// Returns a result for `command` with its ids, times, op and topics. The caller sets the status.
CommandResult result_of(const Command& command);
/// Same, with the addresses and values that admission found.
CommandResult result_of(const AdmittedCommand& admitted);
/// Returns a target's name, address and value to write, without an outcome.
TargetResult result_of(const AdmittedTarget& target);

/// Sets `status` and `reason` of the command and of all its targets, and `detail` of the command.
void set_outcome(CommandResult& result, CommandStatus status, Reason reason, std::string detail);
/// Detail of a command that may have been sent in part when the agent ended.
inline constexpr std::string_view kInterrupted =
    "the agent ended during the command: it may or may not have been carried out";
/// Sets UNKNOWN_OUTCOME: the command may have been sent in part when the agent ended.
void set_interrupted(CommandResult& result);

/// The refusals that every kind of command shares.
Refusal refusal_of_retained();
/// `other_boot`: boot id of the agent with our id.
Refusal refusal_of_conflict(const std::string& other_boot);

/// Returns the text for shutting_down, reloading, yielded or conflict, the reasons why an admitted
/// command is not sent any more.
std::string why_not_sent(Reason reason);
/// Returns the status of a command, or target, that is not sent for such a reason.
CommandStatus status_of_unsent(Reason reason);
/// Returns the result of such a command. An interrupted one gets UNKNOWN_OUTCOME, since an earlier
/// run may have sent it.
CommandResult not_sent(const AdmittedCommand& admitted, Reason why = Reason::shutting_down);

// The text of a result.

/// Largest result. Above it a DUPLICATE leaves out what its command asked for. Then the details of
/// targets are left out, then values; those of `first` in a DUPLICATE.
inline constexpr std::size_t kMaxResultBytes = 65536;
/// Returns the result of a command, docs/interface.md section 5; total_ms is null if not known.
std::string result_text(const CommandResult& result);
/// Returns a duration as it stands in a result.
std::string total_text(std::chrono::nanoseconds total);
/// Fills in the total_ms of a result_text(): from the command's arrival to the hand-over. A text
/// that has one stays as it is.
std::string with_total(std::string text, std::chrono::nanoseconds total);

/// Restores a result from its result_text(): `recorded` is the text; status and plc are read from
/// it. If the text is not a JSON object any more, the outcome is unknown and `recorded` empty.
CommandResult recorded_result(std::string text);

}  // namespace fxagent
