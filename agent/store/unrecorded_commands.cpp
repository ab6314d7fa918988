#include "agent/store/unrecorded_commands.h"

#include <algorithm>
#include <boost/tuple/tuple.hpp>
#include <utility>

#include "agent/log/log.h"

namespace fxagent {

void UnrecordedCommands::put(JournalEntry entry) {
  auto& by_id = entries_.get<1>();
  if (const auto kept = by_id.find(boost::make_tuple(entry.device, entry.id));
      kept != by_id.end()) {
    if (entry.number < kept->number + (kept->result.empty() ? 0 : 1)) return;
    if (entry.number == kept->number)
      entry.deadline_ms = std::max(entry.deadline_ms, kept->deadline_ms);
    bytes_ -= bytes_of(*kept);
    by_id.erase(kept);
  }
  bytes_ += bytes_of(entry);
  entries_.push_back(std::move(entry));
  while (entries_.size() > kMost || bytes_ > kMostBytes) make_room();
}

void UnrecordedCommands::make_room() {
  auto oldest = std::find_if(entries_.begin(), entries_.end(),
                             [](const JournalEntry& kept) { return !kept.result.empty(); });
  if (oldest == entries_.end()) oldest = entries_.begin();
  if (!std::exchange(forgot_some_, true))
    log::error("results_not_kept", {{"device", oldest->device}, {"first_id", oldest->id}});
  bytes_ -= bytes_of(*oldest);
  entries_.erase(oldest);
}

const JournalEntry* UnrecordedCommands::find(const std::string& device,
                                             const std::string& id) const {
  const auto& by_id = entries_.get<1>();
  const auto kept = by_id.find(boost::make_tuple(device, id));
  return kept == by_id.end() ? nullptr : &*kept;
}

void UnrecordedCommands::drop_first(std::size_t count) {
  for (; count > 0; --count) {
    bytes_ -= bytes_of(entries_.front());
    entries_.pop_front();
  }
  if (entries_.empty()) forgot_some_ = false;
}

void UnrecordedCommands::move_times(std::int64_t by_ms) {
  for (auto entry = entries_.begin(); entry != entries_.end(); ++entry)
    entries_.modify(entry, [by_ms](JournalEntry& changed) {
      changed.received_ms += by_ms;
      changed.deadline_ms += by_ms;
    });
}

}  // namespace fxagent
