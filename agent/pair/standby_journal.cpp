#include "agent/pair/standby_journal.h"

#include <chrono>
#include <utility>

#include "agent/commands/audit_records.h"
#include "agent/pair/pair_messages.h"

namespace fxagent {
namespace {

using std::chrono::seconds;

constexpr seconds kUpkeep{1};

std::int64_t now_ms() { return utc_ms(std::chrono::system_clock::now()); }

}  // namespace

StandbyJournal::StandbyJournal(const StoreConfig& config) : store_(config, now_ms()) {
  for (const JournalEntry& entry : store_.journal().unacknowledged({})) own_.insert(entry.number);
}

std::optional<JournalEntry> StandbyJournal::keep_announced(JournalEntry entry,
                                                           const std::string& topic) {
  StoredJournal& journal = store_.journal();
  if (auto known = journal.find(entry.device, entry.id)) return known;
  entry.number = journal.next_command_number();
  const audit::Receipt receipt{.number = entry.number,
                               .device = entry.device,
                               .topic = topic,
                               .received_ms = entry.received_ms};
  entry.audit = audit::admitted(receipt, entry.id, entry.op, now_ms());
  if (!entry.result.empty()) {
    journal.note(std::exchange(
        entry.audit, audit::result(entry.number, entry.device, entry.result, {}, now_ms())));
    journal.record(std::move(entry));
    return std::nullopt;
  }
  // It counts as sent: only the other gateway knows.
  if (!entry.surely_not_sent) store_.started().mark(entry.number);
  journal.journal({&entry, 1});
  return std::nullopt;
}

void StandbyJournal::keep_result(const std::string& device, const std::string& text) {
  const auto result = pair_messages::result_from(text);
  // The result of a repeated id is not the first one.
  if (!result || result->status == "DUPLICATE") return;
  StoredJournal& journal = store_.journal();
  const bool refused = result->status == "REJECTED" || result->status == "EXPIRED";
  const std::int64_t now = now_ms();
  if (const auto known = journal.find(device, result->id)) {
    if (known->result.empty() && !known->acknowledged && !refused) {
      JournalEntry entry = *known;
      entry.result = text;
      entry.audit = audit::result(entry.number, device, text, {}, now);
      journal.record(std::move(entry));
      journal.note(audit::delivery(known->number, device, result->id, true, now));
    }
    return journal.acknowledge(device, result->id, known->number, {});
  }
  JournalEntry entry;
  entry.device = device;
  entry.id = result->id;
  entry.op = result->op;
  entry.received_ms = entry.deadline_ms = now;
  entry.result = text;
  entry.refused = refused;
  entry.number = journal.next_command_number();
  const std::uint64_t number = entry.number;
  journal.record(std::move(entry));
  journal.acknowledge(device, result->id, number, {});
}

void StandbyJournal::keep_answered(const JournalEntry& entry) {
  if (!entry.result.empty()) return keep_result(entry.device, entry.result);
  if (const auto known = store_.journal().find(entry.device, entry.id))
    store_.journal().acknowledge(entry.device, entry.id, known->number, {});
}

std::deque<JournalEntry> StandbyJournal::unanswered() {
  std::deque<JournalEntry> entries;
  if (own_.empty()) return entries;
  for (JournalEntry& entry : store_.journal().unacknowledged({}))
    if (own_.contains(entry.number)) entries.push_back(std::move(entry));
  if (entries.empty()) own_.clear();
  return entries;
}

// Only reads and refusals were not announced.
void StandbyJournal::acknowledge_own_commands() {
  for (const JournalEntry& entry : unanswered())
    if (!entry.refused && entry.op != to_string(Op::read))
      store_.journal().acknowledge(entry.device, entry.id, entry.number, {});
}

void StandbyJournal::upkeep(SteadyTime now) {
  if (now < upkeep_at_) return;
  store_.upkeep(now, now_ms());
  upkeep_at_ = now + kUpkeep;
}

std::vector<JournalEntry> StandbyJournal::close() {
  store_.close();
  return store_.journal().unwritten();
}

void take_over(std::vector<JournalEntry>& entries, Store& store) {
  StoredJournal& journal = store.journal();
  std::vector<JournalEntry> commands;
  std::vector<JournalEntry> results;
  for (JournalEntry& entry : entries) {
    const auto known = journal.find(entry.device, entry.id);
    const bool is_known = known && known->number == entry.number;
    if (!is_known) {
      entry.number = journal.next_command_number();
      if (!entry.surely_not_sent) store.started().mark(entry.number);
    }
    if (!entry.result.empty())
      results.push_back(entry);
    else if (!is_known)
      commands.push_back(entry);
  }
  journal.journal(commands);
  journal.record(std::move(results));
  for (const JournalEntry& entry : entries)
    if (entry.acknowledged) journal.acknowledge(entry.device, entry.id, entry.number, {});
}

}  // namespace fxagent
