#include "agent/store/journal/journal_rows.h"

#include <algorithm>
#include <utility>

namespace fxagent {

void JournalRows::write_command(const JournalEntry& entry) {
  table_->insert(entry);
  audit_.append(entry.audit);
}

void JournalRows::write_result(const JournalEntry& entry) {
  table_->record(entry);
  audit_.append(entry.audit);
}

void JournalRows::keep(JournalEntry entry) {
  audit_.note(std::exchange(entry.audit, {}));
  waiting_.put(std::move(entry));
}

void JournalRows::acknowledge(std::string device, std::string id, std::uint64_t number,
                              std::string total_ms) {
  if (to_acknowledge_.size() < UnrecordedCommands::kMost)
    to_acknowledge_.push_back({std::move(device), std::move(id), number, std::move(total_ms)});
}

std::set<std::pair<std::string, std::string>> JournalRows::acknowledged_ids() const {
  std::set<std::pair<std::string, std::string>> ids;
  for (const Acknowledgement& each : to_acknowledge_) ids.emplace(each.device, each.id);
  return ids;
}

bool JournalRows::has_pending() const { return waiting_.size() != 0 || !to_acknowledge_.empty(); }

void JournalRows::begin_commit() {
  table_->begin();
  written_ = 0;
  is_acknowledged_ = false;
}

bool JournalRows::write_pending(std::size_t at_most) {
  const std::size_t count = std::min(at_most, waiting_.size());
  for (auto entry = waiting_.begin(); written_ < count; ++entry, ++written_)
    entry->result.empty() ? write_command(*entry) : write_result(*entry);
  if (written_ < waiting_.size()) return true;
  // Acknowledgements follow their results.
  for (const auto& [device, id, number, total_ms] : to_acknowledge_)
    table_->acknowledge(device, id, number, total_ms);
  is_acknowledged_ = true;
  return false;
}

void JournalRows::committed() {
  table_->committed();
  waiting_.drop_first(written_);
  if (is_acknowledged_) to_acknowledge_.clear();
  written_ = 0;
}

}  // namespace fxagent
