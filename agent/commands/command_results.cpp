#include "agent/commands/command_results.h"

#include <algorithm>
#include <utility>
#include <variant>

#include "agent/commands/result.h"
#include "agent/failpoint.h"
#include "agent/text/text.h"

namespace fxagent {
namespace {

constexpr std::size_t kTotalsKept = 1000;  // more than wait for the journal

bool is_remembered(const CommandResult& result) {
  return !result.id.empty() && !result.dry_run && result.status != CommandStatus::duplicate;
}

/// Returns the message of a result, without its place in the journal. Takes over what only the
/// message needs.
ResultMessage message_of(const std::string& device, CommandResult& result) {
  return {.device = device,
          .number = result.number,
          .id = result.id,
          .text = result_text(result),
          .received = result.received,
          .sent = result.attempts > 0,
          .recorded = !result.recorded.empty(),
          .response_topic = std::move(result.response_topic),
          .correlation = std::move(result.correlation),
          .reply = std::move(result.reply),
          .kept = std::move(result.kept)};
}

std::string shortened(const std::string& text) {
  constexpr std::size_t kMost = 64;  // bytes
  return text.size() <= kMost ? text : std::string(beginning(text, kMost)) + "…";
}

/// Returns the beginning of a value, for the last commands: at most 16 elements.
Value shortened(const Value& value) {
  constexpr std::size_t kMost = 16;
  Value out;
  out.is_array = value.is_array;
  for (const Scalar& item : value.items) {
    const bool is_over = out.items.size() == kMost;
    const auto* text = std::get_if<std::string>(&item);
    out.items.push_back(is_over ? Scalar("…") : text != nullptr ? Scalar(shortened(*text)) : item);
    if (is_over) break;
  }
  return out;
}

}  // namespace

void CommandResults::add(const std::string& device, CommandResult result,
                         const std::optional<audit::Receipt>& receipt, std::int64_t utc_ms) {
  ++counts_[result.status];
  if (result.recorded.empty()) note_last(device, result, utc_ms);
  find_first(device, result);
  failpoint("result_taken");
  ResultMessage message = message_of(device, result);
  message.is_first = is_remembered(result);
  if (journal_ != nullptr && !message.recorded) {
    JournalEntry entry;
    entry.device = message.device;
    if (receipt)
      entry.audit = audit::answered(*receipt, message.text, utc_ms);
    else if (result.number != 0)
      entry.audit = audit::result(result.number, entry.device, message.text, result.frames, utc_ms);
    if (message.is_first) {
      entry.id = result.id;
      // The row of an admitted command has its deadline already.
      entry.received_ms = entry.deadline_ms = result.received_ms;
      entry.op = result.op;
      entry.response_topic = message.response_topic;
      entry.correlation = message.correlation;
      entry.result = message.text;
      entry.number = result.number;
      entry.refused =
          result.status == CommandStatus::rejected || result.status == CommandStatus::expired;
      to_record_.push_back(std::move(entry));
    } else {
      journal_->note(std::move(entry.audit));
    }
  }
  waiting_.push_back(std::move(message));
}

void CommandResults::add_for_link(const std::string& link, CommandResult result,
                                  const audit::Receipt& receipt, std::int64_t utc_ms) {
  note_last(link, result, utc_ms);
  add_unrecorded(link, std::move(result));
  if (journal_ != nullptr) journal_->note(audit::answered(receipt, waiting_.back().text, utc_ms));
}

void CommandResults::add_unrecorded(const std::string& name, CommandResult result) {
  ++counts_[result.status];
  waiting_.push_back(message_of(name, result));
}

void CommandResults::note_last(const std::string& device, const CommandResult& result,
                               std::int64_t utc_ms) {
  static const TargetResult none;
  const TargetResult& first = result.targets.empty() ? none : result.targets.front();
  last_.push_back(std::make_shared<const LastCommand>(
      LastCommand{.number = last_.empty() ? 1 : last_.back()->number + 1,
                  .device = device,
                  .id = result.id,
                  .op = result.op,
                  .by = shortened(result.sender),
                  .target = first.tag.empty() ? first.address : first.tag,
                  .value = first.value ? shortened(*first.value) : Value(),
                  .targets = result.targets.size(),
                  .status = result.status,
                  .reason = result.reason,
                  .detail = result.detail,
                  .ts_ms = utc_ms,
                  .took = result.queue + result.wire,
                  .bound = result.bound,
                  .frames = result.frames}));
  if (last_.size() > kLastCommands) last_.pop_front();
}

/// Finds the first result of a DUPLICATE in the journal, unless that was lost or set aside.
void CommandResults::find_first(const std::string& device, CommandResult& result) {
  if (!result.first_number || result.first || journal_ == nullptr) return;
  record();
  const auto known = journal_->find(device, result.id);
  if (!known || known->result.empty() || known->number != result.first_number) {
    result.detail =
        journal_->hangs()
            ? "the store's disk does not respond, so the first result cannot be read; the command "
              "is not repeated"
            : "the first result is no longer in the journal; the command is not repeated";
    return;
  }
  std::string text = known->result;
  const auto total =
      std::ranges::find(totals_, known->number, [](const auto& each) { return each.first; });
  if (total != totals_.end()) text = with_total(std::move(text), total->second);
  CommandResult first = recorded_result(std::move(text));
  first.id = result.id;
  first.id_is_number = result.id_is_number;
  result.plc = first.plc;
  result.first = std::make_shared<const CommandResult>(std::move(first));
}

void CommandResults::record() {
  if (to_record_.empty()) return;
  journal_->record(std::exchange(to_record_, {}));
  failpoint("result_recorded");
}

std::vector<ResultMessage> CommandResults::take() {
  record();
  return std::exchange(waiting_, {});
}

void CommandResults::note_total(const ResultMessage& result) {
  if (!result.is_first || !result.total) return;
  if (const auto text = result.kept.lock()) {
    *text = with_total(std::move(*text), *result.total);
    text->shrink_to_fit();
  }
  if (journal_ == nullptr) return;
  totals_.emplace_back(result.number, *result.total);
  if (totals_.size() > kTotalsKept) totals_.pop_front();
}

void CommandResults::note_delivery(const ResultMessage& result, bool acknowledged,
                                   std::int64_t utc_ms) {
  if (journal_ == nullptr) return;
  if (result.number != 0)
    journal_->note(audit::delivery(result.number, result.device, result.id, acknowledged, utc_ms));
  if (result.is_first)
    journal_->acknowledge(result.device, result.id, result.number,
                          result.total ? total_text(*result.total) : std::string());
}

}  // namespace fxagent
