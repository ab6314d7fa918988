#include "agent/commands/result.h"

#include <utility>

namespace fxagent {

CommandResult result_of(const Command& command) {
  CommandResult result;
  result.device = command.device;
  result.number = command.number;
  result.id = command.id;
  result.id_is_number = command.id_is_number;
  result.op = command.op_text;
  result.is_list = command.is_list;
  result.dry_run = command.dry_run;
  result.received_ms = command.received_ms;
  result.received = command.received;
  result.response_topic = command.response_topic;
  result.correlation = command.correlation;
  result.tell = command.tell;
  result.by = sender_of(command);
  for (const CommandTarget& target : command.targets) {
    TargetResult out;
    out.tag = target.tag;
    out.address = target.address;
    out.value = target.value;
    result.targets.push_back(std::move(out));
  }
  return result;
}

void set_outcome(CommandResult& result, CommandStatus status, Reason reason, std::string detail) {
  result.status = status;
  result.reason = reason;
  result.detail = std::move(detail);
  for (TargetResult& target : result.targets) {
    target.status = status;
    target.reason = reason;
  }
}

TargetResult result_of(const AdmittedTarget& target) {
  TargetResult out;
  out.tag = target.tag;
  out.address = target.point.address.text;
  out.value = target.written;
  return out;
}

Refusal refusal_of_retained() {
  return {Reason::retained, "a retained command may be old: publish commands without retain"};
}

Refusal refusal_of_conflict(const std::string& other_boot) {
  return {Reason::conflict, "another agent has the same id, boot " + other_boot +
                                ": neither agent carries out commands"};
}

std::string why_not_sent(Reason reason) {
  if (reason == Reason::yielded) return "the link has yielded its port to another program";
  return reason == Reason::reloading ? "the config of the device is being changed"
                                     : "the agent is stopping";
}

CommandResult not_sent(const AdmittedCommand& admitted, Reason why) {
  CommandResult result = result_of(admitted.command);
  if (admitted.interrupted)
    set_interrupted(result);
  else
    set_outcome(result, why == Reason::yielded ? CommandStatus::rejected : CommandStatus::failed,
                why, why_not_sent(why) + "; nothing was sent");
  return result;
}

void set_interrupted(CommandResult& result) {
  set_outcome(result, CommandStatus::unknown_outcome, Reason::interrupted,
              std::string(kInterrupted));
}

void set_interrupted_unsent(CommandResult& result) {
  set_outcome(result, CommandStatus::failed, Reason::interrupted,
              op_from(result.op) == Op::read ? "the agent ended before the device was read"
                                             : "the agent ended before anything was written");
}

}  // namespace fxagent
