#include "agent/pair/standby_journal.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <utility>

#include "agent/commands/audit_records.h"
#include "agent/file_handle.h"
#include "agent/pair/pair_messages.h"

namespace fxagent {
namespace {

using std::chrono::seconds;

constexpr seconds kUpkeep{1};
constexpr seconds kUnansweredAgain{5};
constexpr seconds kLongestUnanswered{60};

/// Each line has a topic or a device, a tab, and a text, which has no line feed.
std::string file_of_heard(const StoreConfig& config) { return config.path + "/fxagent.heard"; }

/// True if the other gateway may have forgotten the command.
bool is_old(const JournalEntry& entry) {
  return entry.received_ms <= utc_now_ms() - std::chrono::milliseconds(kRememberedFor).count();
}

}  // namespace

bool StandbyJournal::save_heard(const StoreConfig& config, const std::string& where,
                                const std::string& text) {
  const FileHandle file(::open(file_of_heard(config).c_str(),
                               O_WRONLY | O_APPEND | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0600));
  // A line that was cut off does not swallow this one.
  const std::string line = '\n' + where + '\t' + text + '\n';
  return file >= 0 && ::write(file, line.data(), line.size()) == std::ssize(line);
}

void StandbyJournal::keep_heard(const StoreConfig& config) {
  std::ifstream file(file_of_heard(config));
  for (std::string line; std::getline(file, line);) {
    const std::size_t tab = std::min(line.find('\t'), line.size());
    const std::string where = line.substr(0, tab);
    const std::string text = line.substr(std::min(tab + 1, line.size()));
    if (where.find('/') == std::string::npos) {
      keep_result(where, text);
    } else if (auto announcement = pair_messages::announcement_from(text)) {
      const JournalEntry& entry = announcement->entry;
      if (is_old(entry)) continue;
      keep_announced(entry, where);
      // Its result may not have come either.
      if (const auto kept = store_.journal().find(entry.device, entry.id);
          kept && !kept->acknowledged)
        own_.insert(kept->number);
    }
  }
  std::error_code ignored;
  if (store_.is_writable()) std::filesystem::remove(file_of_heard(config), ignored);
}

StandbyJournal::StandbyJournal(const StoreConfig& config) : store_(config, utc_now_ms()) {
  for (const JournalEntry& entry : store_.journal().unacknowledged({})) own_.insert(entry.number);
  keep_heard(config);
}

void StandbyJournal::keep_announced(JournalEntry entry, const std::string& topic) {
  // The active gateway may have received a command that this one had left unsent.
  if (const auto known = store_.journal().find(entry.device, entry.id);
      known && own_.erase(known->number) == 0)
    return;
  keep(std::move(entry), topic);
}

std::optional<JournalEntry> StandbyJournal::keep_unanswered(JournalEntry entry,
                                                            const std::string& topic) {
  if (auto known = store_.journal().find(entry.device, entry.id)) return known;
  keep(std::move(entry), topic);
  return std::nullopt;
}

void StandbyJournal::keep(JournalEntry entry, const std::string& topic) {
  StoredJournal& journal = store_.journal();
  entry.number = journal.next_command_number();
  const std::int64_t now = utc_now_ms();
  entry.audit = audit::announced(entry, topic, now);
  if (!entry.result.empty()) {
    journal.note(std::exchange(entry.audit,
                               audit::result(entry.number, entry.device, entry.result, {}, now)));
    return journal.record(std::move(entry));
  }
  // It counts as sent: only the other gateway knows.
  if (!entry.surely_not_sent) store_.started().mark(entry.number);
  journal.journal({&entry, 1});
}

void StandbyJournal::keep_result(const std::string& device, const std::string& text) {
  const auto result = pair_messages::result_from(text);
  // The result of a repeated id is not the first one.
  if (!result || result->status == "DUPLICATE") return;
  StoredJournal& journal = store_.journal();
  const bool refused = result->status == "REJECTED" || result->status == "EXPIRED";
  const std::int64_t now = utc_now_ms();
  if (const auto known = journal.find(device, result->id)) {
    if (known->result.empty() && !known->acknowledged && !refused) {
      JournalEntry entry = *known;
      entry.result = text;
      entry.audit = audit::result(entry.number, device, text, {}, now);
      journal.record(std::move(entry));
      journal.note(audit::delivery(known->number, device, result->id, true, now));
    }
    return acknowledge(*known);
  }
  JournalEntry entry;
  entry.device = device;
  entry.id = result->id;
  entry.op = result->op;
  entry.received_ms = entry.deadline_ms = now;
  entry.result = text;
  entry.refused = refused;
  entry.number = journal.next_command_number();
  journal.record(entry);
  acknowledge(entry);
}

void StandbyJournal::keep_answered(const JournalEntry& entry) {
  if (!entry.result.empty()) return keep_result(entry.device, entry.result);
  if (const auto known = store_.journal().find(entry.device, entry.id)) acknowledge(*known);
}

void StandbyJournal::acknowledge(const JournalEntry& known) {
  own_.erase(known.number);
  store_.journal().acknowledge(known.device, known.id, known.number, {});
}

std::optional<JournalEntry> StandbyJournal::next_unanswered(BootTime now) {
  if (unanswered_.empty() && (!unanswered_at_ || now >= *unanswered_at_)) {
    if (!own_.empty())
      for (JournalEntry& entry : store_.journal().unacknowledged({}))
        if (own_.contains(entry.number) && !is_old(entry)) unanswered_.push_back(std::move(entry));
    unanswered_at_ = now + unanswered_pause_;
    unanswered_pause_ = std::min<BootTime>(2 * unanswered_pause_, kLongestUnanswered);
  }
  if (unanswered_.empty()) return std::nullopt;
  JournalEntry next = std::move(unanswered_.front());
  unanswered_.pop_front();
  return next;
}

void StandbyJournal::connection_began() {
  unanswered_at_.reset();
  unanswered_pause_ = kUnansweredAgain;
}

// The other gateway knew each from its announcement. Reads and refusals have none before they are
// left.
void StandbyJournal::acknowledge_own_commands() {
  for (const JournalEntry& entry : store_.journal().unacknowledged({}))
    if (own_.contains(entry.number) && !entry.refused && entry.op != to_string(Op::read))
      acknowledge(entry);
}

void StandbyJournal::upkeep(SteadyTime now) {
  if (now < upkeep_at_) return;
  store_.upkeep(now, utc_now_ms());
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
