#include "agent/store/journal/unrecorded_commands.h"

#include <algorithm>
#include <utility>

#include "agent/log/log.h"

namespace fxagent {

void UnrecordedCommands::put(JournalEntry entry) {
  if (const auto found = by_id_.find({entry.device, entry.id}); found != by_id_.end()) {
    const JournalEntry& kept = *found->second;
    if (entry.number < kept.number + (kept.result.empty() ? 0 : 1)) return;
    if (entry.number == kept.number)
      entry.deadline_ms = std::max(entry.deadline_ms, kept.deadline_ms);
    erase(found->second);
  }
  bytes_ += bytes_of(entry);
  const auto added = entries_.insert(entries_.end(), std::move(entry));
  by_id_.emplace(std::pair{added->device, added->id}, added);
  while (entries_.size() > kMost || bytes_ > kMostBytes) make_room();
}

void UnrecordedCommands::erase(Entries::iterator entry) {
  bytes_ -= bytes_of(*entry);
  by_id_.erase({entry->device, entry->id});
  entries_.erase(entry);
}

void UnrecordedCommands::make_room() {
  auto oldest =
      std::ranges::find_if(entries_, [](const JournalEntry& kept) { return !kept.result.empty(); });
  if (oldest == entries_.end()) oldest = entries_.begin();
  if (!std::exchange(forgot_some_, true))
    log::error("results_not_kept", {{"device", oldest->device}, {"first_id", oldest->id}});
  erase(oldest);
}

const JournalEntry* UnrecordedCommands::find(const std::string& device,
                                             const std::string& id) const {
  const auto found = by_id_.find({device, id});
  return found == by_id_.end() ? nullptr : &*found->second;
}

void UnrecordedCommands::drop_first(std::size_t count) {
  for (; count > 0; --count) erase(entries_.begin());
  if (entries_.empty()) forgot_some_ = false;
}

void UnrecordedCommands::move_times(std::int64_t by_ms, std::uint64_t from_number,
                                    std::int64_t from_ms) {
  for (JournalEntry& entry : entries_) {
    if (entry.number < from_number && entry.received_ms < from_ms) continue;
    entry.received_ms += by_ms;
    entry.deadline_ms += by_ms;
  }
}

}  // namespace fxagent
