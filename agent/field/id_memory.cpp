#include "agent/field/id_memory.h"

#include <algorithm>
#include <utility>

namespace fxagent {

const IdMemory::Entry* IdMemory::find(const std::string& id) const {
  const auto& by_id = entries_.get<1>();
  const auto found = by_id.find(id);
  return found == by_id.end() ? nullptr : &*found;
}

bool IdMemory::make_room(SteadyTime now) {
  const auto may_go = [now](const Entry& entry) { return entry.over && now > entry.deadline; };
  while (!entries_.empty() && may_go(entries_.front()) && now - entries_.front().seen >= kFor)
    entries_.pop_front();
  if (entries_.size() < kMost) return true;
  const auto oldest = std::find_if(entries_.begin(), entries_.end(), may_go);
  if (oldest == entries_.end()) return false;
  entries_.erase(oldest);
  return true;
}

void IdMemory::add(Entry entry) { entries_.push_back(std::move(entry)); }

void IdMemory::finish(const std::string& id, std::shared_ptr<const CommandResult> result) {
  auto& by_id = entries_.get<1>();
  const auto found = by_id.find(id);
  if (found == by_id.end()) return;
  by_id.modify(found, [&](Entry& entry) {
    entry.over = true;
    entry.result = std::move(result);
  });
}

}  // namespace fxagent
