#include "agent/commands/result.h"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <utility>

#include "agent/commands/journal.h"
#include "agent/text/json.h"
#include "agent/text/json_writer.h"

namespace fxagent {

CommandResult result_of(const Command& command) {
  CommandResult result;
  static_cast<CommandHead&>(result) = static_cast<const CommandHead&>(command);
  result.op = command.op_text;
  result.sender = sender_of(command);
  const bool is_force = command.op == Op::force_on || command.op == Op::force_off;
  for (const CommandTarget& target : command.targets) {
    TargetResult out;
    out.tag = target.tag;
    out.address = target.address;
    out.value = target.value;
    if (is_force && !out.value) out.value = Value(Scalar(command.op == Op::force_on));
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

CommandResult result_of(const AdmittedCommand& admitted) {
  CommandResult result = result_of(admitted.command);
  result.targets.clear();
  for (const AdmittedTarget& target : admitted.targets) result.targets.push_back(result_of(target));
  return result;
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
  if (reason == Reason::conflict) return "another agent has the same id";
  return reason == Reason::reloading ? "the config of the device is being changed"
                                     : "the agent is stopping";
}

CommandStatus status_of_unsent(Reason reason) {
  return reason == Reason::yielded || reason == Reason::conflict ? CommandStatus::rejected
                                                                 : CommandStatus::failed;
}

CommandResult not_sent(const AdmittedCommand& admitted, Reason why) {
  CommandResult result = result_of(admitted);
  if (admitted.interrupted)
    set_interrupted(result);
  else
    set_outcome(result, status_of_unsent(why), why, why_not_sent(why) + "; nothing was sent");
  return result;
}

void set_interrupted(CommandResult& result) {
  set_outcome(result, CommandStatus::unknown_outcome, Reason::interrupted,
              std::string(kInterrupted));
}

// ---- the text of a result ----------------------------------------------------------------------

namespace {

using json::Writer;
using nlohmann::ordered_json;

void write_verification(Writer& out, const std::optional<Verification>& verify) {
  if (!verify) {
    out.null();
    return;
  }
  out.begin_object().key("read");
  json::write_optional(out, verify->read);
  out.key("match").boolean(verify->match).end_object();
}

void write_outcome(Writer& out, const CommandOutcome& outcome) {
  out.key("status").string(to_string(outcome.status));
  out.key("reason").word(to_string(outcome.reason));
  out.key("detail").word(outcome.detail);
  out.key("plc").word(to_string(outcome.plc));
  if (!outcome.progress) return;
  out.key("done").integer(std::int64_t{outcome.progress->done});
  out.key("of").integer(std::int64_t{outcome.progress->of});
}

/// `target` null: the command has none, or none could be parsed.
void write_target(Writer& out, const TargetResult* target) {
  out.key("tag").word(target ? target->tag : "");
  out.key("address").word(target ? target->address : "");
  out.key("value");
  json::write_optional(out, target ? target->value : std::nullopt);
}

void write_result(Writer& out, const CommandResult& result) {
  if (!result.recorded.empty()) {
    out.raw(result.recorded);
    return;
  }
  out.begin_object();
  out.key("id");
  result.id_is_number ? out.raw(result.id) : out.word(result.id);
  write_outcome(out, result);
  out.key("op").word(result.op);
  if (result.is_list) {
    out.key("targets").begin_array();
    for (const TargetResult& target : result.targets) {
      out.begin_object();
      write_target(out, &target);
      write_outcome(out, target);
      out.key("verify");
      write_verification(out, target.verify);
      out.end_object();
    }
    out.end_array();
    if (result.one_frame) out.key("one_frame").boolean(true);
  } else {
    const TargetResult* target = result.targets.empty() ? nullptr : &result.targets.front();
    write_target(out, target);
    out.key("verify");
    write_verification(out, target ? target->verify : std::nullopt);
  }
  if (result.dry_run) out.key("dry_run").boolean(true);
  if (result.status == CommandStatus::duplicate) {
    out.key("first");
    if (result.first)
      write_result(out, *result.first);
    else
      out.null();
  }
  out.key("t").begin_object();
  out.key("received").integer(result.received_ms);
  out.key("queue_ms").milliseconds(result.queue);
  out.key("wire_ms").milliseconds(result.wire);
  out.key("total_ms").milliseconds(result.total);
  out.key("bound_ms").milliseconds(result.bound).end_object();
  out.key("attempts").integer(std::int64_t{result.attempts}).end_object();
}

// What a result that is too long leaves out, in this order.

constexpr std::string_view kTooLong = "the result would be larger than 64 KiB";

void add_detail(ordered_json& result, const std::string& text) {
  const std::string detail = text_at(result, "detail");
  result["detail"] = detail.empty() ? text : detail + "; " + text;
}

/// What a DUPLICATE says of its own targets only repeats the command.
void leave_out_repetition(ordered_json& duplicate) {
  if (duplicate.contains("targets"))
    duplicate["targets"] = ordered_json::array();
  else
    duplicate["value"] = nullptr;
  add_detail(duplicate, "what the command asked for is left out: " + std::string(kTooLong));
}

void leave_out_details(ordered_json& result) {
  if (!result.contains("targets")) return;
  for (ordered_json& target : result["targets"])
    if (target.is_object()) target["detail"] = nullptr;
}

void leave_out_values(ordered_json& result) {
  const auto clear = [](ordered_json& target) {
    if (!target.is_object()) return;
    target["value"] = nullptr;
    if (target["verify"].is_object()) target["verify"]["read"] = nullptr;
  };
  if (result.contains("targets"))
    std::ranges::for_each(result["targets"], clear);
  else
    clear(result);
  add_detail(result, "the values are left out: " + std::string(kTooLong));
}

}  // namespace

std::string result_text(const CommandResult& result) {
  constexpr std::size_t kMost = kMaxResultBytes - 24;  // room for total_ms
  Writer out;
  write_result(out, result);
  std::string text = out.take();
  if (text.size() <= kMost || !result.recorded.empty()) return text;
  ordered_json shorter = parsed_ordered_json(text);
  ordered_json* to_shorten = &shorter;
  if (result.status == CommandStatus::duplicate) {
    leave_out_repetition(shorter);
    if (shorter["first"].is_object()) to_shorten = &shorter["first"];
  }
  for (const auto leave_out : {leave_out_details, leave_out_values}) {
    text = dumped(shorter);
    if (text.size() <= kMost) return text;
    leave_out(*to_shorten);
  }
  return dumped(shorter);
}

std::string total_text(std::chrono::nanoseconds total) {
  Writer number;
  number.milliseconds(total);
  return number.take();
}

std::string with_total(std::string text, std::chrono::nanoseconds total) {
  return with_total(std::move(text), total_text(total));
}

CommandResult recorded_result(std::string text) {
  CommandResult result;
  result.status = CommandStatus::unknown_outcome;
  const auto json = parsed_json(text);
  if (!json.is_object() || !json::may_stand_inside(text)) {
    result.detail = "the record of the result is damaged";
    return result;
  }
  for (const CommandStatus status : kCommandStatuses)
    if (text_at(json, "status") == to_string(status)) result.status = status;
  for (const PlcAnswer answer : {PlcAnswer::ack, PlcAnswer::nak})
    if (text_at(json, "plc") == to_string(answer)) result.plc = answer;
  result.recorded = std::move(text);
  return result;
}

}  // namespace fxagent
